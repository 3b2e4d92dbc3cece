"""The guard's mind: every transition by table, and what holds whatever happens in whatever order."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.bench.guard_settings import Action, Condition, GuardSettings
from arl_fixtures.errors import LocalProtocolError
from arl_fixtures.guard.conditions import Sample
from arl_fixtures.guard.core import DRIVEN, TRANSITIONS, GuardCore, SafeSequence, SafeStep, State

CONDITIONS = (
    Condition(watch="housings", ceiling=95.0),
    Condition(watch="housings", floor=-20.0, action=Action.SOAK_BACK),
    Condition(watch="stage_fault", action=Action.HOLD),
)
SETTINGS = GuardSettings(conditions=CONDITIONS, attempts=3, hold_limit_s=100.0, obey_s=20.0, clear_s=0.0)


def sample(time_s, housing_c=25.0, stage_fault=""):
    return Sample(time_s=time_s, temperatures_c={"T2": housing_c}, housings=("T2",), stage_fault=stage_fault)


def armed(now_s=0.0, settings=SETTINGS):
    core = GuardCore(settings)
    core.join(now_s)
    return core


def carry_out(core, faults=None):
    """Do every safe action; `faults` maps a step to how often it fails."""
    faults, done = dict(faults or {}), []
    while (step := core.to_do) is not None:
        done.append(step)
        failing = faults.get(step, 0) > 0
        faults[step] = faults.get(step, 0) - 1
        core.did(step, "no answer" if failing else "", 1.0)
    return done


def test_ceiling_leads_to_the_safe_state_and_only_an_acknowledgement_leaves_it():
    core = armed()
    core.see(sample(1.0, housing_c=95.2))
    assert core.state is State.TRIPPED
    assert "T2 reads 95.2 °C, above 95 °C" in core.cause
    assert carry_out(core) == [SafeStep.POWER_OFF, SafeStep.SETPOINT, SafeStep.STAGE_STOP]
    assert core.state is State.SAFE
    assert core.needs_ack
    with pytest.raises(LocalProtocolError, match="cannot happen while safe"):
        core.join(2.0)
    core.acknowledge(3.0, "an engineer", "fan replaced")
    core.join(4.0)
    assert core.state is State.ARMED


def test_a_lost_test_with_a_verified_bench_needs_no_acknowledgement():
    core = armed()
    core.lost(1.0, "the test process died")
    carry_out(core)
    assert core.state is State.IDLE
    assert core.cause == "the test process died"


def test_a_lost_test_with_a_bench_that_cannot_be_verified_does():
    core = armed()
    core.lost(1.0, "the test process died")
    done = carry_out(core, {SafeStep.SETPOINT: 99})
    # the other actions are not kept waiting by the one that fails
    assert done == [SafeStep.POWER_OFF, SafeStep.SETPOINT, SafeStep.STAGE_STOP, SafeStep.SETPOINT, SafeStep.SETPOINT]
    assert core.state is State.SAFE
    assert core.needs_ack
    unsafe = core.take_records()[-1]
    assert unsafe.detail["unverified"] == {"safe set-point": "no answer"}


def test_an_orderly_end_is_verified_too():
    core = armed()
    core.leave(1.0)
    assert core.state is State.CLOSING
    carry_out(core, {SafeStep.POWER_OFF: 1})
    assert core.state is State.IDLE
    assert not core.needs_ack


def test_hold_ends_by_itself_and_soak_back_outweighs_it():
    core = armed()
    core.see(sample(1.0, stage_fault="stalled"))
    assert core.request is not None
    assert core.request.action is Action.HOLD
    core.see(sample(2.0, housing_c=-21.0, stage_fault="stalled"))
    assert core.request is not None
    assert core.request.action is Action.SOAK_BACK
    core.see(sample(3.0))
    assert core.state is State.ARMED
    assert core.request is None


def test_a_pause_is_over_when_all_has_been_well_for_a_while():
    core = armed(settings=SETTINGS.model_copy(update={"clear_s": 5.0}))
    core.see(sample(1.0, stage_fault="stalled"))
    for time_s, fault in ((3.0, ""), (4.0, "stalled"), (8.9, "")):
        core.see(sample(time_s, stage_fault=fault))
        assert core.state is State.HOLDING
    core.see(sample(9.0))
    assert core.state is State.ARMED


def test_a_pause_that_is_not_heeded_or_never_ends_becomes_a_safe_state():
    ignored, endless = armed(), armed()
    for core in (ignored, endless):
        core.see(sample(1.0, stage_fault="stalled"))
    endless.heed(2.0)
    for core in (ignored, endless):
        core.beat(22.0)
        core.tick(22.0)
    assert ignored.state is State.TRIPPED
    assert "did not pause within 20 s" in ignored.cause
    assert endless.state is State.HOLDING
    endless.beat(102.0)
    endless.tick(102.0)
    assert endless.state is State.TRIPPED
    assert "not over after 100 s" in endless.cause


def test_a_main_loop_that_hangs_is_noticed():
    core = armed()
    core.beat(5.0)
    core.tick(15.0)
    assert core.state is State.ARMED
    core.tick(15.1)
    assert core.state is State.TRIPPED
    assert "no sign of life" in core.cause


def test_what_could_not_be_verified_is_tried_again_and_still_needs_an_acknowledgement():
    core = armed()
    core.lost(1.0, "the test process died")
    carry_out(core, {SafeStep.SETPOINT: 99})
    core.retry(10.0)
    assert carry_out(core, {SafeStep.SETPOINT: 1}) == list(SafeStep)
    assert core.state is State.SAFE
    core.retry(20.0)
    carry_out(core)
    assert (core.state, core.unverified, core.needs_ack) == (State.SAFE, {}, True)
    assert core.cause == "the test process died"
    core.retry(30.0)
    assert core.to_do is None


def test_a_session_that_nobody_ended_is_ended():
    core = GuardCore(SETTINGS)
    core.found(0.0, "the guard died", needs_ack=False)
    assert carry_out(core) == list(SafeStep)
    assert core.state is State.IDLE


def test_a_guard_started_again_after_a_stop_still_demands_the_acknowledgement():
    core = GuardCore(SETTINGS, stopped=True)
    with pytest.raises(LocalProtocolError):
        core.join(0.0)
    core.acknowledge(0.0, "x", "")
    core.join(1.0)


def test_every_state_can_be_left_and_reached():
    reached = {target for row in TRANSITIONS.values() for target in row.values()}
    assert reached == set(State)
    assert all(TRANSITIONS[state] for state in State)


events = st.one_of(
    st.sampled_from(["join", "leave", "lost", "found", "retry", "beat", "heed", "acknowledge", "work", "work_fails"]),
    st.tuples(st.just("see"), st.sampled_from([25.0, 96.0, -21.0, None]), st.sampled_from(["", "stalled"])),
    st.tuples(st.just("wait"), st.floats(0.1, 30.0)),
)


def happen(core, event, now_s):
    match event:
        case "join":
            core.join(now_s)
        case "leave":
            core.leave(now_s)
        case "lost":
            core.lost(now_s, "died")
        case "found":
            core.found(now_s, "found", needs_ack=False)
        case "retry":
            core.retry(now_s)
        case "beat":
            core.beat(now_s)
        case "heed":
            core.heed(now_s)
        case "acknowledge":
            core.acknowledge(now_s, "x", "")
        case "work" | "work_fails":
            if core.to_do is not None:
                core.did(core.to_do, "failed" if event == "work_fails" else "", now_s)
        case ("see", housing_c, fault):
            core.see(sample(now_s, housing_c, fault))
        case ("wait", _):
            core.tick(now_s)


@given(st.lists(events, max_size=60))
def test_whatever_happens_in_whatever_order(history):
    core, now_s = GuardCore(SETTINGS), 0.0
    for event in history:
        before, needed_ack, to_do = core.state, core.needs_ack, core.to_do
        now_s += event[1] if isinstance(event, tuple) and event[0] == "wait" else 0.01
        try:
            happen(core, event, now_s)
        except LocalProtocolError:
            assert (core.state, core.to_do) == (before, to_do)  # a refused event changes nothing
            continue
        if before is State.SAFE and core.state is not State.SAFE:
            assert event in {"acknowledge", "retry"}
            assert (core.state is State.IDLE) == (event == "acknowledge")
        if before is State.TRIPPED and core.state is State.IDLE:
            assert not needed_ack
        if before in DRIVEN and core.state not in DRIVEN:
            assert core.to_do is SafeStep.POWER_OFF  # power first, always
        assert (core.to_do is not None) == (core.state in {State.TRIPPED, State.CLOSING})
        assert (core.request is not None) == (core.state is State.HOLDING)
        if core.state is State.SAFE:
            assert core.needs_ack


@given(st.lists(st.booleans(), max_size=30), st.integers(1, 6))
def test_safe_actions_keep_their_order_and_end(outcomes, attempts):
    sequence, results, rounds = SafeSequence(attempts), iter(outcomes), [[]]
    while (step := sequence.next) is not None:
        if rounds[-1] and list(SafeStep).index(step) <= list(SafeStep).index(rounds[-1][-1]):
            rounds.append([])
        rounds[-1].append(step)
        sequence.done(step, "" if next(results, False) else "failed")
    assert rounds[0] == list(SafeStep)
    assert len(rounds) <= attempts
    for earlier, later in itertools.pairwise(rounds):
        assert set(later) < set(earlier) or set(later) == set(earlier)
    assert set(sequence.unverified) <= set(rounds[-1])
