"""`make bench`: every benchmark in turn; each prints ratios within one run."""

from __future__ import annotations

from benchmarks import cycle, decode, metrics, overhead, realtime, recording, render

for module in (decode, render, recording, metrics, overhead, realtime, cycle):
    print(f"\n== {module.__name__}: {(module.__doc__ or '').splitlines()[0]}", flush=True)
    module.main()
