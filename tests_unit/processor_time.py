"""What computing costs, as seconds of one certain processor: a slow or busy one does not make it dearer."""

import time
from collections.abc import Callable

REFERENCE_S = 0.037
"""What `_yardstick` took where the limits were set."""


def processor_s(work: Callable[[], object], *, rounds: int = 3) -> float:
    """The least that `work` took, each time in proportion to what something known took just before and after it."""
    found = []
    before_s = _cost_s(_yardstick)
    for _ in range(rounds):
        work_s, after_s = _cost_s(work), _cost_s(_yardstick)
        found.append(work_s / max(before_s, after_s) * REFERENCE_S)
        before_s = after_s
    return min(found)


def _cost_s(work: Callable[[], object]) -> float:
    start_s = time.process_time()
    work()
    return time.process_time() - start_s


def _yardstick() -> int:
    total = 0
    for number in range(500_000):
        total += number * number % 7
    return total
