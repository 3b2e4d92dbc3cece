"""Do the metrics recover injected changes, and do their 95 % intervals cover? Many units, many seeds.

    python -m benchmarks.metric_coverage [seeds]

Each seed is a unit of its own: K, mount, chamber and every sweep's stage angles are drawn within the type B
uncertainties that the metrics are told, then the unit is swept as reference, unchanged, and with each change
injected; every sweep is rendered anew by the twin. Prints a table; `tests_unit/metrics/test_metric_coverage.py`
holds it to its promises.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.metrics.judge import judge, overall
from arl_fixtures.metrics.limits import load_limits
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.reference import Reference
from arl_fixtures.metrics.registry import all_metrics, measure, remember
from arl_fixtures.metrics.simulated import simulated_blocks
from arl_fixtures.metrics.statistics import SweepStatistics
from arl_fixtures.metrics.step import BenchUncertainty, StepData
from arl_fixtures.twin.beam import BeamSettings, PowerPatch
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.noise import NoiseSettings
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings, Mount

LIMITS = Path(__file__).parents[1] / "limits" / "default.yaml"
ANGLES_DEG = tuple(-60.0 + 0.9 * k for k in range(134))
FRAMES = 10
BENCH = BenchUncertainty()
FILE = DutSettings(serial="SN-1", dead_pixels=((5, 5), (100, 20)))
"""The DUT as its file describes it; the units differ from it."""
PATCH = PowerPatch(u=(60, 66), v=(10, 16), factor=0.95)
STRIPES = ("stripe_18", "stripe_50", "stripe_80")

ONLY_K = tuple(metric for metric in all_metrics() if "focal_length" in metric.names)
WITHOUT_K = tuple(metric for metric in all_metrics() if "focal_length" not in metric.names)


@cache
def file_geometry() -> GeometryCache:
    return GeometryCache(FILE)


@dataclass(frozen=True)
class Trial:
    """One value of one seed, against the truth."""

    case: str
    name: str
    truth: float
    value: float
    low: float
    high: float
    u: float

    @property
    def covered(self) -> bool:
        return self.low <= self.truth <= self.high


@dataclass
class SeedResult:
    trials: list[Trial] = field(default_factory=list)
    unchanged_passed: bool = False
    deciding: str = ""
    missing: int = 0


def a_unit(rng: np.random.Generator) -> DutSettings:
    k = FILE.intrinsics
    camera = k.model_copy(
        update={
            "fx": k.fx * (1 + 0.001 * rng.standard_normal()),
            "fy": k.fy * (1 + 0.001 * rng.standard_normal()),
            "cx": k.cx + 0.1 * rng.standard_normal(),
            "cy": k.cy + 0.1 * rng.standard_normal(),
            "k4": k.k4 + 0.0003 * rng.standard_normal(),
        }
    )
    turned = BENCH.mount_angle_deg * rng.standard_normal(3)
    moved = BENCH.mount_position_m * rng.standard_normal(3)
    mount = Mount(yaw_deg=turned[0], pitch_deg=turned[1], roll_deg=turned[2], forward_m=moved[0], left_m=moved[1])
    gain = float(1 + 0.03 * rng.standard_normal())
    return FILE.model_copy(update={"intrinsics": camera, "mount": mount, "height_m": moved[2], "gain": gain})


def a_chamber(rng: np.random.Generator) -> SceneSettings:
    panels = []
    for panel in SceneSettings().panels:
        radial, aside, up = BENCH.target_position_m * rng.standard_normal(3)
        certified = 1.0 if panel.circles else 1 + BENCH.reflectance_relative * rng.standard_normal()
        panels.append(
            panel.model_copy(
                update={
                    "radius_m": panel.radius_m + radial,
                    "azimuth_deg": panel.azimuth_deg + float(np.degrees(aside / panel.radius_m)),
                    "centre_z_m": panel.centre_z_m + up,
                    "reflectance": panel.reflectance * certified,
                }
            )
        )
    return SceneSettings(panels=tuple(panels))


def a_step(
    actual: DutSettings,
    scene: SceneSettings,
    rng: np.random.Generator,
    reference: Reference | None = None,
    optics: Renderer | None = None,
) -> StepData:
    off_deg = BENCH.stage_angle_deg * rng.standard_normal(len(ANGLES_DEG))
    renderer = Renderer(actual, scene, remembered_angles=1)
    if optics is not None and optics.dut.intrinsics == actual.intrinsics:
        # rays depend on K, δ and mount only, and are the dearest part of a new renderer
        renderer.__dict__["rays"] = optics.rays
    statistics = SweepStatistics(FILE.serial)
    seed = int(rng.integers(2**31))
    for block in simulated_blocks(renderer, ANGLES_DEG, frames=FRAMES, seed=seed, off_deg=off_deg):
        statistics.add(block)
    sweep = statistics.summary()
    return StepData(
        dut=FILE,
        conditions=Conditions(set_temperature_c=25.0),
        sweep=sweep,
        geometry=file_geometry().at(sweep.stage_angle_deg),
        expected_angles=len(ANGLES_DEG),
        reference=reference,
        uncertainty=BENCH,
    )


def changes(unit: DutSettings) -> dict[str, DutSettings]:
    camera = unit.intrinsics
    return {
        "unchanged": unit,
        "total power −3 %": unit.model_copy(update={"gain": unit.gain * 0.97}),
        "beam moved by 0.5°": unit.model_copy(update={"beam": BeamSettings(azimuth_shift_deg=0.5)}),
        "fx +0.1 %, cx +0.2 px": unit.model_copy(
            update={"intrinsics": camera.model_copy(update={"fx": camera.fx * 1.001, "cx": camera.cx + 0.2})}
        ),
        "local −5 % patch, 3 new dead pixels, σ_D +10 %": unit.model_copy(
            update={
                "patches": (PATCH,),
                "dead_pixels": (*unit.dead_pixels, (0, 0), (64, 16), (127, 31)),
                "noise": NoiseSettings(distance_factor=1.1),
            }
        ),
    }


def truths(case: str, unit: DutSettings, actual: DutSettings) -> dict[str, float]:
    """True value by measurement name; what a case does not touch is true for it, too."""
    before, after = Renderer(unit).power, Renderer(actual).power
    # the total is that of the pixels that see: one that died in the patch takes its part of the change with it
    alive = np.ones(before.shape, dtype=bool)
    for u, v in {*unit.dead_pixels, *actual.dead_pixels}:
        alive[v, u] = False
    relative = (after / after.mean()) / (before / before.mean()) - 1
    true = {
        "power_change": 100 * (actual.gain * after[alive].mean() / (unit.gain * before[alive].mean()) - 1),
        "power_centroid_shift[azimuth]": actual.beam.azimuth_shift_deg,
        "power_centroid_shift[elevation]": 0.0,
        "power_width_change[azimuth]": 0.0,
        "power_width_change[elevation]": 0.0,
        "focal_length_change[fx]": 100 * (actual.intrinsics.fx / unit.intrinsics.fx - 1),
        "focal_length_change[fy]": 0.0,
        "principal_point_change[cx]": actual.intrinsics.cx - unit.intrinsics.cx,
        "principal_point_change[cy]": 0.0,
        "distortion_change[k4]": 0.0,
        "focal_length[fx]": actual.intrinsics.fx,
        "focal_length[fy]": actual.intrinsics.fy,
        "principal_point[cx]": actual.intrinsics.cx,
        "principal_point[cy]": actual.intrinsics.cy,
        "distortion[k4]": actual.intrinsics.k4,
        "dead_pixels": float(len(actual.dead_pixels)),
        "distance_error_per_decade": 0.0,
    }
    if actual.intrinsics != unit.intrinsics:
        # the beam is registered in the image, so a receiver that moves is a shift of the beam, too
        # and its pixels look elsewhere, so that their mean power is another one
        for name in [name for name in true if name.startswith(("power_centroid", "power_width", "power_change"))]:
            del true[name]
    if case == "unchanged" or actual.patches:
        true["power_worst_3x3"] = 100 * relative[(PATCH.v[0] + PATCH.v[1]) // 2, (PATCH.u[0] + PATCH.u[1]) // 2]
    if case == "unchanged":
        true["power_level"] = 100 * (actual.gain * after.mean() / Renderer(FILE).power.mean() - 1)
    for stripe in STRIPES:
        true[f"distance_scatter_change[{stripe}]"] = 100 * (actual.noise.distance_factor - 1)
        true[f"distance_error[{stripe}]"] = 0.0
        if actual.gain == unit.gain and actual.beam == unit.beam:
            true[f"intensity_scatter_change[{stripe}]"] = 0.0
            if not actual.patches:
                true[f"power_target_agreement[{stripe}]"] = 0.0
    if actual.gain != unit.gain or actual.beam != unit.beam:
        # σ_D depends on the intensity: less light is a change of its own
        for stripe in STRIPES:
            del true[f"distance_scatter_change[{stripe}]"]
    return true


def trials(case: str, measured: list[Measurement], truth: dict[str, float]) -> Iterator[Trial]:
    for one in measured:
        if one.name in truth and one.quantity is not None:
            low, high = one.quantity.interval(0.95)
            yield Trial(case, one.name, truth[one.name], one.quantity.value, low, high, one.quantity.u)


def run_seed(seed: int, *, only_k: bool = False) -> SeedResult:
    """One unit, swept as reference, unchanged, and with each change; `only_k` measures nothing but K."""
    rng = np.random.default_rng((4711, seed))
    unit, scene = a_unit(rng), a_chamber(rng)
    optics = Renderer(unit, scene)
    reference = remember(a_step(unit, scene, rng, None, optics))
    result = SeedResult()
    for case, actual in changes(unit).items():
        # the calibration is what costs; where K is as it was, one case of it is enough
        with_k = case == "unchanged" or actual.intrinsics != unit.intrinsics
        if only_k and not with_k:
            continue
        step = a_step(actual, scene, rng, reference, optics)
        measured = measure(step, ONLY_K if only_k else None if with_k else WITHOUT_K)
        truth = truths(case, unit, actual)
        result.trials += trials(case, measured, truth)
        result.missing += sum(one.quantity is None for one in measured)
        if case == "unchanged" and not only_k:
            judgements = judge(measured, load_limits(LIMITS), step.conditions)
            verdict, deciding = overall(judgements)
            result.unchanged_passed = verdict == "PASS"
            result.deciding = f"{verdict} {deciding.measurement.name if deciding else ''}"
    return result


def table(results: list[SeedResult]) -> list[str]:
    grouped: dict[tuple[str, str], list[Trial]] = {}
    for result in results:
        for trial in result.trials:
            grouped.setdefault((trial.case, trial.name), []).append(trial)
    lines = [
        "| injected | measured | true | mean | standard deviation | stated u | 95 % interval covers |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for (case, name), group in grouped.items():
        errors = np.array([trial.value - trial.truth for trial in group])
        truth = np.mean([trial.truth for trial in group])
        covered = np.mean([trial.covered for trial in group])
        u = np.sqrt(np.mean([trial.u**2 for trial in group]))
        lines.append(
            f"| {case} | `{name}` | {truth:.4g} | {truth + errors.mean():.4g} | {errors.std():.2g} | {u:.2g} "
            f"| {covered:.1%} |"
        )
    passed = sum(result.unchanged_passed for result in results)
    lines += ["", f"unchanged and within all limits: {passed} of {len(results)}"]
    lines += sorted({result.deciding for result in results if not result.unchanged_passed})
    lines.append(f"not measured: {sum(result.missing for result in results)}")
    return lines


def coverage(results: list[SeedResult]) -> dict[str, tuple[int, int]]:
    """Intervals that cover and intervals in all, by measurement name, over all cases; exact values left out."""
    found: dict[str, tuple[int, int]] = {}
    for result in results:
        for trial in result.trials:
            if trial.u > 0:
                good, total = found.get(trial.name, (0, 0))
                found[trial.name] = good + trial.covered, total + 1
    return found


def kept(path: Path) -> Iterator[SeedResult]:
    for line in path.read_text("utf-8").splitlines():
        record = json.loads(line)
        yield SeedResult(**{**record, "trials": [Trial(**trial) for trial in record["trials"]]})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", type=int, nargs="?", default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first seed")
    parser.add_argument("--keep", type=Path, help="append each seed's results here, as JSON lines")
    parser.add_argument("--only-k", action="store_true", help="re-calibration alone, in a third of the time")
    parser.add_argument("--read", type=Path, nargs="+", default=[], help="read results kept earlier instead")
    options = parser.parse_args()
    results = [result for path in options.read for result in kept(path)]
    for seed in range(options.first, options.first + options.seeds) if not options.read else ():
        results.append(run_seed(seed, only_k=options.only_k))
        if options.keep:
            with options.keep.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(results[-1])) + "\n")
    print("\n".join(table(results)))
    print()
    for metric, (good, total) in coverage(results).items():
        print(f"{metric:40s} {good / total:7.2%} of {total}")


if __name__ == "__main__":
    main()
