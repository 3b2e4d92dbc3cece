"""Columns that a physics-free model may use: covariates, the simulation itself, and what lies next to a row."""

from __future__ import annotations

import zlib

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.noise_of_the_simulation import own_noise
from arl_fixtures.reconcile.play import play_of
from arl_fixtures.reconcile.roles import BEARING_SIGNS, FIELD_COLUMNS, HALF_TURN_DEG, PIXEL, Role
from arl_fixtures.reconcile.seen_again import of_places
from arl_fixtures.reconcile.view import View

NEIGHBOURS = ((1, 0), (-1, 0), (0, 1), (0, -1))
OF_NEIGHBOURS = ("~edge(", "~sweep", "~before(", "~frame(")
"""How features begin that compare a row with others."""
NOISE_TOLD = 4.0
"""Standard deviations of a simulation's own noise by which rows must differ."""
_MOST_PIXELS = 1e4
"""More rows or columns than any image has; with the number of a device still told apart in a float64."""
LEAST_OWN = 1e-3
"""Share of the median signal below which a row's own counts as that in a ratio: what sees nothing has no ratio."""


def category_id(label: str) -> float:
    """Number of a category that is the same in every table."""
    return float(zlib.crc32(label.encode()) % 1_000_003)


def features_of(view: View) -> dict[str, FloatArray]:
    """Every column on which a mismatch may depend, on the rows of the view.

    Derived ones carry a `~`: `~edge(X)` (mean of the neighbouring pixels over own), `~sweep(X)` (next angle over
    own), `~before(X)` (frame taken before over own), `~frame(X)` (mean of the image over own), `~parity(pixel_u)`,
    `~within(time_s)` (since the step's first row), `~play(X)` (from which side a temperature came), `~radius(field)`
    and `~twist(field)` (see `_field`), and `~bearing(azimuth + stage)` (where a pixel looks in the room, in degrees;
    either sense), `~pixel` (its number).
    """
    logged = view.columns.numbers  # as read: what a law finds without physics may follow the readings
    found: dict[str, FloatArray] = {name: logged[name][view.rows] for name in view.covariates() if name != "n_frames"}
    for name in sorted(view.columns.categories):
        if view.labels(name):
            codes, labels = view.codes(name)
            ids = np.array([*(category_id(label) for label in labels), np.nan])
            found[name] = ids[codes]
    state = view.fresh_state()
    for channel in view.columns.channels:
        if channel.role is Role.SCATTER:
            continue
        name = channel.name
        values = view.sim[name]
        if np.nanmax(values) > np.nanmin(values):
            found[f"sim_{name}"] = values
    signal = view.channel(Role.INTENSITY)
    if signal:
        size = np.abs(view.sim[signal])
        own = np.maximum(size, max(LEAST_OWN * float(np.nanmedian(size)), 1e-9))
        if view.varies("pixel_u") or view.varies("pixel_v"):
            near = [view.neighbour(state, signal, du=du, dv=dv) for du, dv in NEIGHBOURS]
            stacked = np.stack(near)
            count = np.isfinite(stacked).sum(axis=0)
            if np.mean(count > 0) > 0.05:
                mean = np.nansum(stacked, axis=0) / np.maximum(count, 1)
                edge = _beyond_noise(view, signal, mean / own - 1.0, own)
                found[f"~edge({signal})"] = of_places(view, signal, np.where(count > 0, edge, np.nan))
        if view.varies("stage_angle_deg"):
            for steps in (-1, 1):
                beside = _beyond_noise(view, signal, view.in_sweep(state, signal, steps=steps) / own - 1.0, own)
                found[f"~sweep{steps:+d}({signal})"] = of_places(view, signal, beside)
            before = view.acquired_before(state, signal) / own - 1.0
            found[f"~before({signal})"] = _beyond_noise(view, signal, before, own)
            if view.varies("pixel_u"):
                found[f"~frame({signal})"] = view.frame_mean(state, signal) / own
    within = _within_step(view)
    if within is not None:
        found["~within(time_s)"] = within
    found |= _field(view) | play_of(view)
    if view.has("azimuth_deg") and view.has("stage_angle_deg") and "azimuth_deg" not in view.columns.derived:
        azimuth, stage = logged["azimuth_deg"][view.rows], logged["stage_angle_deg"][view.rows]
        found |= {name: azimuth + sign * stage for name, sign in BEARING_SIGNS.items()}
    if view.has("pixel_u") and view.has("pixel_v"):
        device = found["dut"] if "dut" in found else np.zeros(view.n)
        found[PIXEL] = (device * _MOST_PIXELS + view.number("pixel_v")) * _MOST_PIXELS + view.number("pixel_u")
    for name in ("pixel_u", "pixel_v"):
        if view.varies(name):
            found[f"~parity({name})"] = np.mod(view.number(name), 2.0)
    return {name: values for name, values in found.items() if np.isfinite(values).any()}


def _beyond_noise(view: View, signal: str, ratio: FloatArray, own: FloatArray) -> FloatArray:
    """A row's ratio to others less 1; nil where a simulation with noise of its own tells no difference."""
    noise = own_noise(view)
    if noise == 0.0:
        return ratio
    told = NOISE_TOLD * noise * view.number(f"sim_{signal}_std") / own
    return np.where(np.abs(ratio) < told, 0.0, ratio)


def _field(view: View) -> dict[str, FloatArray]:
    """Radius of every ray from the field's centre, and the product of its two coordinates about it.

    What a rotationally symmetric optic does depends on the radius alone (Born & Wolf, Principles of Optics, ch. V),
    what a twisted part does on the product (Timoshenko & Goodier, Theory of Elasticity, torsion): either takes many
    products of single coordinates. In degrees and square degrees about the optical axis; where rays are not given in
    pixels and square pixels about the middle of the image. A scanner that looks all around has no field.
    """
    for names, widest in ((_RAYS, HALF_TURN_DEG), (("pixel_u", "pixel_v"), np.inf)):
        if not all(view.varies(name) for name in names):
            continue
        low, high = np.array([view.span(name) for name in names]).T
        if np.any(high - low > widest):
            return {}
        on_axis = (low <= 0.0) & (high >= 0.0) & np.isfinite(widest)
        across, along = (
            view.number(name) - middle
            for name, middle in zip(names, np.where(on_axis, 0.0, 0.5 * (low + high)), strict=True)
        )
        return dict(zip(FIELD_COLUMNS, (np.hypot(across, along), across * along), strict=True))
    return {}


def in_degrees(view: View) -> bool:
    """Whether the field's coordinates are angles."""
    return all(view.varies(name) for name in _RAYS)


_RAYS = ("azimuth_deg", "elevation_deg")


def _within_step(view: View) -> FloatArray | None:
    """Time since the first row of each row's step, None where a step has one time or the table no steps."""
    if not (view.varies("time_s") and view.varies("step")):
        return None
    time = view.number("time_s")
    code = np.unique(view.columns.group("dut", "cycle", "step")[view.rows], return_inverse=True)[1]
    first = np.full(int(code.max()) + 1, np.inf)
    np.fmin.at(first, code, time)
    within = np.asarray(time - first[code])
    spread = np.nanmax(within) if np.isfinite(within).any() else 0.0
    return within if spread > 1e-3 * np.ptp(time[np.isfinite(time)]) else None
