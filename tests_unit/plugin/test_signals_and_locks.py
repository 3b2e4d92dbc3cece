"""A signal whose exception comes while a lock is taken must not leave it taken: a session would never end."""

import signal
import sys
import threading

import pytest

from arl_fixtures.plugin import _end_like_ctrl_c


@pytest.fixture(params=[signal.SIGTERM, signal.SIGINT])
def ending(request):
    """The plugin's handler for a signal."""
    before = signal.signal(request.param, _end_like_ctrl_c)
    yield request.param
    signal.signal(request.param, before)


def struck(step, moment, number):
    """A profiler that sends a signal at the first call of, or return from, a step of a lock."""

    def strike(frame, what, _):
        if what == moment and frame.f_code is step.__code__:
            sys.setprofile(None)
            signal.raise_signal(number)

    return strike


def set_until_struck(event, strike):
    sys.setprofile(strike)
    try:
        while True:
            event.set()
    finally:
        sys.setprofile(None)


@pytest.mark.parametrize("moment", ["call", "return"])
@pytest.mark.parametrize("step", [threading.Condition.__enter__, threading.Condition.__exit__])
def test_a_lock_is_free_after_a_signal(ending, step, moment):
    event = threading.Event()
    with pytest.raises(KeyboardInterrupt):
        set_until_struck(event, struck(step, moment, ending))
    setter = threading.Thread(target=event.set, daemon=True)
    setter.start()
    setter.join(timeout=10.0)
    assert not setter.is_alive()
