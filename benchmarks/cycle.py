"""A full aging cycle in virtual time through all the bytes: how much faster than the bench, and how much memory.

Run: python -m benchmarks.cycle [PROFILE]
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def main(profile: str = "full") -> None:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        command = [sys.executable, "-m", "pytest", "-q", "-m", "cycle", "tests_bench", "--profile", profile]
        start_s = time.perf_counter()
        child = subprocess.run([*command, "--out", str(out)], check=False, capture_output=True, text=True)
        wall_s = time.perf_counter() - start_s
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        lines = [json.loads(line) for line in (out / "session-0001.jsonl").read_text(encoding="utf-8").splitlines()]
        bench_s = lines[-1]["time_s"]
        ends = [line for line in lines if line["type"] == "step_end"]
        size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    cpu_s = usage.ru_utime + usage.ru_stime
    verdict = lines[-1]["verdict"]
    print(f"profile {profile}: exit {child.returncode}, {len(ends)} steps with the reference, verdict {verdict}")
    print(f"bench time {bench_s / 3600:.2f} h in {wall_s:.1f} s: {bench_s / wall_s:.0f} x (promised: 150 x)")
    print(f"processor time {cpu_s:.1f} s, that is {cpu_s / wall_s:.2f} processors")
    print(f"peak memory {usage.ru_maxrss / 1024:.0f} MiB (promised: 1024), on disk {size / 1e9:.2f} GB")


if __name__ == "__main__":
    main(*sys.argv[1:])
