"""Bags and the twin's simulation of them as one observation table.

A row is one pixel at one stage angle of one step of one DUT, averaged over that angle's frames. Rows are written
angle by angle, so memory does not grow with the number of bags.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.statistics import SweepStatistics, SweepSummary
from arl_fixtures.recording.reader import StepBag
from arl_fixtures.recording.simulated import Simulation
from arl_fixtures.twin.scene import SceneSettings

ROWS_PER_GROUP: Final = 262_144
CHANNELS: Final = ("intensity_counts", "distance_m")
TEMPERATURES: Final = {
    "ambient": "ambient_temperature_c",
    "plate": "plate_temperature_c",
    "coolant": "coolant_temperature_c",
    "setpoint": "setpoint_temperature_c",
}

Column = npt.NDArray[Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """Which pixels become rows: a region, and every so-manieth of it. Ends are included."""

    first_u: int = 0
    last_u: int | None = None
    stride_u: int = 1
    first_v: int = 0
    last_v: int | None = None
    stride_v: int = 1

    def pixels(self, height: int, width: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """(v, u) of the selected pixels, image order.

        Raises:
            DataError: nothing is selected.
        """
        last_v = height - 1 if self.last_v is None else min(self.last_v, height - 1)
        last_u = width - 1 if self.last_u is None else min(self.last_u, width - 1)
        v, u = np.meshgrid(
            np.arange(self.first_v, last_v + 1, self.stride_v),
            np.arange(self.first_u, last_u + 1, self.stride_u),
            indexing="ij",
        )
        if v.size == 0:
            raise DataError(f"no pixel of the {width} × {height} image lies in the chosen region")
        return v.ravel(), u.ravel()


@dataclass(frozen=True, slots=True)
class SweptBag:
    """One bag, reduced: its identity, a summary per DUT, and its temperatures as (nanoseconds, °C) by name."""

    bag: StepBag
    sweeps: Mapping[str, SweepSummary]
    temperatures: Mapping[str, tuple[Column, Column]] = field(default_factory=dict)
    cycle_start_ns: int = 0

    def temperature_at(self, name: str, time_ns: Column) -> Column:
        """A sensor's temperature at some times, °C, linear between its readings."""
        at_ns, value_c = self.temperatures[name]
        return np.asarray(np.interp(time_ns.astype(float), at_ns.astype(float), value_c), dtype=np.float32)

    def time_s(self, time_ns: Column) -> Column:
        """Seconds since the start of the cycle."""
        return np.asarray((time_ns - self.cycle_start_ns) * 1e-9)


def sweep_bag(path: Path) -> SweptBag:
    """Read one bag and reduce it.

    Raises:
        DataError: the bag cannot be used.
    """
    bag = StepBag(path)
    statistics = {serial: SweepStatistics(serial) for serial in bag.metadata.duts}
    for block in bag.blocks():
        statistics[block.dut].add(block)
    temperatures = {}
    for name, series in bag.temperatures_c.items():
        time_ns, value_c = np.array([t for t, _ in series], dtype=np.int64), np.array([c for _, c in series])
        temperatures[name] = (time_ns, value_c)
    return SweptBag(bag, {serial: each.summary() for serial, each in statistics.items() if len(each)}, temperatures)


def observe(
    bags: Sequence[Path],
    out: Path,
    simulation: Callable[[SweptBag], Mapping[str, Simulation]],
    scene: SceneSettings,
    *,
    selection: Selection | None = None,
    repeat_std: Mapping[str, float] | None = None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> int:
    """Write the observation table of some bags.

    Args:
        bags: bag folders, any number of cycles.
        out: Parquet file to write; it appears only when it is whole.
        simulation: gives, for a bag, the simulation of each DUT at its sweep's angles.
        scene: names the surfaces.
        selection: which pixels.
        repeat_std: channel to scatter of the bench between repeated steps, from a gauge study: relative for
            the intensity (share of the value), metres for the distance.
        progress: called with (bags done, bags).

    Returns:
        number of rows.

    Raises:
        DataError: a bag cannot be used, or there is nothing to write.
    """
    if not bags:
        raise DataError("no bags were given")
    chosen = selection or Selection()
    starts_ns = _cycle_starts_ns(bags)
    part = out.with_name(out.name + ".part")
    rows = 0
    writer: pq.ParquetWriter | None = None
    try:
        for done, path in enumerate(bags):
            swept = sweep_bag(path)
            swept = replace(swept, cycle_start_ns=starts_ns[swept.bag.metadata.cycle])
            for serial, simulated in simulation(swept).items():
                for table in _tables(swept, serial, simulated, scene, chosen, repeat_std or {}):
                    if writer is None:
                        part.parent.mkdir(parents=True, exist_ok=True)
                        writer = pq.ParquetWriter(part, table.schema, compression="zstd")
                    writer.write_table(table.cast(writer.schema), row_group_size=ROWS_PER_GROUP)
                    rows += table.num_rows
            progress(done + 1, len(bags))
        if writer is None:
            raise DataError("the bags hold no frames")
        writer.close()
        part.rename(out)
    except BaseException:
        if writer is not None:
            writer.close()
        part.unlink(missing_ok=True)
        raise
    return rows


def _cycle_starts_ns(bags: Iterable[Path]) -> dict[int, int]:
    starts: dict[int, int] = {}
    for path in bags:
        metadata = StepBag(path).metadata
        starts[metadata.cycle] = min(starts.get(metadata.cycle, metadata.started_utc_ns), metadata.started_utc_ns)
    return starts


def _tables(
    swept: SweptBag,
    serial: str,
    simulated: Simulation,
    scene: SceneSettings,
    selection: Selection,
    repeat_std: Mapping[str, float],
) -> Iterable[pa.Table]:
    """Tables of some angles each, so that a full-resolution sweep is never one table."""
    sweep = swept.sweeps[serial]
    v, u = selection.pixels(*sweep.shape)
    angles_at_once = max(1, ROWS_PER_GROUP // v.size)
    signals = sorted(sweep.operating)
    number = list(swept.bag.metadata.duts).index(serial)
    for first in range(0, len(sweep.stage_angle_deg), angles_at_once):
        angles = slice(first, min(first + angles_at_once, len(sweep.stage_angle_deg)))
        count = angles.stop - angles.start
        per_angle = _angle_columns(swept, serial, number, angles)
        columns: dict[str, Column | pa.Array] = {
            name: np.repeat(values, v.size) for name, values in (per_angle | _signals(sweep, signals, angles)).items()
        }
        columns |= {"pixel_u": np.tile(u, count).astype(np.int16), "pixel_v": np.tile(v, count).astype(np.int16)}
        columns |= _channel_columns(sweep, simulated, angles, v, u)
        geometry = simulated.geometry
        columns["surface"] = pa.DictionaryArray.from_arrays(
            geometry.surface[angles, v, u].ravel().astype(np.int8), pa.array(scene.surface_names)
        )
        columns["mixed"] = geometry.mixed[angles, v, u].ravel()
        columns["true_range_m"] = geometry.true_range_m[angles, v, u].ravel()
        columns["incidence_deg"] = np.degrees(np.arccos(np.clip(geometry.cos_incidence[angles, v, u], -1, 1))).ravel()
        columns["reflectance"] = geometry.reflectance[angles, v, u].ravel()
        columns["azimuth_deg"] = np.tile(geometry.azimuth_deg[v, u].astype(np.float32), count)
        columns["elevation_deg"] = np.tile(geometry.elevation_deg[v, u].astype(np.float32), count)
        for channel, scatter in repeat_std.items():
            level = columns[f"sim_{channel}"] if channel.endswith("_counts") else np.ones(v.size * count, np.float32)
            columns[f"sim_{channel}_repeat_std"] = (scatter * level).astype(np.float32)
        yield pa.table(columns)


def _angle_columns(swept: SweptBag, serial: str, number: int, angles: slice) -> dict[str, Column]:
    metadata, sweep = swept.bag.metadata, swept.sweeps[serial]
    time_ns = sweep.time_ns[angles]
    count = len(time_ns)
    columns: dict[str, Column] = {
        "dut": np.full(count, serial, dtype=object),
        "cycle": np.full(count, metadata.cycle, np.int32),
        "step": np.full(count, metadata.step, np.int32),
        "set_temperature_c": np.full(count, metadata.set_temperature_c, np.float32),
        "ramp": np.full(count, metadata.ramp, np.int8),
        "time_s": swept.time_s(time_ns),
        "stage_angle_deg": sweep.stage_angle_deg[angles],
    }
    named = {**TEMPERATURES, f"T{number + 2}": "housing_temperature_c"}
    for name, column in named.items():
        if name in swept.temperatures:
            columns[column] = swept.temperature_at(name, time_ns)
    return columns


def _signals(sweep: SweepSummary, signals: Sequence[str], angles: slice) -> dict[str, Column]:
    return {name: sweep.operating[name][angles].astype(np.float32) for name in signals}


def _channel_columns(
    sweep: SweepSummary, simulated: Simulation, angles: slice, v: Column, u: Column
) -> dict[str, Column]:
    def flat(values: Column) -> Column:
        return values[angles, v, u].ravel()

    mean = sweep.intensity_counts[angles, v, u]
    common = np.maximum(sweep.intensity_common_variance - sweep.intensity_common_floor, 0.0)[angles, None]
    intensity_std = np.sqrt(sweep.intensity_variance[angles, v, u] + common * mean * mean)
    shared = np.maximum(sweep.distance_common_variance - sweep.distance_common_floor, 0.0)[angles, None]
    distance_std = np.sqrt(sweep.distance_variance[angles, v, u] + shared)
    arrived = np.maximum(flat(sweep.arrived), 1)
    returns = flat(sweep.distance_returns)
    return {
        "intensity_counts": mean.ravel(),
        "distance_m": flat(sweep.distance_m),
        "intensity_counts_std": intensity_std.ravel().astype(np.float32),
        "distance_m_std": distance_std.ravel().astype(np.float32),
        "valid_fraction": (returns / arrived).astype(np.float32),
        "sim_intensity_counts": flat(simulated.intensity_counts),
        "sim_distance_m": flat(simulated.distance_m),
        "sim_intensity_counts_std": flat(simulated.intensity_std_counts),
        "sim_distance_m_std": flat(simulated.distance_std_m),
        "sim_valid_fraction": flat(simulated.valid_fraction),
        "n_frames": np.maximum(returns, 1).astype(np.int16),
    }
