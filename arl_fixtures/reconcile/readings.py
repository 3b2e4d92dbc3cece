"""What a sensor of temperature read at a frame, and what the temperature was: readings scatter, bodies do not.

A logged temperature has the noise and the steps of its logger. Where an effect is strong, that noise is worth more
than the frames' own: taken at its word it dilutes the effect's slope (errors in variables), and another column that
happens to scatter less takes its name. So within a step a temperature is a line over time where its readings scatter
about one like noise. Not where the channels follow the readings themselves: then these were no noise. Readings that
were lost are on the line as well: a body has a temperature whether or not it was read, and rows on which an effect
seemed to stop would speak against it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.columns import Columns, FloatArray, IntArray
from arl_fixtures.reconcile.roles import Role, unit_of

FEWEST_READINGS = 4
"""Readings of a step from which its line is drawn."""
DRIFTS = 2.0
"""How much more than their scatter makes of them the slopes of lines must be, for steps to drift at all."""
MOST_ALIKE = 0.3
"""Correlation of neighbouring readings' errors from which these are the temperature's own course."""
SURE = 2.0
"""Standard errors by which channels must follow the readings rather than the lines for the readings to stay."""

LEAST_SEEN = 0.5
"""Share of images that a channel must hold to be asked."""


@dataclass(frozen=True, slots=True)
class _Images:
    """One row of each image: its step's code, its time from the middle of that, the rows' images."""

    step: IntArray
    time: FloatArray
    image: IntArray
    first: IntArray


def smooth_readings(columns: Columns, names: list[str] | None = None) -> list[str]:
    """Give effects temperatures without their loggers' noise.

    Args:
        columns: of the table; `smoothed` is filled.
        names: temperatures known to be of that kind (of a model that was found with them); else the table shows it.

    Returns:
        The temperatures that were smoothed.
    """
    images = _images_of(columns)
    if images is None:
        return []
    channels = {c.name for c in columns.channels}
    found = []
    for name in names if names is not None else sorted(columns.numbers):
        if unit_of(name) != "°C" or name in channels or name.startswith("sim_") or name not in columns.numbers:
            continue
        whole = columns.numbers[name]
        lost, reading = ~np.isfinite(whole), _of_images(whole, images)
        if np.any((reading[images.image] != whole) & ~lost):
            continue  # pixels of an image have temperatures of their own
        line = _line(reading, images)
        if names is None and not np.isfinite(line).all():
            continue  # a step without any tells nothing of how readings scatter
        noise = np.nan_to_num(reading - line)
        if not (noise.any() or lost.any()):
            continue
        if names is None and (_is_course(noise, images) or _is_followed(columns, images, reading, line)):
            if not lost.any():
                continue
            line = np.where(np.isfinite(reading), reading, line)
        columns.smoothed[name] = line[images.image]
        found.append(name)
    return found


def _of_images(whole: FloatArray, images: _Images) -> FloatArray:
    """A reading of each image; not finite where none of its rows has one."""
    reading = whole[images.first].copy()
    known = np.isfinite(whole)
    reading[images.image[known]] = whole[known]
    return reading


def _images_of(columns: Columns) -> _Images | None:
    """Images of steps that hold enough of them; None where steps are lacking, or some times.

    Where nobody wrote times each row is one, in the order of the table.
    """
    if "step" not in columns.numbers:
        return None
    time, image = np.arange(float(columns.n)), np.arange(columns.n)
    if "time_s" in columns.numbers:
        time = columns.numbers["time_s"]
        image = np.unique(columns.group("dut", "cycle", "step", "time_s"), return_inverse=True)[1].astype(np.int64)
    if not np.isfinite(time).all():
        return None
    step = columns.group("dut", "cycle", "step")
    first = np.unique(image, return_index=True)[1].astype(np.int64)
    count = np.bincount(step[first])
    if np.median(count[count > 0]) < FEWEST_READINGS:
        return None
    at = step[first]
    return _Images(at, _less_mean(time[first], at), image, first)


def _less_mean(values: FloatArray, code: IntArray) -> FloatArray:
    mean = np.bincount(code, values) / np.maximum(np.bincount(code), 1)
    return np.asarray(values - mean[code])


def _line(reading: FloatArray, images: _Images) -> FloatArray:
    """Least-squares line over time in each step; the reading itself where a step has too few, their mean where lost.

    A level one in each step where no more than chance tells of slopes. Not finite in a step without any reading.
    """
    known = np.isfinite(reading)
    count = np.bincount(images.step, known.astype(float))
    with np.errstate(invalid="ignore", divide="ignore"):
        mean, when = (np.bincount(images.step, np.where(known, x, 0.0)) / count for x in (reading, images.time))
        time, rest = images.time - when[images.step], np.where(known, reading - mean[images.step], 0.0)
    square = np.bincount(images.step, np.where(known, time**2, 0.0))
    slope = np.bincount(images.step, np.nan_to_num(time) * rest) / np.maximum(square, 1e-300)
    slope = np.where(square > 0.0, slope, 0.0)
    left = np.where(known, rest - slope[images.step] * time, 0.0)
    enough = (count >= FEWEST_READINGS) & (square > 0.0)
    told = float(np.sum((slope**2 * square)[enough])) / max(int(enough.sum()), 1)
    scatter = float(np.sum(left[enough[images.step]] ** 2)) / max(float(np.sum(count[enough] - 2.0)), 1.0)
    if told < DRIFTS * scatter:
        slope = np.zeros_like(slope)
    line = mean[images.step] + slope[images.step] * time
    few = count[images.step] < FEWEST_READINGS
    return np.asarray(np.where(few, np.where(known, reading, mean[images.step]), line))


def _is_course(noise: FloatArray, images: _Images) -> bool:
    """Whether what readings do about their lines goes on from one to the next."""
    order = np.lexsort((images.time, images.step))
    here, step = noise[order], images.step[order]
    same = step[1:] == step[:-1]
    return float(np.sum((here[1:] * here[:-1])[same])) > MOST_ALIKE * float(here @ here)


def _is_followed(columns: Columns, images: _Images, reading: FloatArray, line: FloatArray) -> bool:
    """Whether a channel that goes with the temperature from step to step goes with its readings' noise as well."""
    between, count = _less_mean(line, images.step * 0), len(images.first)
    for channel in columns.channels:
        if channel.role is Role.SCATTER:
            continue
        measured, simulated = (columns.numbers[p + channel.name] for p in ("", "sim_"))
        relative = channel.role is Role.INTENSITY
        with np.errstate(divide="ignore", invalid="ignore"):
            rest = (measured - simulated) / simulated if relative else measured - simulated
        known = np.isfinite(rest)
        weight = np.bincount(images.image[known], minlength=count)
        seen = weight > 0  # not where none of an image's rows returned anything
        noise = np.where(seen, np.nan_to_num(reading - line), 0.0)
        square = float(noise @ noise)
        if np.mean(seen) < LEAST_SEEN or square == 0.0:
            continue
        mean = np.bincount(images.image[known], rest[known], minlength=count) / np.maximum(weight, 1)
        slope = float(between[seen] @ mean[seen]) / max(float(between[seen] @ between[seen]), 1e-300)
        left = np.where(seen, mean - _line(np.where(seen, mean, np.nan), images), 0.0)
        within = float(noise @ left) / square
        error = float(np.std(left[seen])) / np.sqrt(square)
        if abs(within) > SURE * error + abs(within - slope):
            return True
    return False
