"""A full aging cycle in virtual time through all the bytes: how much faster than the bench, and how much memory.

Memory is the resident set of the test process after each step, read from the outside when the journal tells of the
step's end; the first steps fill caches, so growth is told from the fourth on.
Run: python -m benchmarks.cycle [PROFILE [FOLDER]]; the folder, empty or new, keeps the cycle's output.
"""

from __future__ import annotations

import contextlib
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

POLL_S = 0.05
WARM_STEPS = 3
PROMISED_SPEED = 150
PROMISED_MIB = 1024


def resident_mib(pid: int) -> float:
    """Resident memory of a process; NaN when it has gone."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError):
        return float("nan")
    return pages * resource.getpagesize() / 2**20


def watch(child: subprocess.Popen[bytes], journal: Path) -> list[float]:
    """Resident memory at the end of each step, until the process ends."""
    memory: list[float] = []
    seen = 0
    while child.poll() is None:
        time.sleep(POLL_S)
        if not journal.is_file():
            continue
        with journal.open("rb") as file:
            file.seek(seen)
            new = file.read()
        seen += len(new)
        memory += [resident_mib(child.pid)] * new.count(b'"type":"step_end"')
    return [value for value in memory if value > 0]


def main(profile: str = "full", folder: str = "") -> None:
    with contextlib.nullcontext(folder) if folder else tempfile.TemporaryDirectory() as place:
        out = Path(place)
        journal = out / "session-0001.jsonl"
        command = [sys.executable, "-m", "pytest", "-q", "-m", "cycle", "tests_bench", "--profile", profile]
        start_s = time.perf_counter()
        child = subprocess.Popen([*command, "--out", str(out)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        memory = watch(child, journal)
        wall_s = time.perf_counter() - start_s
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        lines = [json.loads(line) for line in journal.read_text(encoding="utf-8").splitlines()]
        bench_s = lines[-1]["time_s"]
        ends = [line for line in lines if line["type"] == "step_end"]
        size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    cpu_s = usage.ru_utime + usage.ru_stime
    verdict = lines[-1]["verdict"]
    print(f"profile {profile}: exit {child.returncode}, {len(ends)} steps with the reference, verdict {verdict}")
    speed = f"{bench_s / wall_s:.0f} x (at least {PROMISED_SPEED} x)"
    print(f"bench time {bench_s / 3600:.2f} h in {wall_s:.1f} s: {speed}")
    print(f"processor time {cpu_s:.1f} s: {bench_s / cpu_s:.0f} x; {cpu_s / wall_s:.2f} processors were busy")
    print(f"peak memory {usage.ru_maxrss / 1024:.0f} MiB of {PROMISED_MIB} MiB allowed, on disk {size / 1e9:.2f} GB")
    if len(memory) > WARM_STEPS + 1:
        steady = np.array(memory[WARM_STEPS:])
        slope = float(np.polyfit(np.arange(len(steady)), steady, 1)[0])
        first = WARM_STEPS + 1
        print(f"resident after each step, MiB: {' '.join(f'{value:.0f}' for value in memory)}")
        print(
            f"last over step {first}: {steady[-1] / steady[0]:.3f}; slope {slope:+.2f} MiB a step, "
            f"that is {100 * slope / steady[0]:+.2f} % a step"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
