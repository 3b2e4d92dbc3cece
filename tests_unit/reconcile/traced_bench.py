"""The nominal bench traced ray by ray, by code other than the package's: strewn pixels over a fine sweep."""

import numpy as np

from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.effects_render import rendered
from arl_fixtures.reconcile.view import View

LIGHT, RANGE = "intensity_counts", "distance_m"
STRIPES = ((7.5, 0.18), (0.0, 0.50), (-7.5, 0.80))
BOARDS = (45.0, -45.0)
THIRDS = (-1 / 3, 0.0, 1 / 3)
FIFTEENTHS = tuple((np.arange(15) - 7.0) / 15.0)


def trace(
    u, v, stage_deg, height_m, *, fx=58.1, tilt_deg=(0.0, 0.0, 0.0), forward_m=0.0, panels=True, places=THIRDS,
    arc_m=1.1, wall_m=1.6, paint=0.06, tall=0.40,
):  # fmt: skip
    """Light and range of pixels: yaw right, pitch up and roll clockwise in `tilt_deg`; `places` of its rays."""
    lights, moments = np.zeros(u.size), np.zeros(u.size)
    yaw, pitch, roll = np.radians(tilt_deg)
    for du in places:
        for dv in places:
            x, y = (u + du - 63.5) / fx, (v + dv - 15.5) / 66.0
            grow = 2.0 / (1.0 + np.sqrt(1.0 - 4.0 * 0.198 * (x * x + y * y)))
            x, y, z = x * grow, y * grow, np.ones(u.size)
            x, y, z = np.stack([x, y, z]) / np.sqrt(x * x + y * y + z * z)
            x, y = np.cos(roll) * x - np.sin(roll) * y, np.sin(roll) * x + np.cos(roll) * y
            y, z = np.cos(pitch) * y - np.sin(pitch) * z, np.sin(pitch) * y + np.cos(pitch) * z
            x, z = np.cos(yaw) * x + np.sin(yaw) * z, -np.sin(yaw) * x + np.cos(yaw) * z
            light, far = one_ray(
                np.arctan2(x, z), -y, np.radians(stage_deg), height_m, forward_m, panels, arc_m, wall_m, paint,
                tall,
            )  # fmt: skip
            lights += light / len(places) ** 2
            moments += light * far / len(places) ** 2
    return lights, moments / lights


def one_ray(azimuth, up, stage, height_m, forward_m, panels, arc_m=1.1, wall_m=1.6, paint=0.06, stripe=0.40):
    """Light and range of rays: clockwise azimuth in the sensor's frame, sine of the elevation."""
    level = np.sqrt(1.0 - up * up)
    bearing = azimuth + stage
    east, north = forward_m * np.sin(stage), forward_m * np.cos(stage)  # clockwise from the arc's centre
    b = east * np.sin(bearing) + north * np.cos(bearing)
    far = (np.sqrt(b * b + wall_m**2 - forward_m**2) - b) / level
    cosine = level * (b + far * level) / wall_m
    rho = np.full(up.shape, paint)
    targets = [(a, 0.0675, stripe, value, False) for a, value in STRIPES] + [
        (a, 0.28, 0.28, 0.05, True) for a in BOARDS
    ]
    for angle, half, tall, value, dots in targets if panels else ():
        off = bearing + np.radians(angle)
        toward = level * np.cos(off)
        ahead = arc_m - (north * np.cos(np.radians(angle)) - east * np.sin(np.radians(angle)))
        distance = np.where(toward > 0.05, ahead / np.maximum(toward, 0.05), 50.0)
        side = east * np.cos(np.radians(angle)) + north * np.sin(np.radians(angle))
        aside, above = side + distance * level * np.sin(off), height_m + distance * up
        on = (np.abs(aside) <= half) & (np.abs(above) <= tall) & (distance < far)
        shade = np.full(up.shape, value)
        if dots:
            near = [place - np.clip(np.round(place / 0.11), -2, 2) * 0.11 for place in (aside, above)]
            shade = np.where(np.hypot(*near) <= 0.035, 0.85, value)
        far, cosine, rho = np.where(on, distance, far), np.where(on, toward, cosine), np.where(on, shade, rho)
    return rho * cosine / far**2, far


def angles_of(u, v, fx=58.1):
    """Azimuth and elevation of the middle of pixels, degrees."""
    x, y = (u - 63.5) / fx, (v - 15.5) / 66.0
    grow = 2.0 / (1.0 + np.sqrt(1.0 - 4.0 * 0.198 * (x * x + y * y)))
    elevation = np.degrees(np.arcsin(-y * grow / np.sqrt(1.0 + (x * grow) ** 2 + (y * grow) ** 2)))
    return np.degrees(np.arctan(x * grow)), elevation


def table(*, seed=3, height_m=0.10, turn_deg=0.0, noise=True, angles=41, pixels=24, whole=False, **real):
    """Strewn pixels over a fine sweep in three steps: nominal simulation, `real` bench as measured.

    With `whole` the measured light moves as the pixels' areas see it, though the simulation has nine rays.
    """
    rng = np.random.default_rng(seed)
    flat = rng.choice(122 * 26, size=pixels, replace=False)
    axes = np.meshgrid(np.arange(3), np.linspace(-18.0, 18.0, angles), np.arange(pixels), indexing="ij")
    step, stage, which = (axis.ravel() for axis in axes)
    u, v = (flat % 122 + 3.0)[which], (flat // 122 + 3.0)[which]
    own = {n: real[n] for n in ("fx", "panels", "arc_m", "wall_m", "paint", "places", "tall") if n in real}

    def seen(turn, **bench):
        first = step == 0  # steps repeat what is seen
        return np.tile(trace(u[first], v[first], stage[first] + turn, height_m, **bench), 3)

    sim_light, sim_far = seen(0.0, **own)
    light, far = seen(turn_deg, **real)
    if whole:
        (here, near), (there, away) = (
            seen(turn, places=FIFTEENTHS, **other) for turn, other in ((0.0, own), (turn_deg, real))
        )
        light, far = sim_light + (there - here), sim_far + (away - near)
    azimuth, elevation = angles_of(u, v, real.get("fx", 58.1))
    beam = 4000.0 * 1.1**2 * np.exp(-((azimuth / 75.0) ** 4) - (elevation / 18.0) ** 4)
    error = np.sqrt(36.0 + 0.25 * beam * sim_light + (0.004 * beam * sim_light) ** 2)
    blur = np.hypot(0.004, 0.30 * error / (beam * sim_light))
    numbers = {
        "step": step, "stage_angle_deg": stage, "pixel_u": u, "pixel_v": v, "azimuth_deg": azimuth,
        "elevation_deg": elevation, "n_frames": np.full(u.size, 10.0), "time_s": 1200.0 * step + 10.0 * stage,
        f"sim_{LIGHT}": beam * sim_light, f"sim_{LIGHT}_std": error, f"sim_{RANGE}": sim_far,
        f"sim_{RANGE}_std": blur,
        LIGHT: beam * light + noise * rng.normal(0.0, error / np.sqrt(10.0)),
        RANGE: far + noise * rng.normal(0.0, blur / np.sqrt(10.0)),
    }  # fmt: skip
    numbers = {name: np.asarray(values, dtype=float) for name, values in numbers.items()}
    return Columns(
        n=u.size, numbers=numbers, categories={"dut": (np.zeros(u.size, dtype=np.int64), ("a",))},
        channels=find_channels(set(numbers)),
    )  # fmt: skip


def seen_as_measured(columns, pose):
    """Share of the rows whose light, rendered in a pose, is the measured one within a permille."""
    view = View(columns)
    there, here = rendered(view, pose), rendered(view)
    light = view.sim[LIGHT] * there[LIGHT] / here[LIGHT]
    far = view.sim[RANGE] + there[RANGE] - here[RANGE]
    return np.mean((np.abs(light / view.number(LIGHT) - 1.0) < 1e-3) & (np.abs(far - view.number(RANGE)) < 1e-4))


def with_surfaces(columns, *, arc_m, wall_m):
    """The table with a column that names what each row looks at."""
    numbers = columns.numbers
    level = numbers[f"sim_{RANGE}"] * np.cos(np.radians(numbers["elevation_deg"]))
    bearing = numbers["azimuth_deg"] + numbers["stage_angle_deg"]
    off = np.abs(bearing[:, None] + np.array([*(angle for angle, _ in STRIPES), *BOARDS]))
    code = np.where(level > 0.5 * (arc_m + wall_m), 5, np.argmin(off, axis=1)).astype(np.int64)
    names = ("stripe_18", "stripe_50", "stripe_80", "intrinsic_left", "intrinsic_right", "wall")
    columns.categories["surface"] = (code, names)
    return columns
