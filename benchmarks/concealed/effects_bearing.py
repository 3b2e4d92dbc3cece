"""Effects outside the library that stand in the chamber, not on the sensor; and pixels that drift apart."""

import numpy as np

from benchmarks.concealed.designs import fine_sweep, sparse
from benchmarks.concealed.effect import DIE, DISTANCE, FIELD, INTENSITY, Effect, sign, wide
from benchmarks.concealed.flash import Light, Reality
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.rows import Design, Rows
from benchmarks.concealed.scene import HEIGHT_PX, WIDTH_PX, pixel_rays, to_chamber

ROOM = ("stage_angle_deg", "azimuth_deg", "pixel_u")


def _unknown(nature: str, **given: object) -> Effect:
    return Effect(effect="unknown", nature=nature, **given)  # type: ignore[arg-type]  # keywords as Effect's own


def _bearing_deg(rows: Rows) -> np.ndarray:
    """Where each row's pixel looks in the chamber: the ray itself, turned with the stage."""
    ray = to_chamber(pixel_rays(rows.u.astype(float), rows.v.astype(float)), rows.angle_deg)
    return np.asarray(np.degrees(np.arctan2(ray[..., 1], ray[..., 0])))


def _port(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    """A window of the chamber through which some bearings are seen: twice through its edge is a little less light."""
    centre, width = rng.uniform(-30, 30), wide(rng, 4.0, 15.0)

    def apply(reality: Reality, amount: float) -> None:
        def frame(rows: Rows, light: Light) -> np.ndarray:
            inside = 1.0 / (1.0 + (np.abs(_bearing_deg(rows) - centre) / width) ** 8)
            return (1.0 - min(amount, 0.9) * inside) ** 2

        reality.transmission.append(frame)

    return _unknown(
        "a port of the chamber", apply=apply, channels=(INTENSITY,), start=0.005, limit=0.4,
        drivers=ROOM, needs=("stage_angle_deg", *FIELD), unseen=("steps",),
    )  # fmt: skip


def _lamp(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    """A lamp in the chamber adds counts to the pixels that look its way."""
    centre, width = rng.uniform(-40, 40), wide(rng, 3.0, 12.0)

    def apply(reality: Reality, amount: float) -> None:
        reality.stray.append(
            lambda rows, amplitude: 1e3 * amount * np.exp(-0.5 * ((_bearing_deg(rows) - centre) / width) ** 2)
        )

    return _unknown(
        "a lamp in the chamber", apply=apply, channels=(INTENSITY,), start=0.002, limit=0.5,
        drivers=ROOM, needs=("stage_angle_deg", *FIELD), unseen=("steps",),
    )  # fmt: skip


def _bent_wall(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    """The chamber's wall is buckled: what lies behind and beside the panels is nearer here and farther there."""
    turns_deg, phase = wide(rng, 12.0, 40.0), rng.uniform(0, 6.28)

    def apply(reality: Reality, amount: float) -> None:
        def buckled(rows: Rows, amplitude: np.ndarray, distance: np.ndarray) -> np.ndarray:
            return amount * np.sin(2 * np.pi * _bearing_deg(rows) / turns_deg + phase)

        reality.timing.append(buckled)

    return _unknown(
        "all that is seen is buckled", apply=apply, channels=(DISTANCE,), start=1e-3, limit=0.05,
        drivers=ROOM, needs=("stage_angle_deg", *FIELD), unseen=("steps",),
    )  # fmt: skip


def _drifting_pixels(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    slopes, way = rng.normal(size=(3, HEIGHT_PX, WIDTH_PX)), sign(rng)

    def apply(reality: Reality, amount: float) -> None:
        def drift(rows: Rows, counts: np.ndarray) -> np.ndarray:
            own = slopes[rows.dut, rows.v, rows.u]
            return counts * np.maximum(1.0 + way * amount * own * (rows.node_c["tof"] - 34.0) / 60.0, 0.05)

        reality.electronics.append(drift)

    return _unknown(
        "every pixel drifts its own way", apply=apply, channels=(INTENSITY,), start=0.005, limit=0.3,
        drivers=(*DIE, *FIELD), needs=(*FIELD, *DIE[:2]), unseen=("steps", "angles"),
    )  # fmt: skip


RECIPES = (
    Recipe("unknown", lambda r: sparse(r, pixels=24, angles=15, steps=10), _port),
    Recipe("unknown", lambda r: sparse(r, pixels=24, angles=15, steps=10), _lamp),
    Recipe("unknown", lambda r: fine_sweep(r, pixels=16, steps=5), _bent_wall),
    Recipe("unknown", lambda r: sparse(r, pixels=40, angles=7, steps=14), _drifting_pixels),
)
