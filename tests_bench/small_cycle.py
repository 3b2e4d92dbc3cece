"""Whole small cycles in this process, in virtual time, with the plant's own word on what really happened.

Two DUTs near the hot end of the range: there a wrong reading can do most harm.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

from arl_fixtures.bench.bench import Bench
from arl_fixtures.bench.build import Emulated, open_bench
from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.config import BUILT_IN
from arl_fixtures.emulators.dut import DutEmulator
from arl_fixtures.emulators.faults import Fault
from arl_fixtures.errors import ArlError
from arl_fixtures.guard.inside import InsideGuard
from arl_fixtures.journal.record import SessionRecord, read_journal
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.plugin.cycle import CycleSession
from arl_fixtures.plugin.options import Options
from arl_fixtures.plugin.outcome import StepInvalidError
from arl_fixtures.plugin.resume import Past
from arl_fixtures.plugin.setup import SessionFiles, check_files
from arl_fixtures.twin.frame import Renderer

START_C = 80.0
EXPOSURE_S = 0.010
PERIOD_S = 0.040
LOOK_S = 2.0
SETTLE_TOLERANCE_K = 0.8
SETTLE_LIMIT_S = 400.0

BENCH = """
name: small
campaign: small
clock: virtual
chiller: {{driver: huber_pb, url: emulated, emulator: {{setpoint_start_c: 20.0}}}}
thermometer:
  driver: dcon
  url: emulated
  ambient: 0
  plate: 1
  housings: [2, 3]
  emulator: {{sources: [ambient, plate, housing_1, housing_2]}}
stage: {{driver: tmcl, url: emulated}}
relays: {{driver: conrad, url: emulated}}
duts:
  driver: hfl110
  url: emulated
  emulator: {{operating_every_frames: 2}}
  settings: {{exposure_lead_s: 0.012}}
  units: [{duts}/emulated-top.yaml, {duts}/emulated-middle.yaml]
settle: {{tolerance_k: {tolerance_k:g}, hold_s: 15, time_limit_s: {limit_s:g}}}
emulation:
  plant: {{seed: 3, thermal: {{housing_count: 2, start_c: {start_c:g}}}}}
"""
PROFILE = """
name: small
load_cycle: {temperatures_c: [81, 82.5]}
angles: {from_deg: -9, to_deg: 9, step_deg: 9}
frames: 2
reference_c: 81
"""
LIMITS = """
name: small
version: 1
limits:
  - {metric: distance_common_scatter, unit: m, upper: 10, reason: small}
"""

_RENDERERS: list[tuple[Any, Any, Renderer]] = []
_GEOMETRY: dict[str, GeometryCache] = {}
_EXPOSED: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=200))
"""When each DUT really exposed, by the emulator itself."""


class Quiet:
    """A screen that shows nothing."""

    columns = 0

    def show(self, line: str) -> None:
        """Nothing."""


@dataclass
class Watch:
    """What the plant itself says, looked at all the time.

    Attributes:
        hottest_c: of any housing, ever.
        moved: exposures of recorded frames during which the stage turned.
        lit: times at which a laser was on though the guard had stopped the bench.
    """

    hottest_c: float = float("-inf")
    moved: list[str] = field(default_factory=list)
    lit: list[float] = field(default_factory=list)


@dataclass
class Ended:
    """A cycle that is over.

    Attributes:
        record: its journal.
        out: its folder.
        world: emulators and plant as they are left.
        guard: which watched.
        watch: what the plant said.
        verdicts: step id to verdict, or to why it raised.
        over: why the session ended early; empty if it did not.
        unsafe: what could not be verified to be safe.
    """

    record: SessionRecord
    out: Path
    world: Emulated
    guard: InsideGuard
    watch: Watch
    verdicts: dict[str, str]
    over: str
    unsafe: list[str]

    @property
    def bench_s(self) -> float:
        """How long it took on the bench clock."""
        return self.world.clock.now_s

    def entries(self, kind: str) -> list[Any]:
        """All entries of a type."""
        return [line.entry for line in self.record.lines if line.entry.type == kind]


def write_files(folder: Path, *, bench: str = BENCH) -> Options:
    """Bench, profile and limits of a small cycle."""
    text = bench.format(
        duts=BUILT_IN.parent / "duts", start_c=START_C, limit_s=SETTLE_LIMIT_S, tolerance_k=SETTLE_TOLERANCE_K
    )
    for name, content in (("bench.yaml", text), ("profile.yaml", PROFILE), ("limits.yaml", LIMITS)):
        (folder / name).write_text(content, encoding="utf-8")
    return Options(
        bench=str(folder / "bench.yaml"),
        profile=str(folder / "profile.yaml"),
        limits=folder / "limits.yaml",
        out=folder / "out",
        cycles=1,
        first_cycle=None,
        resume=False,
    )


def files_for(options: Options, out: Path, known: dict[str, SessionFiles]) -> SessionFiles:
    """The files as read once, for another output folder."""
    if options.bench not in known:
        known[options.bench] = check_files(options)
    files = known[options.bench]
    return dataclasses.replace(files, options=dataclasses.replace(options, out=out))


def run_cycle(
    files: SessionFiles,
    faults: Sequence[Fault] = (),
    *,
    past: Past | None = None,
    look: Callable[[Emulated, Bench], None] = lambda _world, _bench: None,
) -> Ended:
    """One cycle from power-up to safe state, as the plugin's fixtures run it.

    Args:
        files: bench, profile, limits, output folder.
        faults: schedule, bench time from 0.
        past: what an interrupted session left.
        look: called before the session starts.
    """
    past = past or Past()
    _EXPOSED.clear()
    world = Emulated(files.bench, VirtualClock(start_s=past.start_s))
    for fault in faults:
        world.plant.faults.inject(fault)
    bench = open_bench(files.bench, world)
    guard = InsideGuard(files.bench, None)
    guard.attach(bench)
    watch = Watch()
    _watch_plant(world, guard, watch)
    bench.duts = _watched_duts(bench.duts, world, watch)
    look(world, bench)
    session = CycleSession(bench, files, files.profile.steps(0), past, screen=Quiet(), guard=guard)
    verdicts: dict[str, str] = {}
    over = ""
    try:
        session.start()
        over = measure_all(session, files, verdicts)
    except ArlError as error:
        over = f"did not start: {error}"
    finally:
        path = session.journal.path if session.journal is not None else None
        session.close(over)
        unsafe = bench.close()
        guard.close()
    world.plant.advance(world.clock.now_s)
    assert path is not None, over
    return Ended(read_journal(path), files.options.out, world, guard, watch, verdicts, over, unsafe)


def measure_all(session: CycleSession, files: SessionFiles, verdicts: dict[str, str]) -> str:
    """Every step of the cycle; returns why the session ended early, empty if it did not."""
    for step in files.profile.steps(0):
        item = SimpleNamespace(session=SimpleNamespace(shouldstop=""), user_properties=[])
        try:
            verdicts[step.id] = session.measure(step, item).verdict.value  # type: ignore[arg-type]  # what it uses
        except StepInvalidError as error:
            verdicts[step.id] = str(error)
        assert session.journal is not None
        read_journal(session.journal.path)
        if item.session.shouldstop:
            return str(item.session.shouldstop)
    return ""


def _watch_plant(world: Emulated, guard: InsideGuard, watch: Watch) -> None:
    plant, clock = world.plant, world.clock

    def look() -> None:
        plant.advance(clock.now_s)
        watch.hottest_c = max(watch.hottest_c, *plant.housing_c)
        stopped = not guard._core.driven and guard._core.to_do is None and not guard._core.unverified
        if stopped and any(plant.laser_on(dut) for dut in range(plant.dut_count)):
            watch.lit.append(clock.now_s)
        clock.at(clock.now_s + LOOK_S, look)

    look()


class _WatchedDuts:
    def __init__(self, duts: Any, world: Emulated, watch: Watch) -> None:
        self._duts, self._world, self._watch = duts, world, watch

    def collect(self, *args: Any, **options: Any) -> Any:
        """As the receiver does; then the plant is asked whether the stage stood."""
        blocks = self._duts.collect(*args, **options)
        clock, plant = self._world.clock, self._world.plant
        epoch_ns = clock.utc_ns() - round(clock.now_s * 1e9)
        for block in blocks.values():
            for time_ns in block.time_ns:
                start_s = (int(time_ns) - epoch_ns) * 1e-9
                # the receiver's estimate may be late by rows that were lost; the exposure itself counts
                true_s = max(each for each in _EXPOSED[block.dut] if each <= start_s + 1e-6)
                at_rest = plant.stage_at_rest(true_s, true_s + EXPOSURE_S)
                if start_s - true_s > PERIOD_S or not at_rest:
                    self._watch.moved.append(f"{block.dut} at {true_s:.4f} s, angle {block.stage_angle_deg}")
        return blocks

    def __getattr__(self, name: str) -> Any:
        return getattr(self._duts, name)


def _watched_duts(duts: Any, world: Emulated, watch: Watch) -> Any:
    return _WatchedDuts(duts, world, watch)


@contextlib.contextmanager
def fast() -> Iterator[None]:
    """Share between cycles what depends on no fault: rendered frames, geometry; measure a few metrics only."""

    def renderer(dut: Any, scene: Any, **options: Any) -> Renderer:
        for known_dut, known_scene, known in _RENDERERS:
            if known_dut == dut and known_scene == scene:
                return known
        made = Renderer(dut, scene, **options)
        _RENDERERS.append((dut, scene, made))
        return made

    def geometry(dut: Any, scene: Any, *_store: Any) -> GeometryCache:
        return _GEOMETRY.setdefault(dut.serial, GeometryCache(dut, scene))

    expose = DutEmulator._expose

    def exposed(dut: DutEmulator, exposure_s: float) -> Any:
        _EXPOSED[dut.renderer.dut.serial].append(exposure_s)
        return expose(dut, exposure_s)

    with (
        mock.patch.object(DutEmulator, "_expose", exposed),
        mock.patch("arl_fixtures.emulators.dut.Renderer", renderer),
        mock.patch("arl_fixtures.plugin.step_runner.GeometryCache", geometry),
    ):
        yield
