"""A lens darkens the corners of the laser's image and of the sun's: one cause, though a passband would do for one."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[name] for name in ("optics.filter_shift", "optics.vignetting", "beam.profile_change",
         "laser.power_decay", "target.reflectance_error")]  # fmt: skip


def open_share(angle_deg, rear_m=0.0082, apart_m=0.0006):
    """Share of the front pupil's rays, a fine grid of them, that also find their way through the rear pupil."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 161), np.linspace(-1.0, 1.0, 161))
    inside = np.hypot(x, y) <= 1.0
    x, y = 0.0082 * x[inside], 0.0082 * y[inside]
    return np.mean(np.hypot(x + apart_m * np.tan(np.radians(angle_deg))[:, None], y) <= rear_m, axis=1)


def camera(seed):
    """Thirty-six by sixteen pixels of a wide camera; laser light goes through the two pupils on both ways."""
    rng = np.random.default_rng(seed)
    stop, u, v = (x.ravel() for x in np.meshgrid(np.arange(5), np.arange(36), np.arange(16), indexing="ij"))
    azimuth, elevation = 2.3 * (u - 17.5), 2.3 * (v - 7.5)
    field = np.degrees(np.arccos(np.cos(np.radians(azimuth)) * np.cos(np.radians(elevation))))
    clear = np.interp(field, np.linspace(0.0, 60.0, 121), open_share(np.linspace(0.0, 60.0, 121)))
    paint = np.array([0.08, 0.2, 0.35, 0.6, 0.85])[(u // 5 + 3 * (v // 4) + 2 * stop) % 5]
    light = 900.0 * paint * np.exp(-((field / 45.0) ** 2))
    sun = 380.0 * paint * (0.4 + 0.6 * (stop + 1.0) / 5.0)
    table = {
        "stage_angle_deg": 15.0 * (stop - 2.0), "pixel_u": u, "pixel_v": v, "azimuth_deg": azimuth,
        "elevation_deg": elevation, "reflectance": paint, "n_frames": np.full(u.size, 10.0),
    }  # fmt: skip
    for name, sim, ways in (("intensity_counts", light, 2), ("ambient_counts", sun, 1)):
        noise = np.sqrt(25.0 + 0.6 * sim)
        table |= {f"sim_{name}": sim, f"sim_{name}_std": noise,
                  name: sim * clear**ways + noise / np.sqrt(10.0) * rng.normal(size=u.size)}  # fmt: skip
    return columns_of(pa.table(table))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_lens_that_darkens_both_lights_is_one_cause(seed):
    (found,) = diagnose(camera(seed), effects=KNOWN)[0].findings
    assert found.effect == "optics.vignetting"
    assert set(found.channels) == {"intensity_counts", "ambient_counts"}
