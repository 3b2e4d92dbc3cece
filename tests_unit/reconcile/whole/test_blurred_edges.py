"""Light of a blurred image at edges that a fine rendering softens, against many finer rays that are scattered."""

import numpy as np
import pytest
from scipy.special import ndtri
from traced_bench import FIFTEENTHS, LIGHT, table, trace

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.effects_camera import Camera
from arl_fixtures.reconcile.effects_rays import Optics, Pose, Spots, look
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.twin.scene import SceneSettings
from tests_unit.reconcile.whole.test_seldom_names import columns_of

CAMERA = Camera(fx=58.1, fy=66.0, cx=63.5, cy=15.5, k4=0.198)
NORMAL = ndtri((np.arange(11) + 0.5) / 11)


def light_of(optics: Optics, spots: Spots, pose: Pose) -> np.ndarray:
    return look(optics, spots, pose)[0]


@pytest.mark.parametrize("sigma_px", [0.05, 0.12])
def test_a_blur_smaller_than_the_soft_edge_is_that_of_scattered_rays(sigma_px):
    u = np.arange(56.0, 72.0, 0.25)  # over the edges of three stripes
    spots = Spots(u=u, v=np.full(u.size, 14.0), stage_deg=np.full(u.size, 1.3), height_m=np.zeros(u.size))
    soft = Optics(camera=CAMERA, rays=3, soft_rad=1.0 / (3 * CAMERA.fx), scene=SceneSettings())
    dense = Optics(camera=CAMERA, rays=15, soft_rad=1.0 / (15 * CAMERA.fx), scene=SceneSettings())
    unit = NORMAL / NORMAL.std()
    scattered = np.mean([light_of(dense, spots.beside(sigma_px * du, 0.0), Pose()) for du in unit], axis=0)
    added = scattered - light_of(dense, spots, Pose())
    predicted = light_of(soft, spots, Pose(blur_px=sigma_px)) - light_of(soft, spots, Pose())
    size = np.max(np.abs(added))
    assert size > 1e-4
    assert np.max(np.abs(predicted - added)) < 0.15 * size


def test_light_from_beside_a_pixel_is_a_blur_and_no_mixture_of_what_is_in_it():
    """A tenth of the light spreads over 1.6 pixels, seen over whole ones; the simulation has nine rays in each."""
    columns = table(seed=11, angles=9, pixels=48)
    u, v, stage = (columns.numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg"))
    (own, _), (wide, _) = (trace(u, v, stage, 0.10, places=tuple(x * np.array(FIFTEENTHS))) for x in (1.0, 1.6))
    rays = trace(u, v, stage, 0.10)[0]
    columns.numbers[LIGHT] = columns.numbers[LIGHT] + columns.numbers[f"sim_{LIGHT}"] * 0.1 * (wide - own) / rays
    known = ("optics.defocus", "target.edge_mixing", "stage.zero_offset")
    findings = diagnose(columns, effects=[library()[name] for name in known])[0].findings
    assert findings[0].effect == "optics.defocus"
    assert "target.edge_mixing" not in [f.effect for f in findings]


def boards_before_a_line(brighter: float, seed: int = 3) -> Columns:
    """Three boards that move past a line of pixels: a Gaussian blur with a tail, on a grid of a 24th of a pixel."""
    rng = np.random.default_rng(seed)
    fine, pixels, steps, reach = 24, 48, 24, 5
    place, x = (np.arange(pixels * fine) + 0.5) / fine, np.arange(-reach * fine, reach * fine + 1) / fine
    core, tail = np.exp(-0.5 * (x / 0.4) ** 2), np.exp(-np.abs(x))
    spread = 0.98 * core / core.sum() + 0.02 * tail / tail.sum()
    sim, seen, surface = [], [], []
    for step in range(steps):
        nominal, real = np.full(place.size, 120.0), np.full(place.size, 120.0)
        on = np.zeros(place.size, dtype=np.int64)
        for board, (low, high, light) in enumerate([(3.0, 11.0, 300.0), (14.3, 25.0, 500.0), (28.6, 40.0, 900.0)]):
            there = (place > low + 0.37 * step - 3.0) & (place < high + 0.37 * step - 3.0)
            nominal[there], real[there], on[there] = light, light * (1.0 + brighter * (board == 1)), board + 1
        sim.append(nominal.reshape(pixels, fine).mean(axis=1))
        wide = np.convolve(np.pad(real, reach * fine, mode="edge"), spread, "valid")
        seen.append(wide.reshape(pixels, fine).mean(axis=1))
        surface.append(on[fine // 2 :: fine])
    light, step, pixel = np.concatenate(sim), *(part.ravel() for part in np.mgrid[0:steps, 0:pixels])
    error = np.sqrt(25.0 + 0.3 * light)
    columns = columns_of(
        {
            "step": step, "pixel_u": pixel, "n_frames": np.full(pixel.size, 16.0), f"sim_{LIGHT}": light,
            f"sim_{LIGHT}_std": error, f"sim_{LIGHT}_repeat_std": np.full(pixel.size, 1e-3),
            LIGHT: np.concatenate(seen) + rng.normal(0.0, error / 4.0),
        },
    )  # fmt: skip
    columns.categories["surface"] = (np.concatenate(surface), ("wall", "dark", "grey", "white"))
    return columns


def test_a_brighter_board_is_named_beside_a_blur_whose_edges_are_rough():
    """Edges are never told to the last ray; what a blur leaves there is no other strength of the paint."""
    known = ("optics.defocus", "target.reflectance_error")
    findings = diagnose(boards_before_a_line(0.01), effects=[library()[name] for name in known])[0].findings
    assert [f.effect for f in findings] == ["optics.defocus", "target.reflectance_error"]
    assert findings[1].parameters[0].value == pytest.approx(0.01, abs=0.003)
