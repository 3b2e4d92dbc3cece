"""A bench rendered ray by ray, for tests: its own geometry, shared with nothing in the package.

Three panels on a circle of 1.1 m before a cylinder of 1.6 m, seen by a pinhole camera on a turning stage. Every pixel
averages 61 rays side by side. What a test changes here (a turned camera, a moved axis, another reflectance) is the
truth that an effect's operator has to reproduce from the unchanged rendering alone.
"""

from dataclasses import dataclass, field

import numpy as np

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.effect import Variant
from arl_fixtures.reconcile.view import View

FX, FY, CU, CV = 58.1, 66.0, 63.5, 15.5
PANELS = {"stripe_18": (7.5, 0.18), "stripe_50": (0.0, 0.50), "stripe_80": (-7.5, 0.80)}
ACROSS = (np.arange(61) - 30.0) / 61.0


@dataclass(frozen=True)
class Camera:
    """What can be wrong with geometry and beam."""

    zoom: float | np.ndarray = 1.0
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    forward_m: float = 0.0
    right_m: float = 0.0
    fixed_to_bench: bool = False
    beam: tuple[float, float, float, float] = (75.0, 18.0, 0.0, 0.0)
    reflectance: dict[str, float] = field(default_factory=dict)


def rotate(x, y, z, camera):
    """Rays (right, down, forward) of a camera that is turned: roll, then pitch (up), then yaw (to the right)."""
    roll, pitch, yaw = np.radians([camera.roll_deg, camera.pitch_deg, camera.yaw_deg])
    x, y = x * np.cos(roll) - y * np.sin(roll), x * np.sin(roll) + y * np.cos(roll)
    y, z = y * np.cos(pitch) - z * np.sin(pitch), y * np.sin(pitch) + z * np.cos(pitch)
    x, z = x * np.cos(yaw) + z * np.sin(yaw), -x * np.sin(yaw) + z * np.cos(yaw)
    return x, y, z


def render(u, v, stage_deg, camera=None):
    """Signal, distance, surface index (3 = wall), mixed, incidence and range of pixels at stage angles."""
    camera = camera or Camera()
    poses = camera.yaw_deg, camera.pitch_deg, camera.roll_deg, camera.forward_m, camera.right_m
    if any(np.ndim(of_rows) for of_rows in (camera.zoom, *poses, *camera.beam)):
        return rendered(u, v, stage_deg, camera)
    # what is seen at several steps alike is rendered once
    sights, rows = np.unique(np.stack(np.broadcast_arrays(u, v, stage_deg)), axis=1, return_inverse=True)
    return {name: values[..., rows.ravel()] for name, values in rendered(*sights, camera).items()}


def rendered(u, v, stage_deg, camera):
    """The same, row by row."""
    light, far, near, tilt = [], [], [], []
    for du in ACROSS:
        x, y, z = (u + du - CU) / (FX * camera.zoom), (v - CV) / (FY * camera.zoom), np.ones_like(u)
        norm = np.sqrt(x**2 + y**2 + z**2)
        x, y, z = rotate(x / norm, y / norm, z / norm, camera)
        heading = np.radians(stage_deg) + np.arctan2(x, z)
        level = np.sqrt(1.0 - y**2)
        ray = np.stack([level * np.cos(heading), -level * np.sin(heading), -y])
        forward = 0.0 if camera.fixed_to_bench else np.radians(stage_deg)
        origin = np.stack(
            [
                camera.forward_m * np.cos(forward) - camera.right_m * np.sin(forward) + np.zeros_like(u),
                -camera.forward_m * np.sin(forward) - camera.right_m * np.cos(forward) + np.zeros_like(u),
            ]
        )
        a = ray[0] ** 2 + ray[1] ** 2
        b = origin[0] * ray[0] + origin[1] * ray[1]
        range_ = (-b + np.sqrt(b**2 - a * (origin[0] ** 2 + origin[1] ** 2 - 1.6**2))) / a
        hit = origin + range_ * ray[:2]
        cosine = (hit[0] * ray[0] + hit[1] * ray[1]) / 1.6
        seen = np.full(u.shape, 3)
        rho = np.full(u.shape, camera.reflectance.get("wall", 0.06))
        for index, (name, (azimuth, value)) in enumerate(PANELS.items()):
            angle = np.radians(azimuth)
            nx, ny = np.cos(angle), np.sin(angle)
            toward = ray[0] * nx + ray[1] * ny
            distance = (1.1 - origin[0] * nx - origin[1] * ny) / toward
            across = -(origin[0] + distance * ray[0]) * ny + (origin[1] + distance * ray[1]) * nx
            on = (np.abs(across) < 0.0675) & (distance > 0.0) & (distance < range_)
            range_, cosine = np.where(on, distance, range_), np.where(on, toward, cosine)
            seen, rho = np.where(on, index, seen), np.where(on, camera.reflectance.get(name, value), rho)
        weight = rho * cosine * (1.1 / range_) ** 2
        light.append(weight)
        far.append(range_)
        near.append(seen)
        tilt.append(cosine)
    weight, range_, seen = np.array(light), np.array(far), np.array(near)
    x, y = (u - CU) / (FX * camera.zoom), (v - CV) / (FY * camera.zoom)
    azimuth, elevation = np.degrees(np.arctan(x)), -np.degrees(np.arctan(y / np.sqrt(1.0 + x**2)))
    width_az, width_el, shift_az, shift_el = camera.beam
    beam = np.exp(-(((azimuth - shift_az) / width_az) ** 4) - ((elevation - shift_el) / width_el) ** 4)
    middle = len(light) // 2
    return {
        "intensity_counts": 4000.0 * beam * weight.mean(axis=0),
        "distance_m": (weight * range_).sum(axis=0) / weight.sum(axis=0),
        "surface": seen[middle],
        "mixed": (seen != seen[0]).any(axis=0),
        "incidence_deg": np.degrees(np.arccos(np.clip(tilt[middle], -1.0, 1.0))),
        "true_range_m": range_[middle],
        "azimuth_deg": azimuth,
        "elevation_deg": elevation,
        "ray_weight": weight,
        "ray_range_m": range_,
    }


def grid(*, columns=(52, 76), rows=(10, 18), angles=(-9.0, 9.0, 21), steps=2, duts=1, cycles=1, back_and_forth=False):
    """Index columns of a table in acquisition order: every pixel at every angle of every step."""
    axes = [
        np.arange(duts),
        np.arange(cycles),
        np.arange(steps),
        np.arange(angles[2]),
        np.arange(*columns),
        np.arange(*rows),
    ]
    dut, cycle, step, place, u, v = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    order = np.where(back_and_forth & (step % 2 == 1), angles[2] - 1 - place, place)
    half = np.interp(step, [0, steps / 2, max(steps - 1, 1)], [-10.0, 85.0, -10.0])
    return {
        "dut": dut,
        "cycle": cycle.astype(float),
        "step": step.astype(float),
        "stage_angle_deg": np.linspace(*angles)[order],
        "pixel_u": u.astype(float),
        "pixel_v": v.astype(float),
        "time_s": 1200.0 * step + 10.0 * place + 5.0,
        "set_temperature_c": half,
        "ramp": np.where(step < steps / 2, 1.0, -1.0),
    }


def make_columns(numbers, labels, shuffle=7):
    """A table in memory; rows in random order, as the format promises none."""
    n = len(next(iter(numbers.values())))
    order = np.arange(n) if shuffle is None else np.random.default_rng(shuffle).permutation(n)
    categories = {}
    for name, values in labels.items():
        found, codes = np.unique(np.asarray(values)[order], return_inverse=True)
        categories[name] = (codes.astype(np.int64), tuple(str(label) for label in found))
    taken = {name: np.asarray(values, dtype=float)[order] for name, values in numbers.items()}
    return Columns(n=n, numbers=taken, categories=categories, channels=find_channels(set(taken))), order


def bench(camera=None, **size):
    """A full table: nominal simulation, temperatures, rails; and the rendering of `camera` as what was measured."""
    index = grid(**size)
    where = index["pixel_u"], index["pixel_v"], index["stage_angle_deg"]
    sim = render(*where)
    real = render(*where, camera) if camera is not None else sim
    rng = np.random.default_rng(3)
    housing = index["set_temperature_c"] + 3.0 + 0.5 * np.sin(index["time_s"] / 400.0)
    n = housing.size
    numbers = {name: values for name, values in index.items() if name != "dut"}
    numbers |= {name: sim[name] for name in ("incidence_deg", "true_range_m", "azimuth_deg", "elevation_deg")}
    rho = np.array([value for _, value in PANELS.values()] + [0.06])
    numbers |= {
        "reflectance": rho[sim["surface"]],
        "housing_temperature_c": housing,
        "fpga_temperature_c": housing + 14.0,
        "tof_temperature_c": housing + 9.0 + rng.normal(0.0, 0.1, n),
        "laser_temperature_c": 25.0 + 0.04 * (housing - 25.0),
        "plate_temperature_c": index["set_temperature_c"],
        "rail_1v8_v": 1.8 + rng.normal(0.0, 0.002, n),
        "laser_current_a": 90.0 + rng.normal(0.0, 0.1, n),
        "n_frames": np.full(n, 10.0),
        "sim_valid_fraction": np.ones(n),
        "sim_intensity_counts": sim["intensity_counts"],
        "sim_distance_m": sim["distance_m"],
    }
    noise = np.sqrt(36.0 + 0.25 * sim["intensity_counts"] + (0.004 * sim["intensity_counts"]) ** 2)
    numbers["sim_intensity_counts_std"] = noise
    numbers["sim_distance_m_std"] = np.hypot(0.004, 0.30 * noise / sim["intensity_counts"])
    for name in ("valid_fraction", "intensity_counts_std", "distance_m_std"):
        numbers[name] = numbers[f"sim_{name}"].copy()
    numbers |= {"intensity_counts": real["intensity_counts"], "distance_m": real["distance_m"]}
    names = np.array([*PANELS, "wall"])
    labels = {
        "dut": np.array([f"dut_{k}" for k in range(9)])[index["dut"]],
        "surface": names[sim["surface"]],
        "mixed": np.where(sim["mixed"], "true", "false"),
    }
    return make_columns(numbers, labels)[0]


def variant_of(view: View, effect: str, **options) -> Variant:
    """The first variant of an effect that has these options."""
    for variant in library()[effect].variants(view):
        if all(variant.options.get(name) == value for name, value in options.items()):
            return variant
    raise LookupError(f"{effect} has no variant {options} here")


def corrected(view: View, variant: Variant, **values):
    """State after the effect, parameters that are not given at their default (amplitudes null)."""
    filled = {p.name: (p.null if p.is_amplitude else p.starts[0]) for p in variant.parameters}
    unknown = set(values) - set(filled)
    if unknown:
        raise LookupError(f"{variant.label} has no parameter {unknown}")
    state = view.fresh_state()
    library()[variant.effect].apply(variant, filled | values, state, view)
    return state


def left_over(view: View, state, channel: str) -> float:
    """Share of the squared mismatch of a channel that the state leaves unexplained."""
    measured, sim = view.number(channel), view.sim[channel]
    return float(np.nansum((measured - state[channel]) ** 2) / np.nansum((measured - sim) ** 2))
