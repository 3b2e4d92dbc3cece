"""Concealed effects of laser, supply and beam on the flash sensor."""

import numpy as np

from benchmarks.concealed.designs import ageing, sparse
from benchmarks.concealed.effect import FIELD, HOT, INTENSITY, Effect, wide
from benchmarks.concealed.flash import Light, Reality, nominal_beam
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.rows import Design, Rows


def _thermal_rolloff(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    drive = wide(rng, 2.0, 6.0)  # current over threshold at 25 °C

    def apply(reality: Reality, amount: float) -> None:
        def power(rows: Rows, light: Light) -> np.ndarray:
            heat = rows.node_c["laser"] - 25.0
            return np.maximum(drive - np.exp(amount * heat), 0.02) / (drive - 1.0)

        reality.transmission.append(power)

    free = design.laser_program_k > 0
    return Effect(
        effect="laser.thermal_rolloff",
        apply=apply,
        channels=(INTENSITY,),
        start=0.01,
        limit=0.2,
        drivers=("laser_temperature_c",) if free else HOT,
        needs=("laser_temperature_c",),
        unseen=("steps", "dut", "angles"),
        equivalents=() if free else ("detector.gain_temperature",),
    )


def _power_decay(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    # every emitter of the array has its own rate: the sum decays by no single law
    rates = np.exp(rng.normal(0.0, rng.uniform(0.3, 1.2), size=400))
    rates /= rates.mean()
    last = max(design.cycles)

    def apply(reality: Reality, amount: float) -> None:
        def power(rows: Rows, light: Light) -> np.ndarray:
            age, back = np.unique(rows.cycle, return_inverse=True)
            return np.exp(-amount * rates[None, :] * (age[:, None] / last)).mean(axis=1)[back]

        reality.transmission.append(power)

    return Effect(
        effect="laser.power_decay",
        apply=apply,
        channels=(INTENSITY,),
        start=0.01,
        limit=1.0,
        drivers=("cycle",),
        needs=("cycle",),
        unseen=("cycle", "steps", "angles"),
    )


def _energy_jitter(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    def apply(reality: Reality, amount: float) -> None:
        def widen(rows: Rows, channel: str, std: np.ndarray, intensity: np.ndarray) -> np.ndarray:
            return np.hypot(std, amount * intensity) if channel == INTENSITY else std

        reality.noise.append(widen)

    return Effect(
        effect="laser.pulse_energy_jitter",
        apply=apply,
        channels=("intensity_counts_std", INTENSITY),
        kind="scatter",
        nature="sweep",
        common_scale=lambda expected, amount: amount * expected,
        drivers=("sim_intensity_counts", "reflectance", "surface", "sim_intensity_counts_std"),
        start=0.003,
        limit=0.1,
        needs=("intensity_counts_std",),
        unseen=("steps", "angles"),
        calibrations=("none",),
    )


def _rail_coupling(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    def apply(reality: Reality, amount: float) -> None:
        reality.transmission.append(lambda rows, light: 1.0 + amount * (rows.rail - 1.0))

    return Effect(
        effect="electronics.rail_coupling",
        apply=apply,
        channels=(INTENSITY,),
        drivers=(design.rail_name,),
        start=0.3,
        limit=20.0,
        needs=(design.rail_name,),
        unseen=("steps", "angles"),
    )


def _profile_shift(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    bearing = rng.uniform(0, 2 * np.pi)
    across, up = np.cos(bearing), np.sin(bearing)

    def apply(reality: Reality, amount: float) -> None:
        def beam(rows: Rows, azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
            moved = amount * (rows.node_c["laser"] * 0 + rows.node_c["housing"] - 25.0) / 50.0
            return nominal_beam(azimuth - across * moved, elevation - up * moved)

        reality.beam.append(beam)

    return Effect(
        effect="beam.profile_shift",
        apply=apply,
        channels=(INTENSITY,),
        drivers=(*HOT, *FIELD),
        start=0.1,
        limit=5.0,
        needs=FIELD,
        unseen=("steps", "angles"),
        calibrations=("none", "global", "pixel"),
    )


def _profile_change(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    last = max(design.cycles)
    hollow = rng.random() < 0.4

    def apply(reality: Reality, amount: float) -> None:
        def beam(rows: Rows, azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
            age = amount * rows.cycle / last
            if hollow:  # the centre of the diffuser wears first
                radius = (azimuth / 60.0) ** 2 + (elevation / 14.0) ** 2
                return nominal_beam(azimuth, elevation) * (1.0 - age * np.exp(-3.0 * radius))
            return nominal_beam(azimuth * (1 + age), elevation * (1 + 0.7 * age))

        reality.beam.append(beam)

    return Effect(
        effect="beam.profile_change",
        apply=apply,
        channels=(INTENSITY,),
        drivers=("cycle", *FIELD),
        start=0.02,
        limit=0.6,
        needs=(*FIELD, "cycle"),
        unseen=("steps", "angles", "cycle"),
        calibrations=("none", "global"),
    )


RECIPES = (
    Recipe(
        "laser.thermal_rolloff",
        lambda r: sparse(r, laser_program_k=float(r.choice([0.0, 8.0, 10.0], p=[0.2, 0.4, 0.4]))),
        _thermal_rolloff,
    ),
    Recipe("laser.power_decay", ageing, _power_decay),
    Recipe("laser.pulse_energy_jitter", sparse, _energy_jitter),
    Recipe("electronics.rail_coupling", lambda r: sparse(r, rail_wander=wide(r, 0.005, 0.02)), _rail_coupling),
    Recipe("beam.profile_shift", lambda r: sparse(r, pixels=40, angles=7), _profile_shift),
    Recipe("beam.profile_change", lambda r: ageing(r, pixels=40, angles=5, steps=6), _profile_change),
)
