"""A sensor on a stage whose table gives pixels and stage angles, but not where a pixel looks: the sweep tells."""

import numpy as np
import pyarrow as pa
import pytest
from upright_boards import BOARDS, COLUMNS, F_PX, ROWS, seen

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.derived_rays import derive_rays
from arl_fixtures.reconcile.model_state import terms_of
from arl_fixtures.reconcile.page_parts import rays_of
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

KNOWN = ("mount.tilt", "stage.zero_offset", "beam.profile_shift")


def table(seed, *, zero=0.0, roll=0.0, angles=15, rows=ROWS, frames=10.0):
    rng = np.random.default_rng(seed)
    dut, angle, u, v = (
        a.ravel().astype(float)
        for a in np.meshgrid(
            np.arange(2), np.linspace(-25.0, 25.0, angles), np.arange(COLUMNS), np.arange(rows), indexing="ij"
        )
    )
    beam = 3000.0 * np.exp(-(((u - 14.5) / 24.0) ** 2))
    once = dut == 0.0  # both devices see the same but for what is off
    light, far = (np.tile(x, 2) for x in seen(u[once], v[once], angle[once]))
    bearing = np.degrees(np.arctan((u - 14.5) / F_PX)) + angle
    surface = np.select([np.abs(bearing - board[0]) < board[1] for board in BOARDS], list("abcd"), "wall")
    real_light, real_far = seen(u, v, angle + zero, roll=roll * dut)
    error, blur = np.hypot(3.0, 0.01 * beam * light), np.full(u.size, 0.004)
    noise = rng.normal(size=(2, u.size)) / np.sqrt(frames)
    return {
        "dut": np.array(["A", "B"])[dut.astype(int)], "stage_angle_deg": angle, "pixel_u": u, "pixel_v": v,
        "surface": surface,
        "n_frames": np.full(u.size, frames), "sim_intensity_counts": beam * light, "sim_intensity_counts_std": error,
        "sim_distance_m": far, "sim_distance_m_std": blur,
        "intensity_counts": beam * real_light + error * noise[0], "distance_m": real_far + blur * noise[1],
    }  # fmt: skip


def found_in(made):
    found, model, _ = diagnose(columns_of(pa.table(made)), effects=[library()[name] for name in KNOWN])
    return found.findings, model


def test_a_sweep_tells_the_camera():
    columns = columns_of(pa.table(table(1, rows=1)))
    assert derive_rays(columns)
    assert columns.lens["fx"] == pytest.approx(F_PX, rel=0.02)
    assert "1.43°" in rays_of(columns)[0][1]  # what the page says of it
    x = columns.numbers["pixel_u"] - (COLUMNS - 1) / 2
    np.testing.assert_allclose(columns.derived["azimuth_deg"], np.degrees(np.arctan(x / F_PX)), atol=0.25)


def test_pixels_that_see_no_common_scene_tell_none():
    made = table(2, rows=1)
    rng = np.random.default_rng(2)
    shuffled = rng.permutation(COLUMNS)[made["pixel_u"].astype(int)].astype(float)
    assert not derive_rays(columns_of(pa.table({**made, "pixel_u": shuffled})))


def test_a_zero_offset_is_found_without_rays():
    """By its class, which a yaw of both devices shares."""
    findings, _ = found_in(table(3, zero=0.012, angles=10, rows=1, frames=45.0))
    (found,) = findings
    assert {"stage.zero_offset", "mount.tilt"} >= {found.effect, *found.equivalent_to}
    assert found.parameters[0].value == pytest.approx(0.012, rel=0.4)


def test_a_roll_of_one_device_is_found_and_its_model_needs_no_sweep():
    findings, model = found_in(table(4, roll=1.5))
    assert [f.effect for f in findings] == ["mount.tilt"]
    assert findings[0].where["dut"] == ["B"]
    roll = next(p.value for p in findings[0].parameters if p.name == "roll")
    assert roll == pytest.approx(1.5, rel=0.25)  # curves through pixels of several widths are not quite sharp
    few = table(5, angles=3)
    unseen = columns_of(pa.table({n: x for n, x in few.items() if n not in {"intensity_counts", "distance_m"}}),
                        for_prediction=True)  # fmt: skip
    terms_of(model, View(unseen), "model.yaml")
    assert unseen.lens == model.lens != {}
