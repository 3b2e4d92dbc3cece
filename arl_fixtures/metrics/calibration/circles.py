"""Sub-pixel circle centres on the intrinsic targets, as deviations from where the twin's own circles appear.

At 128 × 32 pixels a circle is four pixels wide, so its centre is taken as the first moment of the brightness above
the target's background, over the cell of one pitch around it. A moment is not the projected centre: perspective and
distortion make an egg of the circle, cosine and range shade it, the beam's slope pulls it by up to 0.03 px, pixels
at the cell's rim count in full. None of that is modelled a second time: the same moment over the same pixels is
taken from the twin's noise-free frame, and only the difference of the two moments is used. The beam is divided out
first, by the power map measured in the same step, by the twin's own in the twin's frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.calibration.camera import CircleField
from arl_fixtures.metrics.geometry import Geometry
from arl_fixtures.metrics.panels import centre_rays, view_panel
from arl_fixtures.twin.scene import CircleGrid, Panel

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

RIM_PX: Final = 0.4
"""The outline of a usable circle stays this far inside the image."""
LEAST_GAP_PX: Final = 1.8
"""Dark gap between neighbouring circles; below it they run into one another and a shift is seen only in part."""
LEAST_CONTRAST: Final = 0.5
"""A circle that has less than this share of the contrast expected is not what the DUT sees."""

_ARRAYS: Final = ("index", "owner", "u", "v", "scale", "twin", "contrast")
_JACOBIANS: Final = ("jacobian", "stage_jacobian")
_STORED: Final = (*_ARRAYS, *_JACOBIANS, "circle", "most")
"""Arrays of a plan that is kept for another process, besides those of each target."""


@dataclass(frozen=True)
class CirclePlan:
    """Which pixels belong to which circle, and what the twin says of them.

    Attributes:
        circles: the m circles.
        index: (p,) flat indices into (n, H, W) of all pixels that belong to a circle's cell.
        owner: (p,) circle of each.
        u, v: (p,) image position of each.
        background: (b, …) flat indices of plain background, per target.
        scale: (p,) counts of a white surface at each pixel without the beam.
        background_scale: the same for the background pixels.
        twin: (m, 2) moments in the twin's frame.
        contrast: (m,) sum of the twin's brightness above background.
    """

    circles: CircleField
    index: Int64Array
    owner: Int64Array
    u: Float64Array
    v: Float64Array
    background: tuple[Int64Array, ...]
    scale: Float64Array
    background_scale: tuple[Float64Array, ...]
    twin: Float64Array
    contrast: Float64Array


@dataclass(frozen=True)
class Centres:
    """Measured deviations of the circle centres from the twin's.

    Attributes:
        usable: (m,) circles that were seen in full with their contrast.
        deviation_px: (m, 2) in u and v.
        variance_px2: (m, 2) from repeatability.
    """

    usable: BoolArray
    deviation_px: Float64Array
    variance_px2: Float64Array


def circle_plan(geometry: Geometry) -> CirclePlan | None:
    """Everything about the circles that does not depend on the recording; None where no circle fits the image."""
    known = geometry.kept("circles", _STORED, lambda: _stored(geometry))
    return _restored(geometry, known) if known else None


def _stored(geometry: Geometry) -> dict[str, npt.NDArray[Any]]:
    """A plan as arrays by name, with the derivatives of its circles; empty where there is none."""
    found = _plan(geometry)
    if found is None:
        return {}
    plan, names = found
    arrays = {name: getattr(plan, name) for name in _ARRAYS}
    arrays |= {name: getattr(plan.circles, name) for name in _JACOBIANS}
    for b, pixels in enumerate(plan.background):
        arrays |= {f"background.{b}": pixels, f"background_scale.{b}": plan.background_scale[b]}
    return {name: np.ascontiguousarray(array) for name, array in (arrays | names).items()}


def _restored(geometry: Geometry, known: Mapping[str, npt.NDArray[Any]]) -> CirclePlan:
    circles = _circle_field(geometry, known["circle"], int(known["most"][0]))
    # a cached property that is known need not be computed
    circles.__dict__.update((name, known[name]) for name in _JACOBIANS)
    boards = range(len(geometry.boards))
    return CirclePlan(
        circles=circles,
        background=tuple(known[f"background.{b}"] for b in boards),
        background_scale=tuple(known[f"background_scale.{b}"] for b in boards),
        **{name: known[name] for name in _ARRAYS},
    )


def _plan(geometry: Geometry) -> tuple[CirclePlan, dict[str, npt.NDArray[Any]]] | None:
    """The plan, and the names of its circles with what they are counted by."""
    rays = centre_rays(geometry.dut)
    found = [
        _cells(geometry, number, panel, panel.circles, rays)
        for number, panel in enumerate(geometry.scene.panels, start=1)
        if panel.circles is not None
    ]
    boards = geometry.boards
    index = np.concatenate([cells.index for cells in found]) if found else np.empty(0, np.int64)
    if not index.size:
        return None
    # a circle is named by angle, target, row and column; number those that occur
    board = np.concatenate([np.full(cells.index.size, b) for b, cells in enumerate(found)])
    place = np.concatenate([cells.circle for cells in found])
    size = geometry.surface[0].size
    angle = index // size
    most = int(place.max()) + 1
    name = (angle * len(boards) + board) * most + place
    occurs = np.bincount(name) > 0
    names, owner = np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[name]
    circles = _circle_field(geometry, names, most)
    inside = _fits(geometry, circles)
    kept = inside[owner]
    renumber = np.cumsum(inside) - 1
    index, owner = index[kept], renumber[owner[kept]]
    if not index.size:
        return None
    circles = _circle_field(geometry, names[inside], most)
    background = tuple(cells.background for cells in found)
    row, column = np.divmod(index % size, geometry.dut.columns)
    plan = CirclePlan(
        circles=circles,
        index=index,
        owner=owner,
        u=column.astype(np.float64),
        v=row.astype(np.float64),
        background=background,
        scale=_white_counts(geometry, index),
        background_scale=tuple(_white_counts(geometry, pixels) for pixels in background),
        twin=np.empty((0, 2)),
        contrast=np.empty(0),
    )
    level = np.array(
        [
            np.median(_brightness(geometry, pixels, scale)) if pixels.size else np.nan
            for pixels, scale in zip(background, plan.background_scale, strict=True)
        ]
    )
    moments, contrast = _moments(plan, _brightness(geometry, index, plan.scale) - level[circles.board[owner]])
    return replace(plan, twin=moments, contrast=contrast), {"circle": names[inside], "most": np.array([most])}


def find_centres(
    plan: CirclePlan,
    counts: Float64Array,
    variance: Float64Array,
    beam: Float64Array,
) -> Centres:
    """Circle centres of a recording.

    Args:
        plan: of the geometry.
        counts: (n·H·W,) mean intensity without offset, NaN where there is none.
        variance: (n·H·W,) variance of that mean.
        beam: (H·W,) P_o, gain included; NaN where it is not known.
    """
    circles = plan.circles
    size = beam.size
    bright = counts[plan.index] / (plan.scale * beam[plan.index % size])
    noise = variance[plan.index] / (plan.scale * beam[plan.index % size]) ** 2
    level = np.full(len(circles.boards), np.nan)
    for b, (pixels, scale) in enumerate(zip(plan.background, plan.background_scale, strict=True)):
        dark = counts[pixels] / (scale * beam[pixels % size])
        if np.isfinite(dark).any():
            level[b] = float(np.nanmedian(dark))
    above = bright - level[circles.board[plan.owner]]
    whole = np.isfinite(above) & np.isfinite(noise)
    m = len(circles.angle)
    complete = np.bincount(plan.owner, weights=~whole, minlength=m) == 0
    moments, contrast = _moments(plan, np.where(whole, above, 0.0))
    with np.errstate(invalid="ignore"):
        usable = complete & (contrast > LEAST_CONTRAST * plan.contrast) & (plan.contrast > 0.0)
    noise = np.where(whole, noise, 0.0)
    spread = [
        np.bincount(plan.owner, weights=noise * (place - moments[plan.owner, axis]) ** 2, minlength=m)
        for axis, place in enumerate((plan.u, plan.v))
    ]
    with np.errstate(invalid="ignore", divide="ignore"):
        variance_px2 = np.stack(spread, axis=1) / contrast[:, None] ** 2
    return Centres(usable=usable, deviation_px=moments - plan.twin, variance_px2=variance_px2)


@dataclass(frozen=True)
class _Cells:
    """Pixels of one target: flat index, number of the circle they belong to, and the plain background."""

    index: Int64Array
    circle: Int64Array
    background: Int64Array


def _cells(geometry: Geometry, number: int, panel: Panel, grid: CircleGrid, rays: Float64Array) -> _Cells:
    dut = geometry.dut
    index = np.flatnonzero((geometry.surface == number).ravel())
    angle, pixel = np.divmod(index, len(rays))
    view = view_panel(dut, rays, panel, stage_angle_deg=geometry.stage_angle_deg, angle=angle, pixel=pixel)
    column, from_column_m = _nearest(view.aside_m, grid.columns, grid.pitch_m)
    row, from_row_m = _nearest(view.up_m, grid.rows, grid.pitch_m)
    in_cell = (np.abs(from_column_m) <= grid.pitch_m / 2) & (np.abs(from_row_m) <= grid.pitch_m / 2)
    # a pixel's field reaches over one pixel: plain background keeps that distance from every circle and edge
    pixel_m = 1.2 * panel.radius_m / min(dut.intrinsics.fx, dut.intrinsics.fy)
    plain = np.hypot(from_column_m, from_row_m) > grid.radius_m + pixel_m
    plain &= ~geometry.mixed.ravel()[index]
    return _Cells(
        index=index[in_cell],
        circle=(row * grid.columns + column)[in_cell],
        background=index[plain],
    )


def _nearest(position_m: Float64Array, count: int, pitch_m: float) -> tuple[Int64Array, Float64Array]:
    middle = (count - 1) / 2
    number = np.clip(np.rint(position_m / pitch_m + middle), 0, count - 1)
    return number.astype(np.int64), position_m - (number - middle) * pitch_m


def _circle_field(geometry: Geometry, names: Int64Array, most: int) -> CircleField:
    panels = [panel for panel in geometry.scene.panels if panel.circles is not None]
    rest, place = np.divmod(names, most)
    angle, board = np.divmod(rest, len(panels))

    def of_board(values: list[float]) -> Float64Array:
        return np.array(values)[board]

    grids = [panel.circles or CircleGrid() for panel in panels]
    columns = np.array([grid.columns for grid in grids])[board]
    row, column = np.divmod(place, columns)
    pitch_m = of_board([grid.pitch_m for grid in grids])
    return CircleField(
        dut=geometry.dut,
        circle=board * most + place,
        angle=angle,
        stage_angle_deg=geometry.stage_angle_deg[angle],
        board=board,
        boards=geometry.boards,
        azimuth_deg=of_board([panel.azimuth_deg for panel in panels]),
        radius_m=of_board([panel.radius_m for panel in panels]),
        aside_m=pitch_m * (column - of_board([(grid.columns - 1) / 2 for grid in grids])),
        up_m=of_board([panel.centre_z_m for panel in panels])
        + pitch_m * (row - of_board([(grid.rows - 1) / 2 for grid in grids])),
    )


def _fits(geometry: Geometry, circles: CircleField) -> BoolArray:
    """Circles whose outline lies inside the image and clear of their neighbours."""
    panels = [panel for panel in geometry.scene.panels if panel.circles is not None]
    radius_m = np.array([(panel.circles or CircleGrid()).radius_m for panel in panels])[circles.board]
    pitch_m = np.array([(panel.circles or CircleGrid()).pitch_m for panel in panels])[circles.board]
    width, height = geometry.dut.columns, geometry.dut.rows
    centre = circles.pixels()
    inside = np.ones(len(centre), dtype=bool)
    for aside, up in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        rim = replace(circles, aside_m=circles.aside_m + aside * radius_m, up_m=circles.up_m + up * radius_m).pixels()
        inside &= (rim[:, 0] > RIM_PX - 0.5) & (rim[:, 0] < width - 0.5 - RIM_PX)
        inside &= (rim[:, 1] > RIM_PX - 0.5) & (rim[:, 1] < height - 0.5 - RIM_PX)
        gap_px = np.hypot(*(rim - centre).T) * (pitch_m - 2.0 * radius_m) / radius_m
        inside &= gap_px > LEAST_GAP_PX
    return inside


def _white_counts(geometry: Geometry, pixels: Int64Array) -> Float64Array:
    """Counts of a white surface in the beam's full power at some of the pixels, flat indices into (n, H, W)."""
    cos_incidence = geometry.cos_incidence.ravel()[pixels].astype(np.float64)
    # the range stays in single precision until it is squared, as in the expectation itself
    shading = cos_incidence * (geometry.dut.reference_range_m / geometry.true_range_m.ravel()[pixels]) ** 2
    return geometry.dut.full_scale_counts * shading


def _brightness(geometry: Geometry, pixels: Int64Array, scale: Float64Array) -> Float64Array:
    """The twin's reflectance at some of the pixels, where a white surface has `scale` counts in the full beam."""
    counts = geometry.intensity_counts.ravel()[pixels].astype(np.float64) - geometry.dut.offset_counts
    beam = geometry.dut.gain * geometry.power.astype(np.float64).ravel()
    brightness: Float64Array = counts / (scale * beam[pixels % beam.size])
    return brightness


def _moments(plan: CirclePlan, above: Float64Array) -> tuple[Float64Array, Float64Array]:
    """First moments (m, 2) and sums (m,) of the brightness above background."""
    m = len(plan.circles.angle)
    total: Float64Array = np.bincount(plan.owner, weights=above, minlength=m).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        u = np.bincount(plan.owner, weights=above * plan.u, minlength=m) / total
        v = np.bincount(plan.owner, weights=above * plan.v, minlength=m) / total
    return np.stack([u, v], axis=1), total
