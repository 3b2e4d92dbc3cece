"""The flash sensor on the bench, forward: poses and temperatures to expected intensity, distance and scatter.

`Reality` lists what reality does beyond the nominal model, stage by stage in the order light and signal pass:
pose → rays → surfaces → beam and laser → window and optics → detector → timing → read-out. Every stage is a list of
functions; with all lists empty the result is the nominal model itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.concealed.rows import Rows
from benchmarks.concealed.scene import (
    ARC_M,
    DUT_HEIGHT_M,
    Hits,
    block_centres,
    field_angles_deg,
    pixel_rays,
    to_chamber,
    trace,
    turn,
)

G_COUNTS = 4000.0
FLOOR_COUNTS = 30.0
THIRD = np.array([-1.0, 0.0, 1.0]) / 3.0
OFFSET_U, OFFSET_V = (a.ravel() for a in np.meshgrid(THIRD, THIRD))

PerRow = Callable[[Rows], np.ndarray]


@dataclass(slots=True)
class Light:
    """Optical signal of rows: `weight` (N, S) of each sub-ray in counts, its `range_m`, the pixel's field angles."""

    weight: np.ndarray
    hits: Hits
    azimuth_deg: np.ndarray
    elevation_deg: np.ndarray

    @property
    def counts(self) -> np.ndarray:
        return self.weight.mean(axis=1)


@dataclass(slots=True)
class Reality:
    """What happens beyond the nominal model; see the module for the order.

    `footprint_rad` is no mismatch but a property of the renderer, of simulation and reality alike: zero samples a
    pixel by its nine rays, else every ray stands for a beamlet of that width, and edges pass smoothly. `frames` is
    when frames were taken: see `_over_frames`.
    """

    footprint_rad: float = 0.0
    stage_deg: list[PerRow] = field(default_factory=list)
    origin_m: list[PerRow] = field(default_factory=list)
    tilt_deg: list[PerRow] = field(default_factory=list)
    focal: list[PerRow] = field(default_factory=list)
    blur_px: list[PerRow] = field(default_factory=list)
    beam: list[Callable[[Rows, np.ndarray, np.ndarray], np.ndarray]] = field(default_factory=list)
    surface: list[Callable[[Rows, Hits], np.ndarray]] = field(default_factory=list)
    transmission: list[Callable[[Rows, Light], np.ndarray]] = field(default_factory=list)
    stray: list[Callable[[Rows, np.ndarray], np.ndarray]] = field(default_factory=list)
    electronics: list[Callable[[Rows, np.ndarray], np.ndarray]] = field(default_factory=list)
    mixing: list[Callable[[Rows, Light, np.ndarray], np.ndarray]] = field(default_factory=list)
    timing: list[Callable[[Rows, np.ndarray, np.ndarray], np.ndarray]] = field(default_factory=list)
    noise: list[Callable[[Rows, str, np.ndarray, np.ndarray], np.ndarray]] = field(default_factory=list)
    dead: list[PerRow] = field(default_factory=list)
    frames: list[tuple[float, float]] = field(default_factory=list)

    def moves_geometry(self) -> bool:
        return bool(self.stage_deg or self.origin_m or self.tilt_deg or self.focal or self.blur_px)


@dataclass(frozen=True, slots=True)
class Expected:
    """Noise-free answer: `mean` and one-frame `std` per channel, and `valid` share of frames with a return."""

    mean: dict[str, np.ndarray]
    std: dict[str, np.ndarray]
    valid: np.ndarray


def nominal_beam(azimuth_deg: np.ndarray, elevation_deg: np.ndarray) -> np.ndarray:
    """Relative optical power in a direction of the field."""
    return np.exp(-((azimuth_deg / 75.0) ** 4) - (elevation_deg / 18.0) ** 4)


def noise_counts(intensity: np.ndarray) -> np.ndarray:
    """One-frame scatter of the intensity."""
    return np.sqrt(36.0 + 0.25 * np.maximum(intensity, 0.0) + (0.004 * intensity) ** 2)


def noise_m(intensity: np.ndarray) -> np.ndarray:
    """One-frame scatter of the distance."""
    return np.hypot(0.004, 0.30 * noise_counts(intensity) / np.maximum(intensity, 1.0))


def _round_gaussian(rings: int, around: int) -> np.ndarray:
    """Points of a round Gaussian of unit variance, (2, rings · around), each for the same share of its light.

    Every second ring is turned by half a step: two rings of six are round to fifth order.
    """
    radius = np.sqrt(-2.0 * np.log1p(-(np.arange(rings) + 0.5) / rings)).repeat(around)
    radius *= np.sqrt(2.0 / np.mean(radius**2))
    ring, place = np.divmod(np.arange(rings * around), around)
    turn_rad = 2.0 * np.pi * (place + 0.5 * (ring % 2)) / around
    return radius * np.stack([np.cos(turn_rad), np.sin(turn_rad)])


SPREAD, FINE_SPREAD = _round_gaussian(2, 6), _round_gaussian(4, 8)
"""Sharp rays need many points: at an edge the light of few would jump where a blur lets it pass smoothly."""


def footprint(rows: Rows, reality: Reality) -> tuple[np.ndarray, np.ndarray]:
    """Sub-ray offsets in pixels, each (N, S) or (1, S); a blur widens each by points of a round Gaussian."""
    if not reality.blur_px:
        return OFFSET_U[None, :], OFFSET_V[None, :]
    sigma = np.sqrt(sum(np.square(f(rows)) for f in reality.blur_px))
    points = SPREAD if reality.footprint_rad else FINE_SPREAD
    du = (OFFSET_U[None, :, None] + sigma[:, None, None] * points[0]).reshape(len(rows), -1)
    dv = (OFFSET_V[None, :, None] + sigma[:, None, None] * points[1]).reshape(len(rows), -1)
    return du, dv


def illuminate(rows: Rows, reality: Reality, *, u: np.ndarray | None = None, v: np.ndarray | None = None) -> Light:
    """Light of each row's pixel (or of other pixels `u`, `v` at the same moment) before window and electronics."""
    u = rows.u if u is None else u
    v = rows.v if v is None else v
    angle = rows.angle_deg + sum((f(rows) for f in reality.stage_deg), start=np.zeros(len(rows)))
    focal = np.prod([np.ones(len(rows)), *(f(rows) for f in reality.focal)], axis=0)
    du, dv = footprint(rows, reality)
    rays = pixel_rays(u[:, None] + du, v[:, None] + dv, focal[:, None])
    azimuth, elevation = field_angles_deg(pixel_rays(u.astype(float), v.astype(float)))
    for tilt in reality.tilt_deg:
        roll, pitch, yaw = tilt(rows).T
        rays = turn(rays, roll[:, None], pitch[:, None], yaw[:, None])
    direction = to_chamber(rays, angle[:, None])
    origin = np.zeros((len(rows), 3))
    for offset in reality.origin_m:
        origin = origin + to_chamber(offset(rows), angle)
    origin[:, 2] += np.asarray(DUT_HEIGHT_M)[rows.dut]
    hits = trace(origin[:, None, :], direction, reality.footprint_rad)
    weight = hits.share * hits.reflectance * hits.cos_incidence * (ARC_M / hits.range_m) ** 2
    weight = weight * (hits.range_m.shape[1] / direction.shape[1])  # the mean over hits is the mean over rays
    beam = nominal_beam(azimuth, elevation)
    for change in reality.beam:
        beam = change(rows, azimuth, elevation)
    for factor in reality.surface:
        weight = weight * factor(rows, hits)
    return Light(weight=G_COUNTS * beam[:, None] * weight, hits=hits, azimuth_deg=azimuth, elevation_deg=elevation)


def expect(rows: Rows, reality: Reality, light: Light | None = None) -> Expected:
    """What the sensor reports on average, and how one frame scatters.

    Args:
        rows: what is measured.
        reality: what happens beyond the nominal model.
        light: nominal light of the same rows, to be used where the reality moves no ray.
    """
    if light is None or reality.moves_geometry() or reality.beam or reality.surface:
        light = illuminate(rows, reality)
    passed = light
    for transmission in reality.transmission:
        factor = transmission(rows, passed)
        weight = passed.weight * (factor[:, None] if factor.ndim == 1 else factor)
        passed = Light(weight, light.hits, light.azimuth_deg, light.elevation_deg)
    amplitude = passed.counts
    for add in reality.stray:
        amplitude = amplitude + add(rows, amplitude)
    with np.errstate(invalid="ignore"):  # a pixel all of whose light is lost has no range
        distance = np.sum(passed.weight * passed.hits.range_m, axis=1) / np.sum(passed.weight, axis=1)
    for mix in reality.mixing:
        distance = mix(rows, passed, distance)
    intensity = amplitude
    for change in reality.electronics:
        intensity = change(rows, intensity)
    true_distance = distance
    for shift in reality.timing:
        distance = distance + shift(rows, amplitude, true_distance)
    std = {"intensity_counts": noise_counts(intensity), "distance_m": noise_m(intensity)}
    for widen in reality.noise:
        std = {channel: widen(rows, channel, value, intensity) for channel, value in std.items()}
    valid = (intensity >= FLOOR_COUNTS).astype(float)
    for dead in reality.dead:
        valid = np.where(dead(rows), 0.0, valid)
    answer = Expected({"intensity_counts": intensity, "distance_m": distance}, std, valid)
    return _over_frames(rows, reality, answer) if reality.frames else answer


def frame_load(rows: Rows) -> np.ndarray:
    """Mean counts of the whole nominal frame that each row's pixel is read with, from a coarse grid of pixels."""
    u, v = block_centres()
    _, first, back = np.unique(rows.dut * 1000.0 + rows.angle_deg, return_index=True, return_inverse=True)
    frames = [illuminate(rows.take(np.full(u.size, k)), Reality(), u=u, v=v).counts.mean() for k in first]
    return np.array(frames)[back]


def _over_frames(rows: Rows, reality: Reality, here: Expected) -> Expected:
    """Frames taken while the stage was still a fraction of the way back towards the sweep's previous angle.

    `reality.frames` holds (share of the frames, fraction of the way); the shares sum to one.
    """
    first = {name: np.zeros(len(rows)) for name in here.mean}
    second = {name: np.zeros(len(rows)) for name in here.mean}
    still = replace(reality, frames=[])
    for share, fraction in reality.frames:
        angle = rows.angle_deg + fraction * (rows.previous_angle_deg - rows.angle_deg)
        there = expect(replace(rows, angle_deg=angle), still) if fraction > 1e-3 else here
        for name, value in there.mean.items():
            first[name] += share * value
            second[name] += share * (there.std[name] ** 2 + value**2)
    std = {name: np.sqrt(np.maximum(second[name] - first[name] ** 2, 0.0)) for name in first}
    return Expected(first, std, here.valid)
