"""What a concealed effect is: how it acts on reality at a given amount, and the truth that is sealed about it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

INTENSITY, DISTANCE = "intensity_counts", "distance_m"
HOT = (
    "tof_temperature_c",
    "housing_temperature_c",
    "fpga_temperature_c",
    "set_temperature_c",
    "plate_temperature_c",
    "coolant_temperature_c",
    "laser_temperature_c",
)
DIE = (
    "tof_temperature_c",
    "fpga_temperature_c",
    "housing_temperature_c",
    "set_temperature_c",
    "plate_temperature_c",
    "coolant_temperature_c",
)
FIELD = ("azimuth_deg", "pixel_u", "elevation_deg", "pixel_v")
HISTORY = ("ramp", "time_s", "step", *HOT)


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A parameter with an unambiguous meaning: names that a tool may give it (regular expression) and its unit."""

    pattern: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """One effect at work.

    Attributes:
        effect: id of the vocabulary, or "unknown" with `nature` saying what it is.
        apply: switches the effect on in a reality, at an amount.
        start: an amount that is about visible; `limit` the largest that is physical.
        drivers: sets of columns; a first driver out of any of them is right.
        where: column -> [low, high] or values, where the effect acts; None when everywhere.
        parameters: at an amount.
        kind: "mean", "scatter" (of one frame), "common" (shared by a step or sweep) or "dead".
        unseen: kinds of held-out blocks on which a right model must still predict.
        needs: columns that may not be dropped.
        equivalents: ids that this design cannot tell apart; naming one of them is a class, not an error.
        unless_seen: (channel, id): another id that the effect looks like unless it is visible in that channel.
        common_scale: of "common" effects, and of scatter that all rows of a sweep share: (expected, amount) -> scale.
        calibrations: what may be refitted on the corrupted data without destroying the effect.
    """

    effect: str
    apply: Callable[[Any, float], None]
    channels: tuple[str, ...]
    drivers: tuple[str, ...]
    start: float
    limit: float = np.inf
    nature: str = ""
    where: dict[str, list[Any]] | None = None
    parameters: Callable[[float], tuple[Parameter, ...]] = field(default=lambda amount: ())
    kind: str = "mean"
    unseen: tuple[str, ...] = ("steps", "angles")
    needs: tuple[str, ...] = ()
    equivalents: tuple[str, ...] = ()
    unless_seen: tuple[tuple[str, str], ...] = ()
    calibrations: tuple[str, ...] = ("none", "global")
    common_scale: Callable[[Any, float], dict[str, np.ndarray]] | None = None


def wide(rng: np.random.Generator, low: float, high: float) -> float:
    """Log-uniform in a positive range; in three cases of ten up to twice beyond its ends."""
    if rng.random() < 0.3:
        low, high = low / 2.0, high * 2.0
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def sign(rng: np.random.Generator) -> float:
    """−1 or +1."""
    return float(rng.choice([-1.0, 1.0]))
