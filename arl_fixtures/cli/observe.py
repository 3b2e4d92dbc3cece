"""`arl observe`: bags and their simulation as one observation table."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.progress import Progress

from arl_fixtures.bench.config import BenchConfig, load_bench
from arl_fixtures.bench.twins import twins_of
from arl_fixtures.errors import ConfigError, DataError
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.recording.bags import bags_in
from arl_fixtures.recording.gauge import repeatability
from arl_fixtures.recording.observe import Selection, SweptBag, observe, sweep_bag
from arl_fixtures.recording.simulated import Simulation, from_sweep, from_twin
from arl_fixtures.twin.conditions import Conditions

REGION = re.compile(r"(\d+)-(\d+)(?:/(\d+))?,(\d+)-(\d+)(?:/(\d+))?")
PATH = click.Path(path_type=Path)


@click.command("observe")
@click.argument("cycles", nargs=-1, required=True, type=PATH)
@click.option("--out", required=True, type=PATH, metavar="FILE", help="Parquet file to write")
@click.option("--bench", "bench_file", default="emulated", show_default=True, metavar="FILE", help="bench file")
@click.option("--simulation", type=PATH, metavar="FOLDER", help="bags of another simulator instead of the twin")
@click.option("--model", type=PATH, metavar="FILE", help="model.yaml: run the twin with these effects switched on")
@click.option("--gauge", type=PATH, metavar="FOLDER", help="bags of a gauge study: fills in sim_X_repeat_std")
@click.option(
    "--pixels", default="", metavar="U0-U1[/STEP],V0-V1[/STEP]", help="region and spacing of pixels; all by default"
)
def observe_command(
    cycles: tuple[Path, ...],
    out: Path,
    bench_file: str,
    simulation: Path | None,
    model: Path | None,
    gauge: Path | None,
    pixels: str,
) -> None:
    """Write the observation table of CYCLES: bag folders, or folders that hold some."""
    config = load_bench(bench_file)
    bags = [bag for folder in cycles for bag in bags_in(folder)]
    twins = Twins(config, model)
    source: Twins | Foreign = twins if simulation is None else Foreign(simulation, twins)
    repeat = repeatability([sweep_bag(bag) for bag in bags_in(gauge)]) if gauge is not None else {}
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("observing", total=len(bags))
        rows = observe(
            bags,
            out,
            source.simulate,
            config.scene,
            selection=selection(pixels),
            repeat_std=repeat,
            progress=lambda done, _total: bar.update(task, completed=done),
        )
    click.echo(f"{out}: {rows} rows of {len(bags)} bags")


def selection(text: str) -> Selection:
    """The pixels that `U0-U1[/STEP],V0-V1[/STEP]` names.

    Raises:
        ConfigError: it is of another form.
    """
    if not text:
        return Selection()
    match = REGION.fullmatch(text.replace(" ", ""))
    if match is None:
        raise ConfigError(f"--pixels '{text}': expected U0-U1[/STEP],V0-V1[/STEP], for example 0-127/4,0-31/4")
    u0, u1, du, v0, v1, dv = (int(part) if part else 1 for part in match.groups())
    if u0 > u1 or v0 > v1 or du < 1 or dv < 1:
        raise ConfigError(f"--pixels '{text}': the first pixel lies behind the last, or a step is 0")
    return Selection(first_u=u0, last_u=u1, stride_u=du, first_v=v0, last_v=v1, stride_v=dv)


class Twins:
    """The twin of each DUT of a bench, with effects switched on."""

    def __init__(self, config: BenchConfig, model: Path | None) -> None:
        self._twins = twins_of(config, model)
        self._caches = {dut.serial: GeometryCache(dut, config.scene) for dut in config.dut_settings}
        self._index = {dut.serial: number for number, dut in enumerate(config.dut_settings)}

    def cache(self, serial: str) -> GeometryCache:
        """Geometry of a DUT.

        Raises:
            DataError: the bench file does not know it.
        """
        if serial not in self._caches:
            raise DataError(f"the bags hold DUT {serial}, which the bench file does not describe")
        return self._caches[serial]

    def simulate(self, swept: SweptBag) -> Mapping[str, Simulation]:
        """The twin's simulation of a bag."""
        metadata, simulated = swept.bag.metadata, {}
        for serial, sweep in swept.sweeps.items():
            cache = self.cache(serial)
            angles = sweep.stage_angle_deg
            temperatures = {name: swept.temperature_at(name, sweep.time_ns) for name in swept.temperatures}
            missing = np.full(len(angles), np.nan)
            housing = temperatures.get(f"T{self._index[serial] + 2}", missing)
            plate, ambient = temperatures.get("plate", missing), temperatures.get("ambient", missing)
            coolant = temperatures.get("coolant", missing)
            conditions = [
                Conditions(
                    dut=serial,
                    stage_angle_deg=float(angle),
                    time_s=float(swept.time_s(sweep.time_ns[k])),
                    cycle=metadata.cycle,
                    step=metadata.step,
                    set_temperature_c=metadata.set_temperature_c,
                    ramp=metadata.ramp,
                    housing_temperature_c=float(housing[k]),
                    plate_temperature_c=float(plate[k]),
                    coolant_temperature_c=float(coolant[k]),
                    ambient_temperature_c=float(ambient[k]),
                    operating={name: float(values[k]) for name, values in sweep.operating.items()},
                )
                for k, angle in enumerate(angles)
            ]
            twin = self._twins[serial]
            simulated[serial] = from_twin(twin.renderer, cache, angles, conditions, twin.models)
        return simulated


class Foreign:
    """A second set of bags, found by cycle and step."""

    def __init__(self, folder: Path, twins: Twins) -> None:
        self._twins = twins
        self._bags = {}
        for bag in bags_in(folder):
            metadata = sweep_bag(bag).bag.metadata
            self._bags[metadata.cycle, metadata.step] = bag

    def simulate(self, swept: SweptBag) -> Mapping[str, Simulation]:
        """The simulator's bag of the same cycle and step.

        Raises:
            DataError: there is none, or it lacks a DUT.
        """
        metadata = swept.bag.metadata
        path = self._bags.get((metadata.cycle, metadata.step))
        if path is None:
            raise DataError(f"no simulated bag of cycle {metadata.cycle}, step {metadata.step}")
        simulated = sweep_bag(path).sweeps
        found = {}
        for serial, sweep in swept.sweeps.items():
            if serial not in simulated:
                raise DataError(f"{path}: holds no DUT {serial}")
            found[serial] = from_sweep(simulated[serial], sweep, self._twins.cache(serial))
        return found
