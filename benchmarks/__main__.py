"""`make bench`: every benchmark in turn; each prints ratios within one run. Ten minutes or so."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from benchmarks import cycle, decode, journal, load, metrics, overhead, realtime, recording, render, report

LOAD_MINUTES = 2.0

with tempfile.TemporaryDirectory() as folder:
    turns: list[tuple[ModuleType, Callable[[], object]]] = [
        (decode, decode.main),
        (render, render.main),
        (recording, recording.main),
        (journal, journal.main),
        (metrics, metrics.main),
        (overhead, overhead.main),
        (realtime, realtime.main),
        (load, lambda: load.main(LOAD_MINUTES)),
        (cycle, lambda: cycle.main("full", folder)),
        (report, lambda: report.main([Path(folder)])),
    ]
    for module, run in turns:
        print(f"\n== {module.__name__}: {(module.__doc__ or '').splitlines()[0]}", flush=True)
        run()
