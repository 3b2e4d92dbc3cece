"""Session fixtures: the bench, its devices, the twin, and the cycle that runs on them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from arl_fixtures.bench.bench import Bench, Duts
from arl_fixtures.bench.build import open_bench
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.devices.interfaces import Chiller, Relays, Stage, Thermometer
from arl_fixtures.devices.port import Clock
from arl_fixtures.errors import ArlError
from arl_fixtures.plugin.cycle import CycleSession
from arl_fixtures.plugin.options import allure_folder, read_options
from arl_fixtures.plugin.setup import SESSION_KEY, SessionFiles, check_files
from arl_fixtures.plugin.step_runner import StepResult
from arl_fixtures.twin.frame import Renderer


@pytest.fixture(scope="session")
def bench_files(pytestconfig: pytest.Config) -> SessionFiles:
    """Bench, profile and limits of the session, checked."""
    if SESSION_KEY not in pytestconfig.stash:
        pytestconfig.stash[SESSION_KEY] = check_files(read_options(pytestconfig), allure_folder(pytestconfig))
    return pytestconfig.stash[SESSION_KEY]


@pytest.fixture(scope="session")
def bench(request: pytest.FixtureRequest, bench_files: SessionFiles) -> Iterator[Bench]:
    """The bench of `--bench`, opened. However the session ends, it is left safe."""
    try:
        bench = open_bench(bench_files.bench)
    except ArlError as error:
        # without a bench no test can run: say so once
        request.session.shouldstop = f"no bench: {error}"
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
def twin(bench_files: SessionFiles) -> dict[str, Renderer]:
    """The nominal simulation of each DUT, by serial number."""
    config = bench_files.bench
    return {dut.serial: Renderer(dut, config.scene) for dut in config.dut_settings}


@pytest.fixture(scope="session")
def cycle_session(
    request: pytest.FixtureRequest, bench: Bench, bench_files: SessionFiles
) -> Iterator[CycleSession]:
    """The cycle under way: bench started, reference recorded, journal open."""
    steps_total = sum(1 for item in request.session.items if item.get_closest_marker("cycle"))
    terminal: Any = request.config.pluginmanager.get_plugin("terminalreporter")
    session = CycleSession(bench, bench_files, steps_total=steps_total, terminal=terminal)
    try:
        session.start()
    except ArlError as error:
        request.session.shouldstop = f"the cycle cannot start: {error}"
        session.close()
        raise
    yield session
    session.close()


@pytest.fixture
def step_result(
    request: pytest.FixtureRequest,
    cycle_session: CycleSession,
    cycle_step: CycleStep,
    record_property: Any,  # noqa: ANN401 - pytest gives a function of its own type
) -> StepResult:
    """The temperature step of this test: settled, swept, recorded, measured and judged.

    Raises:
        StepInvalidError: it could not be measured.
    """
    return cycle_session.measure(cycle_step, request.node, record_property)
