"""Session fixtures: the bench, its devices, the twin, and the cycle that runs on them.

Imports stand inside the fixtures: a pytest session that uses none of them must not pay for numpy and its friends.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from arl_fixtures.bench.bench import Bench, Duts
    from arl_fixtures.bench.profile import CycleStep
    from arl_fixtures.bench.twins import Twin
    from arl_fixtures.devices.interfaces import Chiller, Relays, Stage, Thermometer
    from arl_fixtures.devices.port import Clock
    from arl_fixtures.guard.guarding import Guard
    from arl_fixtures.plugin.cycle import CycleSession, StepOutcome
    from arl_fixtures.plugin.resume import Past
    from arl_fixtures.plugin.setup import SessionFiles


@pytest.fixture(scope="session")
def bench_files(pytestconfig: pytest.Config) -> SessionFiles:
    """Bench, profile and limits of the session, checked."""
    from arl_fixtures.plugin.options import allure_folder, read_options
    from arl_fixtures.plugin.setup import SESSION_KEY, check_files

    if SESSION_KEY not in pytestconfig.stash:
        pytestconfig.stash[SESSION_KEY] = check_files(read_options(pytestconfig), allure_folder(pytestconfig))
    return pytestconfig.stash[SESSION_KEY]


@pytest.fixture(scope="session")
def past(bench_files: SessionFiles) -> Past:
    """What an interrupted session left, with `--resume`; else nothing."""
    from arl_fixtures.plugin.resume import Past

    return Past.of(bench_files.options.out, resume=bench_files.options.resume)


@pytest.fixture(scope="session")
def guard(request: pytest.FixtureRequest, bench_files: SessionFiles) -> Iterator[Guard]:
    """Who makes the bench safe when nobody else can: a process of its own, or inside where all is emulated."""
    from arl_fixtures.errors import ArlError
    from arl_fixtures.guard.guarding import open_guard

    options = bench_files.options
    try:
        guard = open_guard(bench_files.bench, bench_file=options.bench, lab=options.lab)
    except ArlError:
        request.session.shouldstop = "the bench may not be driven, no step is run"
        raise
    yield guard
    guard.close()


@pytest.fixture(scope="session")
def bench(
    request: pytest.FixtureRequest, bench_files: SessionFiles, past: Past, guard: Guard
) -> Iterator[Bench]:
    """The bench of `--bench`, opened and guarded. However the session ends, it is left safe."""
    from arl_fixtures.bench.build import open_bench
    from arl_fixtures.errors import ArlError

    try:
        bench = open_bench(bench_files.bench, guard.lines, start_s=past.start_s)
        guard.attach(bench)
    except ArlError:
        # without a bench no test can run: say so once
        request.session.shouldstop = "no bench, no step is run"
        raise
    yield bench
    faults = bench.close()
    if faults:
        raise ArlError("the bench could NOT be verified to be safe: " + "; ".join(faults))


@pytest.fixture(scope="session")
def clock(bench: Bench) -> Clock:
    """The bench clock, real or virtual."""
    return bench.clock


@pytest.fixture(scope="session")
def chiller(bench: Bench) -> Chiller:
    """The chiller."""
    return bench.chiller


@pytest.fixture(scope="session")
def thermometer(bench: Bench) -> Thermometer:
    """The thermocouple logger."""
    return bench.thermometer


@pytest.fixture(scope="session")
def stage(bench: Bench) -> Stage:
    """The rotary stage."""
    return bench.stage


@pytest.fixture(scope="session")
def relays(bench: Bench) -> Relays:
    """The relays."""
    return bench.relays


@pytest.fixture(scope="session")
def duts(bench: Bench) -> Duts:
    """The receiver of all DUTs' frames."""
    return bench.duts


@pytest.fixture(scope="session")
def twin(bench_files: SessionFiles) -> dict[str, Twin]:
    """The simulation of each DUT by serial number: the nominal model, and the effects the bench file switches on."""
    from arl_fixtures.bench.twins import twins_of

    return twins_of(bench_files.bench)


@pytest.fixture(scope="session")
def cycle_session(
    request: pytest.FixtureRequest, bench: Bench, bench_files: SessionFiles, past: Past, guard: Guard
) -> Iterator[CycleSession]:
    """The cycle under way: bench started, reference recorded, journal open."""
    from arl_fixtures.errors import ArlError
    from arl_fixtures.plugin.cycle import CycleSession
    from arl_fixtures.plugin.progress import PytestScreen

    plan = planned_steps(request.session.items)
    session = CycleSession(bench, bench_files, plan, past, screen=PytestScreen(request.config), guard=guard)
    try:
        session.start()
    except BaseException as error:
        session.close(f"did not start: {error or type(error).__name__}")
        if isinstance(error, ArlError):
            request.session.shouldstop = "the cycle cannot start, no step is run"
        raise
    yield session
    session.close(str(request.session.shouldstop or ""))


@pytest.fixture
def step_outcome(
    request: pytest.FixtureRequest, cycle_session: CycleSession, cycle_step: CycleStep
) -> StepOutcome:
    """The temperature step of this test: settled, swept, recorded, measured and judged.

    Raises:
        StepInvalidError: it could not be measured.
    """
    return cycle_session.measure(cycle_step, request.node)


def planned_steps(items: list[pytest.Item]) -> list[CycleStep]:
    """The temperature steps of this session, in the order of its tests."""
    found = [getattr(item, "callspec", None) for item in items if item.get_closest_marker("cycle")]
    return [spec.params["cycle_step"] for spec in found if spec is not None and "cycle_step" in spec.params]
