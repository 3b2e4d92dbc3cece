"""A stage that does not stop for its frames, and a clock that stamps them late: what they show lies behind."""

import numpy as np
import pyarrow as pa
from upright_boards import COLUMNS, F_PX, seen

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = ("acquisition.frame_lag", "stage.zero_offset", "mount.tilt", "stage.periodic_error", "beam.profile_change")


def on_the_run(seed, delay_s):
    """Sweeps to and fro at four speeds, one row of pixels: every frame is where the stage was `delay_s` before."""
    rng = np.random.default_rng(seed)
    speed, place, u = (
        a.ravel()
        for a in np.meshgrid((-4.0, -1.5, 0.8, 6.0), np.arange(31) - 15.0, np.arange(COLUMNS), indexing="ij")
    )
    angle = place * 1.2
    v = np.ones(u.size)
    light, _ = seen(u, v, angle)
    real, _ = seen(u, v, angle - delay_s * speed)
    error = np.hypot(3.0, 12.0 * light)
    return columns_of(pa.table({
        "stage_angle_deg": angle, "stage_speed_deg_s": speed, "pixel_u": 1.0 * u, "pixel_v": v,
        "azimuth_deg": np.degrees(np.arctan((u - (COLUMNS - 1) / 2) / F_PX)), "elevation_deg": np.zeros(u.size),
        "time_s": 100.0 * np.searchsorted((-4.0, -1.5, 0.8, 6.0), speed) + angle / speed,
        "sim_intensity_counts": 1200.0 * light, "sim_intensity_counts_std": error,
        "intensity_counts": 1200.0 * real + error * rng.normal(size=u.size),
    }))  # fmt: skip


def test_a_late_stamp_is_told_from_a_backlash_by_the_speeds():
    findings = diagnose(on_the_run(7, 0.03), effects=[library()[n] for n in KNOWN])[0].findings
    assert [f.effect for f in findings] == ["acquisition.frame_lag"]
    delay = next(p for p in findings[0].parameters if p.name == "delay")
    assert delay.low < 0.033
    assert delay.high > 0.027
    assert findings[0].drivers[0] == "stage_speed_deg_s"
