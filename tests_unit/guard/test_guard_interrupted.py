"""A guard that died in the middle of making safe: the next one goes on, and asks for what was to be asked for."""

import pytest
from real_processes import comes_to_rest, until

from arl_fixtures.errors import InterlockError
from arl_fixtures.guard.acknowledge import acknowledge
from arl_fixtures.guard.runtime import StopReport, read_stop, write_stop

pytestmark = pytest.mark.usefixtures("forked_guards")


def interrupted(stand, cause, *, ack_if_verified):
    """What such a guard leaves on disk."""
    under_way = {"all safe actions": "under way"}
    report = StopReport(
        bench=stand.config.name, cause=cause, utc="t", bench_time_s=1.0, unverified=under_way,
        ack_if_verified=ack_if_verified,
    )  # fmt: skip
    write_stop(stand.places, report)
    stand.places.driven.write_text('{"since_utc": "noon"}')


def test_after_a_lost_test_the_next_session_may_follow_at_once(make_stand):
    stand = make_stand("poll_s: 1.0")
    interrupted(stand, "the test (process 7) died", ack_if_verified=False)
    with stand.open_guard() as guard:
        assert "the test (process 7) died; the guard died while it made the bench safe" in guard.last_stop
        assert "were verified" in guard.last_stop
        assert stand.inspect()["state"]["setpoint_c"] == 23.0


def test_after_a_tripped_condition_it_is_made_safe_first_and_acknowledged_then(make_stand):
    stand = make_stand("poll_s: 1.0")
    interrupted(stand, "housings ceiling 95: T2 reads 99 °C", ack_if_verified=True)
    with pytest.raises(InterlockError, match=r"T2 reads 99 °C.*acknowledge with: arl ack"):
        stand.open_guard()
    comes_to_rest(stand)
    stop = read_stop(stand.places)
    assert stop.blocks
    assert stop.unverified == {}
    assert [action["fault"] for action in stop.actions] == ["", "", ""]
    assert not stand.places.driven.exists()
    until(lambda: not stand.guard_pid(), "the guard goes home")
    acknowledge(stand.places, who="x", note="seen")
    with stand.open_guard() as guard:
        assert "T2 reads 99" in guard.last_stop
