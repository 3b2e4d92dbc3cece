"""A multi-zone photon-counting sensor: expected histograms from rate equations, then counts and centroid of the peak.

The simulation beside it counts every photon (no dead time, no dark counts, equal bins); what differs in reality acts
on the rates or on the bins, never on the answer.
"""

from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.effect import DIE, DISTANCE, INTENSITY, Effect, Parameter, sign, wide
from benchmarks.concealed.flash import Expected
from benchmarks.concealed.hooks import Hooks, answering
from benchmarks.concealed.point_sensor import BRIGHT, FAR
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.sensor import Sensor

BIN_M, BINS, PULSES = 0.02, 96, 40_000
NEAR = 12  # bins either side of the peak that its centroid takes: what lies beyond would pull it to and fro by bins
CHAMBER = (*DIE, "ambient_temperature_c", "step", "time_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoneRows:
    """Arrays of equal length: zone (0…8), range along its ray, reflectance, die temperature, step."""

    zone: np.ndarray
    range_m: np.ndarray
    reflectance: np.ndarray
    die_c: np.ndarray
    step: np.ndarray
    photons: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoneDesign:
    """Target distances, reflectances and temperatures, all combined for nine zones."""

    range_m: np.ndarray
    reflectances: tuple[float, ...]
    chamber_c: tuple[float, ...]
    photons: float
    n_frames: int


def zones_before_target(rng: np.random.Generator, *, temperatures: int = 5, distances: int = 40) -> ZoneDesign:
    """A flat target at many distances."""
    return ZoneDesign(
        range_m=np.sort(rng.uniform(0.10, 1.4, size=distances)),
        reflectances=(0.18, 0.88),
        chamber_c=tuple(np.linspace(0, 60, temperatures)),
        photons=wide(rng, 2e-3, 1e-2),
        n_frames=int(rng.choice([1, 4, 8])),
    )


def _model(rows: ZoneRows, hooks: Hooks) -> Expected:
    edges = hooks.run("edges", rows, np.arange(BINS + 1) * BIN_M * np.ones((rows.zone.size, 1)))
    centre = hooks.run("timing", rows, rows.range_m.astype(float))
    # a late clock moves the pulse in the histogram, not the target
    distance = np.maximum(rows.range_m, 0.08)
    signal = rows.photons * rows.reflectance / distance**2 / (1 + 0.1 * ((rows.zone % 2) == 0))

    # a gain-switched emitter: fast rise, slower tail; the share of each bin by its cumulative form
    def cumulative(x: np.ndarray) -> np.ndarray:
        s = (x - centre[:, None]) / 0.03
        return 1.0 / (1.0 + np.exp(-np.clip(np.where(s < 0, 2.2 * s, 1.3 * s), -60, 60)))

    rate = signal[:, None] * np.diff(cumulative(edges), axis=1)
    rate = hooks.run("rate", rows, rate)
    share = hooks.run("counting", rows, rate)
    histogram = PULSES * share
    counts = histogram.sum(axis=1)
    middle = (np.arange(BINS) + 0.5) * BIN_M
    peak = np.argmax(rate, axis=1)
    near = np.abs(np.arange(BINS)[None, :] - peak[:, None]) <= NEAR
    weight = np.maximum(histogram - np.median(histogram, axis=1)[:, None], 0.0) * near
    centroid = (weight @ middle) / np.maximum(weight.sum(axis=1), 1e-9)
    std = {INTENSITY: np.sqrt(counts + 25.0), DISTANCE: 0.045 / np.sqrt(np.maximum(weight.sum(axis=1), 1.0)) + 2e-4}
    return Expected({INTENSITY: counts, DISTANCE: centroid}, std, (counts > 10).astype(float))


def zones(rng: np.random.Generator, design: ZoneDesign) -> Sensor:
    """The sensor's nine zones on all combinations of the design."""
    t, f, d, z = (
        x.ravel()
        for x in np.meshgrid(
            np.array(design.chamber_c), np.array(design.reflectances), design.range_m, np.arange(9), indexing="ij"
        )
    )
    slant = np.hypot(1.0, np.hypot(np.tan(np.radians(9.0)) * (z % 3 - 1), np.tan(np.radians(9.0)) * (z // 3 - 1)))
    _, step = np.unique(t, return_inverse=True)
    rows = ZoneRows(
        zone=z.astype(int), range_m=d * slant, reflectance=f, die_c=t + 12.0, step=step, photons=design.photons
    )
    size = z.size
    columns = {
        "zone": rows.zone,
        "step": step,
        "true_range_m": rows.range_m,
        "reflectance": f,
        "tof_temperature_c": np.round(rows.die_c + rng.normal(0, 0.2, size), 1),
        "ambient_temperature_c": np.round(t + rng.normal(0, 0.2, size), 1),
        "reference_counts": np.round(2.3e5 * (1 + rng.normal(0, 2e-3, size))),
        "time_s": 2.0 * np.arange(size),
    }
    return Sensor(
        name="zones",
        columns=columns,
        answer=answering(_model, rows),
        channels=(INTENSITY, DISTANCE),
        n_frames=np.full(size, design.n_frames),
        group=step,
        sweep=np.arange(size),
        repeat={INTENSITY: (0.002, 0.0), DISTANCE: (0.0, 2e-4)},
        gain_nuisance=(INTENSITY,),
        blocks={"steps": step, "distances": np.digitize(d, np.linspace(0.1, 1.4, 14)), "zones": rows.zone},
        rows=rows,
        design=design,
        decoys=("reference_counts", "ambient_temperature_c"),
        optional=("time_s",),
    )


def _dead_time(rng: np.random.Generator, rows: ZoneRows, design: ZoneDesign) -> Effect:
    def apply(hooks: Hooks, amount: float) -> None:
        def first_wins(rows: ZoneRows, rate: np.ndarray) -> np.ndarray:
            # a share `amount` of the counts comes from cells that fire once per pulse
            flux = rate * 25.0 * amount
            before = np.cumsum(flux, axis=1) - flux
            chance = np.exp(-before) * -np.expm1(-flux)
            return np.where(flux > 1e-12, rate * chance / np.maximum(flux, 1e-12), rate)

        hooks.add("counting", first_wins)

    return Effect(
        effect="detector.pile_up",
        unless_seen=((DISTANCE, "detector.compression"), (INTENSITY, "timing.range_walk")),
        apply=apply,
        channels=(INTENSITY, DISTANCE),
        drivers=BRIGHT,
        start=0.02,
        limit=10.0,
        unseen=("steps", "distances", "zones"),
    )


def _dark(rng: np.random.Generator, rows: ZoneRows, design: ZoneDesign) -> Effect:
    doubling_k = wide(rng, 7.0, 12.0)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add(
            "rate", lambda rows, r: r + (amount * 2.0 ** ((rows.die_c - 72.0) / doubling_k) / BINS / PULSES)[:, None]
        )

    return Effect(
        effect="detector.dark_offset",
        apply=apply,
        channels=(INTENSITY,),
        drivers=CHAMBER,
        start=3.0,
        limit=5e3,
        unseen=("distances", "zones"),
        parameters=lambda a: (Parameter(pattern="doubling|double", value=doubling_k, unit="K"),),
    )


def _unequal_bins(rng: np.random.Generator, rows: ZoneRows, design: ZoneDesign) -> Effect:
    taps = int(rng.choice([8, 12, 16]))
    widths = 1 + 0.3 * np.sin(2 * np.pi * np.arange(taps) / taps + rng.uniform(0, 6.28)) + 0.1 * rng.normal(size=taps)
    widths = (widths / widths.mean())[np.arange(BINS) % taps]

    def apply(hooks: Hooks, amount: float) -> None:
        real = np.concatenate([[0.0], np.cumsum(1 + amount * (widths - 1))]) * BIN_M
        hooks.add("edges", lambda rows, e: np.broadcast_to(real, e.shape))

    return Effect(
        effect="timing.tdc_nonlinearity",
        apply=apply,
        channels=(DISTANCE, INTENSITY),
        drivers=FAR,
        start=0.05,
        limit=2.0,
        unseen=("steps",),
        parameters=lambda a: (Parameter(pattern="period", value=taps * BIN_M, unit="m"),),
    )


def _delay(rng: np.random.Generator, rows: ZoneRows, design: ZoneDesign) -> Effect:
    way = sign(rng)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("timing", lambda rows, d: d + way * amount * (rows.die_c - 37.0))

    return Effect(
        effect="timing.temperature_offset",
        apply=apply,
        channels=(DISTANCE,),
        drivers=CHAMBER,
        start=1e-5,
        limit=1e-3,
        unseen=("distances", "zones"),
    )


def _zone_fade(rng: np.random.Generator, rows: ZoneRows, design: ZoneDesign) -> Effect:
    gains = rng.normal(size=9)

    def apply(hooks: Hooks, amount: float) -> None:
        def heat(rows: ZoneRows, rate: np.ndarray) -> np.ndarray:
            return rate * (1 + amount * gains[rows.zone] * (rows.die_c - 42.0) / 30.0)[:, None]

        hooks.add("rate", heat)

    return Effect(
        effect="unknown",
        nature="zone gains drift apart with temperature",
        apply=apply,
        channels=(INTENSITY,),
        start=0.005,
        limit=0.3,
        drivers=("zone", *CHAMBER),
        unseen=("distances",),
        needs=("zone",),
    )


RECIPES = (
    Recipe("detector.pile_up", zones_before_target, _dead_time, "zones"),
    Recipe("detector.dark_offset", lambda r: zones_before_target(r, temperatures=9, distances=24), _dark, "zones"),
    Recipe(
        "timing.tdc_nonlinearity",
        lambda r: zones_before_target(r, temperatures=3, distances=90),
        _unequal_bins,
        "zones",
    ),
    Recipe("timing.temperature_offset", lambda r: zones_before_target(r, temperatures=8), _delay, "zones"),
)
UNKNOWN = (Recipe("unknown", zones_before_target, _zone_fade, "zones"),)
