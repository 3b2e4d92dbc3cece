"""How properties are tried: the same examples at every check, and without a clock.

`pytest --hypothesis-profile=default` draws new ones.
"""

import gc

import pytest
from hypothesis import HealthCheck, settings

# A check that fails must fail again, and a machine under load is slow, not wrong: without this a run outside of what
# hypothesis takes for CI draws new examples each time and gives each 200 ms.
settings.register_profile("check", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("check")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Modules and collected tests live as long as the process: no search for garbage goes through them."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()
