"""What is measured, in which order: the rows of a bench table with the true temperatures behind each of them.

A row is one pixel at one stage angle of one temperature step of one DUT in one cycle. `Rows` holds the truth (node
temperatures, frost, hours); the logged columns are drawn from it in `logged.py`.
"""

from dataclasses import dataclass, field

import numpy as np

from benchmarks.concealed.scene import HEIGHT_PX, WIDTH_PX
from benchmarks.concealed.thermal_network import MARCH_S, STEP_S, Course, Network, march

SERIALS = ("HFL-0147", "HFL-0152", "HFL-0161")


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """Which conditions a table holds.

    `pixels` is an array (P, 2) of (u, v); `steps` indexes the 39 set points of a cycle; `cycles` are cycle counts.
    `inside_only` leaves out what lies within a pixel of an edge, as users who mask edges do.
    `both_ways` sweeps back on every second step.
    `laser_program_k` moves the laser's TEC set point per (cycle, step) so that laser and housing part company.
    """

    duts: tuple[int, ...] = (0, 1, 2)
    cycles: tuple[int, ...] = (1,)
    steps: tuple[int, ...] = tuple(range(0, 39, 3))
    angles_deg: np.ndarray = field(default_factory=lambda: np.arange(-27.0, 27.1, 5.4))
    pixels: np.ndarray = field(default_factory=lambda: np.array([[40, 8], [63, 15], [90, 24]]))
    shuffled: bool = False
    laser_program_k: float = 0.0
    rail_wander: float = 0.0
    rail_name: str = "rail_1v8_v"
    n_frames: int = 10
    network: Network = field(default_factory=Network)
    dew_point_c: float = -40.0
    dwell_s: float = 6.0
    smooth: bool = False
    both_ways: bool = False
    inside_only: bool = False


@dataclass(slots=True, kw_only=True)
class Rows:
    """Columns of equal length N; `node_c` true temperatures, `group` numbers (dut, cycle, step)."""

    dut: np.ndarray
    cycle: np.ndarray
    step: np.ndarray
    set_c: np.ndarray
    ramp: np.ndarray
    time_s: np.ndarray
    in_step_s: np.ndarray
    angle_deg: np.ndarray
    previous_angle_deg: np.ndarray
    u: np.ndarray
    v: np.ndarray
    node_c: dict[str, np.ndarray]
    frost_kg_m2: np.ndarray
    rail: np.ndarray
    group: np.ndarray
    sweep: np.ndarray
    travel: np.ndarray

    def __len__(self) -> int:
        return int(self.dut.size)

    def take(self, index: np.ndarray) -> "Rows":
        """The rows at `index` (positions or mask)."""
        values = {name: getattr(self, name) for name in self.__slots__}
        nodes = {name: value[index] for name, value in values.pop("node_c").items()}
        return Rows(node_c=nodes, **{name: value[index] for name, value in values.items()})


def random_pixels(rng: np.random.Generator, count: int, *, margin: int = 3) -> np.ndarray:
    """Distinct pixels (count, 2) spread over the image."""
    width, height = WIDTH_PX - 2 * margin, HEIGHT_PX - 2 * margin
    flat = rng.choice(width * height, size=count, replace=False)
    return np.stack([flat % width + margin, flat // width + margin], axis=1)


def block_pixels(u0: int, v0: int, width: int, height: int) -> np.ndarray:
    """All pixels of a rectangle, (width × height, 2)."""
    u, v = np.meshgrid(np.arange(u0, u0 + width), np.arange(v0, v0 + height))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def lay_out(design: Design, rng: np.random.Generator) -> Rows:
    """All rows of a design in the order dut, cycle, step, angle, pixel."""
    course = march(design.network, dew_point_c=design.dew_point_c)
    return _rows_of(design, course, rng)


def _rows_of(design: Design, course: Course, rng: np.random.Generator) -> Rows:
    angles = np.asarray(design.angles_deg, dtype=float)
    parts: list[dict[str, np.ndarray]] = []
    pixels = np.asarray(design.pixels)
    shape = (angles.size, pixels.shape[0])
    programs = rng.uniform(-1, 1, size=(len(design.cycles), 39)) * design.laser_program_k
    # a supply wanders slowly: every DUT's regulator has its own course over the steps
    wander = np.cumsum(rng.normal(size=(3, len(design.cycles), 39)), axis=2)
    wander = design.rail_wander * (wander - wander.mean(axis=2, keepdims=True)) / (wander.std() or 1.0)
    group = 0
    for dut in design.duts:
        for c, cycle in enumerate(design.cycles):
            for step in design.steps:
                order = rng.permutation(angles.size) if design.shuffled else np.arange(angles.size)
                back = design.both_ways and design.steps.index(step) % 2 == 1
                order = order[::-1] if back else order
                place = np.argsort(order)
                in_step = 0.5 * STEP_S + design.dwell_s * (place + 0.5) * min(1.0, 40.0 / angles.size)
                previous = angles[order][np.maximum(place - 1, 0)]
                at = np.minimum(((step * STEP_S + in_step) / MARCH_S).astype(int), course.time_s.size - 1)
                part = {
                    "dut": np.full(shape, dut),
                    "cycle": np.full(shape, cycle),
                    "step": np.full(shape, step),
                    "set_c": np.full(shape, course.set_c[at[0]]),
                    "ramp": np.full(shape, course.ramp[at[0]]),
                    "in_step_s": in_step[:, None] * np.ones(shape),
                    "time_s": (step * STEP_S + in_step)[:, None] * np.ones(shape),
                    "angle_deg": angles[:, None] * np.ones(shape),
                    "previous_angle_deg": previous[:, None] * np.ones(shape),
                    "u": pixels[None, :, 0] * np.ones(shape, dtype=int),
                    "v": pixels[None, :, 1] * np.ones(shape, dtype=int),
                    "group": np.full(shape, group),
                    "sweep": group * 10_000 + np.arange(angles.size)[:, None] * np.ones(shape, dtype=int),
                    "frost_kg_m2": course.frost_kg_m2[at][:, None] * np.ones(shape),
                    "travel": np.full(shape, -1 if back else 1),
                    "rail": np.full(shape, 1.0 + wander[dut, c, step]),
                }
                part |= {f"node_{n}": t[at][:, None] * np.ones(shape) for n, t in course.node_c.items()}
                part["node_laser"] = part["node_laser"] + programs[c, step]
                parts.append({name: value.ravel() for name, value in part.items()})
                group += 1
    merged = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    nodes = {name[5:]: merged.pop(name) for name in list(merged) if name.startswith("node_")}
    return Rows(node_c=nodes, **merged)
