"""Tables that hold a few rays only: what a ray saw before, or beside, is not in them."""

import numpy as np
import pyarrow as pa
import pytest
from traced_bench import LIGHT, RANGE, table, trace

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def reseen(columns, turn_deg, share, keep, **more):
    """The table with a share of its frames seen at `turn_deg` further on; rows of `keep`; `more` columns."""
    numbers = {name: values.copy() for name, values in columns.numbers.items()}
    u, v, stage = (numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg"))
    here, near = trace(u, v, stage, 0.10)
    there, far = trace(u, v, stage + turn_deg, 0.10)
    seen = (1.0 - share) * here + share * there
    numbers[RANGE] = numbers[RANGE] + ((1.0 - share) * near + share * far) - near
    numbers[LIGHT] = numbers[LIGHT] + numbers[f"sim_{LIGHT}"] * (seen / here - 1.0)
    numbers |= more
    return Columns(
        n=int(keep.sum()), numbers={name: values[keep] for name, values in numbers.items()},
        categories={name: (codes[keep], labels) for name, (codes, labels) in columns.categories.items()},
        channels=columns.channels,
    )  # fmt: skip


def test_stale_frames_are_found_though_the_ray_before_was_left_out():
    """Angles in any order; a thin sample of rows, so that a ray's own last angle is seldom among them."""
    rng = np.random.default_rng(6)
    columns = table(seed=6, angles=9, pixels=48)
    angles = np.unique(columns.numbers["stage_angle_deg"])
    place = np.searchsorted(angles, columns.numbers["stage_angle_deg"])
    turns = np.stack([rng.permutation(angles.size) for _ in range(3)])  # the order of each step's angles
    rank = np.argsort(turns, axis=1)[columns.numbers["step"].astype(int), place]
    before = np.where(rank > 0, angles[turns[columns.numbers["step"].astype(int), rank - 1]], angles[place])
    columns.numbers["time_s"] = 1200.0 * columns.numbers["step"] + 20.0 * rank
    made = reseen(columns, before - angles[place], 0.03, rng.random(columns.n) < 0.3, previous_stage_angle_deg=before)
    known = ("acquisition.frame_lag", "optics.veiling_glare", "stage.zero_offset", "stage.periodic_error")
    (found,) = diagnose(made, effects=[library()[name] for name in known])[0].findings
    assert found.effect == "acquisition.frame_lag"
    share = next(p for p in found.parameters if p.name == "share")
    assert share.low < 0.03 < share.high


def test_a_stage_that_is_right_one_way_only_has_play():
    """Nine rays a pixel: half of the play is not half of what changes."""
    columns = table(seed=7, angles=15, pixels=20)
    way = np.where(np.isin(columns.numbers["step"], [1.0]), -1.0, 1.0)
    made = reseen(columns, np.where(way < 0.0, 0.05, 0.0), 1.0, np.ones(columns.n, dtype=bool), travel_direction=way)
    known = ("stage.zero_offset", "stage.periodic_error", "target.edge_mixing", "mount.tilt")
    (found,) = diagnose(made, effects=[library()[name] for name in known])[0].findings
    assert found.effect == "stage.zero_offset"
    (play,) = found.parameters
    assert abs(play.value - 0.05) < 0.01


def test_a_clock_line_seen_at_every_third_column_is_no_pattern_of_three():
    """A pulse runs down a ladder of resistors and capacitors: late at its far end, and less and less so."""
    rng = np.random.default_rng(11)
    columns, rows, steps = (
        a.ravel() for a in np.meshgrid(np.arange(0, 128, 3), np.arange(1, 32, 3), np.arange(12), indexing="ij")
    )
    resistance, capacity = np.ones(128), np.ones(128)
    behind = np.cumsum(capacity[::-1])[::-1]  # what each resistor charges
    late = np.cumsum(resistance * behind)  # Elmore's delay
    late = 0.0025 * (late - late[0]) / (late[-1] - late[0])
    error = np.full(columns.size, 0.004)
    made = columns_of(pa.table({
        "step": steps, "pixel_u": columns, "pixel_v": rows, "n_frames": np.full(columns.size, 10.0),
        "sim_distance_m": 1.5 + 0.001 * rows, "sim_distance_m_std": error,
        "distance_m": 1.5 + 0.001 * rows + late[columns] + error * rng.normal(size=columns.size) / np.sqrt(10.0),
    }))  # fmt: skip
    (found,) = diagnose(made)[0].findings
    assert found.effect == "timing.row_skew"
    assert abs(next(p for p in found.parameters if p.name == "bend").value - 0.5) < 0.1


def boards(stale, came, **records):
    """Boards at all depths before a camera: no curve joins what rays see, and few rows have their sweep's last.

    Args:
        stale: share of frames of the angle before; came: ±1 by which way the stage came to it, by step.
        records: of each row what tells the order, as functions of step and angle.
    """
    rng = np.random.default_rng(8)
    step, angle, u, v = (
        a.ravel() for a in np.meshgrid(np.arange(8), 2.0 * np.arange(9) - 8.0, np.arange(24), np.arange(6),
                                       indexing="ij")
    )  # fmt: skip
    depth, paint = rng.uniform(2.0, 12.0, (40, 6)), rng.uniform(0.1, 0.9, (40, 6))

    def look(stage):
        """Boards of three pixels' width; a pixel a degree wide at most sees two, by the part of each in it."""
        edge = (u + stage + 12.0) / 3.0
        board = np.floor(edge).astype(int)
        part = np.clip(3.0 * (edge - board) - 2.0, 0.0, 1.0)
        lights = [paint[b, v] / depth[b, v] ** 2 for b in (board, board + 1)]
        light = (1.0 - part) * lights[0] + part * lights[1]
        far = ((1.0 - part) * lights[0] * depth[board, v] + part * lights[1] * depth[board + 1, v]) / light
        return far, 2e5 * light

    far, light = look(angle)
    far_before, light_before = look(np.clip(angle - 2.0 * came(step), -8.0, 8.0))  # the first has none before
    sigma = {"distance_m": 0.01 + 0.002 * far, "intensity_counts": np.sqrt(light + 20.0)}
    seen = {
        "distance_m": far + stale * (far_before - far), "intensity_counts": light + stale * (light_before - light),
    }  # fmt: skip
    made = {
        "step": step, "stage_angle_deg": angle, "pixel_u": u, "pixel_v": v, "azimuth_deg": u - 12.0,
        "elevation_deg": v - 2.5, "n_frames": np.full(step.size, 16.0),
        "sim_distance_m": far, "sim_intensity_counts": light,
        **{name: value(step, angle) for name, value in records.items()},
    }  # fmt: skip
    for name, values in seen.items():
        made[f"sim_{name}_std"] = sigma[name]
        made[name] = values + sigma[name] * rng.normal(size=step.size) / 4.0
    kept = rng.random(step.size) < 0.08
    return columns_of(pa.table({name: values[kept] for name, values in made.items()}))


def there_and_back(step):
    return np.where(step % 2 == 0, 1.0, -1.0)


@pytest.mark.parametrize(
    ("came", "record"),
    [
        (np.ones_like, {"time_s": lambda step, angle: 600.0 * step + 10.0 * angle}),
        (there_and_back, {"sweep_direction": lambda step, _angle: there_and_back(step)}),
    ],
    ids=["by time", "by a column"],
)
def test_what_a_ray_saw_before_is_told_by_the_steps_that_kept_it(came, record):
    (found,) = diagnose(boards(0.01, came, **record))[0].findings
    assert found.effect == "acquisition.frame_lag"
    share = next(p for p in found.parameters if p.name == "share")
    assert share.low < 0.01 < share.high


def test_a_ghost_of_pixels_that_the_table_lacks_is_as_strong_where_others_stand_for_them():
    """One pixel in twenty of an image of boards: the mirrored one is hardly ever among them, but its board is."""
    rng = np.random.default_rng(12)
    u, v = np.meshgrid(np.arange(64), np.arange(48), indexing="ij")
    board = (u // 9, v // 9)
    far, paint = rng.uniform(2.0, 9.0, (8, 6))[board], rng.uniform(0.05, 0.9, (8, 6))[board]
    light = 2e4 * paint / far**2
    stray = 2e-3 * light[::-1, ::-1]  # off two faces of the window, mirrored about the image's centre
    seen = (light * far + stray * far[::-1, ::-1]) / (light + stray)
    kept = np.flatnonzero(rng.random(u.size) < 0.05)
    step, place = (a.ravel() for a in np.meshgrid(np.arange(6), kept, indexing="ij"))
    across, down = u.ravel()[place], v.ravel()[place]
    made = {
        "step": step, "pixel_u": across, "pixel_v": down, "azimuth_deg": across - 31.5, "elevation_deg": down - 23.5,
        "n_frames": np.full(step.size, 20.0),
    }  # fmt: skip
    for name, simulated, real, sigma in (
        ("intensity_counts", light, light + stray, np.sqrt(light + 30.0)),
        ("distance_m", far, seen, 0.004 + 0.001 * far),
    ):
        made[f"sim_{name}"], made[f"sim_{name}_std"] = simulated.ravel()[place], sigma.ravel()[place]
        made[name] = real.ravel()[place] + sigma.ravel()[place] * rng.normal(size=step.size) / np.sqrt(20.0)
    (found,) = diagnose(columns_of(pa.table(made)))[0].findings
    assert found.effect == "optics.ghost"
