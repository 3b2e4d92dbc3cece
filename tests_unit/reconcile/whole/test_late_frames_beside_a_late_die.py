"""Frames that still show the stop before, beside a delay that follows heat late: two names in one channel."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

STOPS, ZONES, FRAMES = np.linspace(-35.0, 35.0, 15), 10, 12
BOARDS = ((-30.0, 7.0, 1.2, 0.7), (-9.0, 4.0, 1.6, 0.2), (8.0, 6.0, 1.1, 0.5), (28.0, 5.0, 1.4, 0.9))
"""Bearing of the middle and half width, degrees; distance, metres; reflectance."""
DWELL_S, STOP_S = 900.0, 40.0


def scene(bearing):
    """Light and range of rays (degrees) on upright boards before a round wall, (n, rays) each."""
    far, paint = np.full(bearing.shape, 2.4), np.full(bearing.shape, 0.3)
    for middle, half, near, white in BOARDS:
        on = np.abs(bearing - middle) < half
        far, paint = np.where(on, near, far), np.where(on, white, paint)
    return 1500.0 * paint / far**2, far


def seen(bearing):
    """What zones of four degrees see: light, and the range weighted by it."""
    light, far = scene(bearing[:, None] + np.linspace(-2.0, 2.0, 81))
    return light.mean(axis=1), (light * far).sum(axis=1) / light.sum(axis=1)


def marched(setpoints, late_s):
    """Temperature of a housing that follows its setpoint, and of a die that follows the housing; each second."""
    housing, die, both = setpoints[0], setpoints[0], []
    for setpoint in np.repeat(setpoints, int(DWELL_S)):
        housing += (setpoint - housing) / 250.0
        die += (housing - die) / late_s
        both.append((housing, die))
    return np.array(both).T


def campaign(seed, *, late_share, slope_m):
    """Eight setpoints up and down, fifteen stops each; simulated without either of the two."""
    rng = np.random.default_rng(seed)
    setpoints = np.array([20.0, 40.0, 60.0, 80.0, 80.0, 60.0, 40.0, 20.0])
    housing, die = marched(setpoints, 1500.0)
    azimuth, parts = 4.0 * (np.arange(ZONES) - 4.5), []
    for step, setpoint in enumerate(setpoints):
        for k, stop in enumerate(STOPS):
            at = int(step * DWELL_S + 200.0 + STOP_S * k)
            light, far = seen(azimuth + stop)
            old_light, old_far = seen(azimuth + STOPS[max(k - 1, 0)])
            mixed = (1.0 - late_share) * light + late_share * old_light
            ranged = ((1.0 - late_share) * light * far + late_share * old_light * old_far) / mixed
            noise, jitter = np.sqrt(9.0 + light), 0.002 + 0.04 / np.sqrt(light)
            one = np.ones(ZONES)
            parts.append({
                "step": step * one, "set_temperature_c": setpoint * one, "time_s": at * one,
                "stage_angle_deg": stop * one, "azimuth_deg": azimuth, "pixel_u": np.arange(ZONES) * one,
                "housing_temperature_c": np.round(housing[at], 2) * one, "n_frames": FRAMES * one,
                "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
                "intensity_counts": mixed + noise / np.sqrt(FRAMES) * rng.normal(size=ZONES),
                "sim_distance_m": far, "sim_distance_m_std": jitter,
                "distance_m": ranged + slope_m * (die[at] - housing[at])
                + jitter / np.sqrt(FRAMES) * rng.normal(size=ZONES),
            })  # fmt: skip
    return columns_of(pa.table({name: np.concatenate([p[name] for p in parts]) for name in parts[0]}))


def test_a_delay_that_steps_tell_is_no_shape_of_what_frames_mix():
    found = diagnose(campaign(5, late_share=0.01, slope_m=0.0002))[0].findings
    assert [f.effect for f in found] == ["acquisition.frame_lag", "timing.thermal_lag"]
