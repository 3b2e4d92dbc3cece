"""ΔK: focal lengths, principal point and distortion, re-calibrated from the intrinsic targets over all angles.

Circle centres come from the temporal mean images with the blob's bias taken from the twin's own frames
(`calibration.circles`); K and δ follow from a bundle adjustment with mount, targets and stage angles as nearly known
(`calibration.adjustment`). It begins with what was found for the reference, or with the files where there is none;
where camera, mount and targets are not where they were assumed to be, the twin is rendered again as they were found,
and the rest is measured against that. Only the stage angles stay the nominal ones: they are others in each sweep.

Changes against the reference: mount and targets are the same ones then and now, so their part cancels, and so does
what a place on the sensor contributed already then, to the extent that it contributes the same now; what remains is
how far apart the places' influences then and now are, and the stage angle's part of both. Propagation is linear.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.calibration.adjustment import Adjustment, adjust
from arl_fixtures.metrics.calibration.camera import FOCAL, PRINCIPAL, TARGET_POSITION, free_intrinsics
from arl_fixtures.metrics.calibration.circles import circle_plan, find_centres
from arl_fixtures.metrics.geometry import Geometry
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.metric import Metric
from arl_fixtures.metrics.power_map import power_map
from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.step import NO_REFERENCE, StepData
from arl_fixtures.quantity import Contribution, Kind, Quantity
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings

Float64Array = npt.NDArray[np.float64]

NEAR_PX: Final = 0.01
"""When what was just found moves the circles by less than this (rms), the twin need not be rendered again."""
MOST_ROUNDS: Final = 4
WORST_RESIDUAL_PX: Final = 0.06
"""Sampling and noise scatter a centre by 0.03 px at most; circles taken for their neighbours by more than this."""
LEAST_SHARE: Final = 0.5
"""Share of a target's circles that must be seen."""
STAGE: Final = "stage angle"


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """K and δ found in a step.

    Attributes:
        names: parameter names.
        values: their values, pixels or dimensionless.
        adjustment: with the covariances.
        assumed: offsets from the files, by name, of camera, mount and targets that the twin was rendered with last.
    """

    names: tuple[str, ...]
    values: Float64Array
    adjustment: Adjustment
    assumed: Mapping[str, float]

    def contributions(self, k: int, factor: float = 1.0) -> tuple[Contribution, ...]:
        """What parameter k's uncertainty is made of, times a factor."""
        found = self.adjustment
        variance, dof = found.centres.variance(k)
        return (
            Contribution("repeatability", factor * math.sqrt(variance), Kind.A, dof),
            *(
                Contribution(name, factor * math.sqrt(max(part[k, k], 0.0)), Kind.B)
                for name, part in found.by_group.items()
            ),
        )


def calibrate(step: StepData) -> Calibration:
    """Re-calibrate the DUT.

    Raises:
        NotMeasurableError: no intensities, or an intrinsic target was not seen.
    """
    sweep = step.require("intensity")
    returns = np.maximum(sweep.intensity_returns, 1)
    counts = sweep.intensity_counts.astype(np.float64).ravel() - step.dut.offset_counts
    variance = (sweep.intensity_variance / returns).astype(np.float64).ravel()
    names = free_intrinsics(step.dut.intrinsics)
    offsets = _known_offsets(step)
    for again in range(MOST_ROUNDS):
        assumed, geometry = offsets, _geometry_with(step.geometry, offsets, keep=not again)
        seen_so = step if geometry is step.geometry else step.seen_by(geometry)
        plan = geometry.derive(circle_plan)
        if plan is None:
            raise NotMeasurableError(f"no circle of an intrinsic target fits the image{step.shortfall}")
        centres = find_centres(plan, counts, variance, seen_so.derive(power_map).power.ravel())
        for b, board in enumerate(plan.circles.boards):
            on_board = plan.circles.board == b
            seen, planned = int(centres.usable[on_board].sum()), int(on_board.sum())
            if seen < LEAST_SHARE * planned or not planned:
                raise NotMeasurableError(f"{board}: {seen} of {planned} circles seen{step.shortfall}")
        found = adjust(plan.circles, centres, step.uncertainty, assumed)
        offsets = {name: assumed.get(name, 0.0) + offset for name, offset in found.offsets.items()}
        near = found.moved_px < NEAR_PX
        if (again or near) and found.residual_px > WORST_RESIDUAL_PX:
            raise NotMeasurableError(
                f"circles scatter by {found.residual_px:.2f} px about any camera: K of the DUT file is pixels off, "
                "or the targets are not where the bench file puts them"
            )
        if near:
            break
    values = np.array([getattr(step.dut.intrinsics, name) + offsets[name] for name in names])
    return Calibration(names=names, values=values, adjustment=found, assumed=assumed)


def _known_offsets(step: StepData) -> dict[str, float]:
    """Where to begin: with what was found for the reference, where there is one, else with the files.

    The reference's is likely to be near, and with the same twin then and now a circle's sampling errors are the same
    and cancel in the change.
    """
    try:
        reference = step.need_reference()
        names, values = reference.array("intrinsics.assumed_names"), reference.array("intrinsics.assumed")
    except NotMeasurableError:
        return {}
    known = {str(name): float(value) for name, value in zip(names, values, strict=True)}
    expected = free_intrinsics(step.dut.intrinsics)
    return known if set(expected) <= known.keys() else {}


def _geometry_with(geometry: Geometry, offsets: Mapping[str, float], *, keep: bool) -> Geometry:
    """The expectation for another camera, mount and targets; one that the next step will ask for again is kept."""
    if not offsets:
        return geometry
    kept = geometry.derive(_kept_geometries)
    key = tuple(offsets.items())
    if key in kept:
        return kept[key]
    dut, scene = _with_offsets(geometry.dut, offsets), _moved(geometry.scene, offsets)
    renderer = Renderer(dut, scene, remembered_angles=1)
    found = Geometry(renderer, geometry.stage_angle_deg)
    if keep:
        kept.clear()
        kept[key] = found
    return found


def _kept_geometries(_: Geometry) -> dict[tuple[tuple[str, float], ...], Geometry]:
    """Room for one expectation with another camera, beside the geometry of the DUT file."""
    return {}


def _with_offsets(dut: DutSettings, offsets: Mapping[str, float]) -> DutSettings:
    """The DUT with other intrinsics and another mount."""
    camera = {name: getattr(dut.intrinsics, name) + value for name, value in offsets.items() if "." not in name}
    mount = {name.removeprefix("mount."): value for name, value in offsets.items() if name.startswith("mount.")}
    up_m = mount.pop("up_m", 0.0)
    return dut.model_copy(
        update={
            "intrinsics": dut.intrinsics.model_copy(update=camera),
            "mount": dut.mount.model_copy(update={name: getattr(dut.mount, name) + mount[name] for name in mount}),
            "height_m": dut.height_m + up_m,
        }
    )


def _moved(scene: SceneSettings, offsets: Mapping[str, float]) -> SceneSettings:
    """The chamber with its targets elsewhere; a shift along the wall is one of the azimuth."""
    panels = []
    for panel in scene.panels:
        radial_m, aside_m, up_m = (offsets.get(f"{panel.name}.{axis}", 0.0) for axis in TARGET_POSITION)
        place = {
            "radius_m": panel.radius_m + radial_m,
            "azimuth_deg": panel.azimuth_deg + math.degrees(aside_m / panel.radius_m),
            "centre_z_m": panel.centre_z_m + up_m,
        }
        panels.append(panel.model_copy(update=place))
    return scene.model_copy(update={"panels": tuple(panels)})


def evaluate(step: StepData) -> list[Measurement]:
    """K and δ, and their change against the reference."""
    found = step.derive(calibrate)
    measured: list[Measurement] = []
    remark = f"{found.adjustment.circles} circles, residual {found.adjustment.residual_px:.3f} px"
    for k, name in enumerate(found.names):
        metric, unit = _kind(name)
        quantity = Quantity.of(float(found.values[k]), unit, *found.contributions(k))
        measured.append(step.measured(metric, quantity, scope=name, reason=remark))
        try:
            change = _change(step, found, k, name)
        except NotMeasurableError as reason:
            attempted = str(reason) != NO_REFERENCE
            measured.append(step.unmeasured(f"{metric}_change", str(reason), scope=name, attempted=attempted))
        else:
            measured.append(step.measured(f"{metric}_change", change, scope=name, relative=True))
    return measured


def remember(step: StepData) -> Mapping[str, npt.NDArray[Any]]:
    """Parameters and their covariances from repeatability and stage angles."""
    found = step.derive(calibrate)
    return {
        "intrinsics.names": np.array(found.names),
        "intrinsics.values": found.values,
        "intrinsics.assumed_names": np.array(list(found.assumed), dtype=np.str_),
        "intrinsics.assumed": np.array(list(found.assumed.values()), dtype=np.float64),
        "intrinsics.place": found.adjustment.centres.place,
        "intrinsics.influence": found.adjustment.centres.influence,
        "intrinsics.stage": found.adjustment.by_group[STAGE],
    }


def _kind(name: str) -> tuple[str, str]:
    if name in FOCAL:
        return "focal_length", "px"
    return ("principal_point", "px") if name in PRINCIPAL else ("distortion", "1")


def _change(step: StepData, found: Calibration, k: int, name: str) -> Quantity:
    """Change of one parameter: of a focal length in percent, of the others as a difference."""
    reference = step.need_reference()
    names = [str(known) for known in reference.array("intrinsics.names")]
    if name not in names:
        raise NotMeasurableError(f"the reference ({reference.identity}) holds no '{name}'")
    j = names.index(name)
    then = float(reference.array("intrinsics.values")[j])
    influence = reference.array("intrinsics.influence")[:, j]
    now = found.adjustment
    repeat, dof = now.centres.variance_of_change(k, reference.array("intrinsics.place"), influence)
    stage = float(reference.array("intrinsics.stage")[j, j])
    factor, unit = (100.0 / then, "%") if name in FOCAL else (1.0, _kind(name)[1])
    return Quantity.of(
        factor * (float(found.values[k]) - then),
        unit,
        Contribution("repeatability", factor * math.sqrt(repeat), Kind.A, dof),
        Contribution(STAGE, factor * math.sqrt(max(now.by_group[STAGE][k, k], 0.0) + max(stage, 0.0)), Kind.B),
    )


METRIC = Metric(
    names=(
        "focal_length",
        "principal_point",
        "distortion",
        "focal_length_change",
        "principal_point_change",
        "distortion_change",
    ),
    evaluate=evaluate,
    remember=remember,
    expect=lambda geometry: geometry.derive(circle_plan),
    units={
        "focal_length": "px",
        "principal_point": "px",
        "distortion": "1",
        "focal_length_change": "%",
        "principal_point_change": "px",
        "distortion_change": "1",
    },
)
