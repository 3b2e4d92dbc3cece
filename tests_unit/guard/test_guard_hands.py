"""Cut short in the middle of a look, the guard's hands are free for the safe actions at once."""

import pytest

from arl_fixtures.bench.build import CONTROL_LINES, Emulated
from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.drivers import find_driver
from arl_fixtures.bench.guard_settings import GuardSettings
from arl_fixtures.guard.core import SafeStep
from arl_fixtures.guard.hands import Hands
from arl_fixtures.guard.line import open_lines


class Attention:
    """Somebody speaks all the time; whether it is urgent is said by the test."""

    def __init__(self):
        self.urgent = False

    def sockets(self):
        return []

    def attend(self):
        return self.urgent


class Host:
    """The emulated hardware, and waiting during which everybody is heard first."""

    def __init__(self, world):
        self._world = world
        self.clock = world.clock

    def open(self, kind):
        return self._world.port(kind)

    def read(self, port, timeout_s, attention):
        return b"" if attention.attend() else port.read(timeout_s)

    def sleep(self, until_s, attention):
        if not attention.attend():
            self.clock.sleep(until_s - self.clock.now_s)


@pytest.fixture
def config():
    return load_bench("emulated")


@pytest.fixture
def host(config):
    world = Emulated(config, VirtualClock())
    relays = find_driver("conrad", "relays").make(world.port("relays"), world.clock, config.device_settings("relays"))
    for load in relays.loads():
        relays.set(load, on=True)
    relays.close()
    return Host(world)


@pytest.fixture
def attention():
    return Attention()


@pytest.fixture
def hands(config, host, attention):
    return Hands(config, host, open_lines(config, host), attention)


@pytest.mark.parametrize("kind", CONTROL_LINES)
@pytest.mark.parametrize("step", SafeStep)
@pytest.mark.parametrize("still_urgent", [False, True])
def test_a_look_that_is_cut_short_costs_the_safe_action_nothing(hands, host, attention, kind, step, still_urgent):
    assert hands.look(kind, 10.0) == ""
    attention.urgent = True
    assert hands.look(kind, 10.0) != ""
    attention.urgent = still_urgent
    since_s = host.clock.now_s
    assert hands.do(step, GuardSettings().attempt_s) == ""
    assert host.clock.now_s - since_s < GuardSettings().attempt_s
    # only what is safe may not be cut short
    assert bool(hands.look(kind, 10.0)) is still_urgent
