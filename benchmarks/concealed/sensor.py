"""What the case builder needs of a sensor: covariates, an expectation for any set of effects, and its nuisances."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.concealed.effect import DISTANCE, INTENSITY, Effect
from benchmarks.concealed.flash import Expected, Reality, expect, illuminate
from benchmarks.concealed.logged import DECOYS, OPTIONAL, covariates
from benchmarks.concealed.rows import SERIALS, Design, Rows, lay_out
from benchmarks.concealed.scene import FIRST_BOARD


@dataclass(slots=True, kw_only=True)
class Sensor:
    """A sensor on its rows.

    Attributes:
        columns: covariates as logged.
        answer: expectation under effects with amounts; under none it is the simulation.
        channels: the sensor's channels.
        group: rows that share a step; `sweep`: rows that share one reading.
        repeat: per channel a scale of what a group shares, as share of the signal and as absolute.
        gain_nuisance: channels whose overall gain a user calibrates; the others have their offset calibrated.
        plain: channels with neither.
        blocks: kind of held-out block -> label per row.
        pixel: labels of what a per-pixel calibration would treat alike, or None.
        make: (rng, rows, design) for the recipes of this sensor.
    """

    name: str
    columns: dict[str, np.ndarray]
    answer: Callable[[list[tuple[Effect, float]]], Expected]
    channels: tuple[str, ...]
    n_frames: np.ndarray
    group: np.ndarray
    sweep: np.ndarray
    repeat: dict[str, tuple[float, float]]
    gain_nuisance: tuple[str, ...]
    blocks: dict[str, np.ndarray]
    rows: Any
    design: Any
    plain: tuple[str, ...] = ()
    pixel: np.ndarray | None = None
    decoys: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    labels: dict[str, str] = field(default_factory=dict)
    writes_valid: bool = False


def _inside(rows: Rows) -> np.ndarray:
    """Rows whose pixel and both neighbours along the sweep see one surface, boards with circles left out."""
    alone = np.ones(len(rows), dtype=bool)
    for step in (-1, 0, 1):
        hits = illuminate(rows, Reality(), u=rows.u + step).hits
        alone &= (np.ptp(hits.surface, axis=1) == 0) & (hits.surface[:, 0] < FIRST_BOARD)
    return alone


def flash(rng: np.random.Generator, design: Design) -> Sensor:
    """The flash sensor on the bench."""
    rows = lay_out(design, rng)
    if design.inside_only:
        rows = rows.take(_inside(rows))
    footprint_rad = 0.0055 if design.smooth else 0.0
    light = illuminate(rows, Reality(footprint_rad=footprint_rad))
    sharp = illuminate(rows, Reality()) if design.smooth else light

    def answer(effects: list[tuple[Effect, float]]) -> Expected:
        reality = Reality(footprint_rad=footprint_rad)
        for effect, amount in effects:
            effect.apply(reality, amount)
        return expect(rows, reality, light)

    blocks: dict[str, np.ndarray] = {"steps": rows.step, "angles": rows.angle_deg}
    if len(design.cycles) > 1:
        blocks["cycle"] = rows.cycle
    if len(design.duts) > 1:
        blocks["dut"] = rows.dut
    return Sensor(
        name="flash",
        columns=covariates(rng, rows, design, sharp),
        answer=answer,
        channels=(INTENSITY, DISTANCE),
        n_frames=np.full(len(rows), design.n_frames),
        group=rows.group,
        sweep=rows.sweep,
        repeat={INTENSITY: (float(rng.uniform(0.001, 0.004)), 0.0), DISTANCE: (0.0, float(rng.uniform(1e-4, 5e-4)))},
        gain_nuisance=(INTENSITY,),
        blocks=blocks,
        rows=rows,
        design=design,
        pixel=(rows.dut * 200 + rows.v) * 200 + rows.u,
        decoys=DECOYS,
        optional=OPTIONAL,
        labels={f"#{k}": name for k, name in enumerate(SERIALS)},
        writes_valid=True,
    )
