"""Channels that only one unit has, and channels that come before the return's light by their name alone."""

import numpy as np
import pyarrow as pa
from scipy.integrate import solve_ivp

from arl_fixtures.reconcile.columns import find_channels
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def one_plate(seed, slack):
    """Three housings on one plate, whose thermometer is written beside the first; the third's contact is worse."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 9000.0, 30.0)
    plate = 20.0 + 35.0 * np.sin(2.0 * np.pi * time / 4500.0)

    def housing(resistance):
        def balance(t, h):
            return ((np.interp(t, time, plate) - h) * 25.0 / resistance + 12.0) / 900.0

        start = plate[0] + 12.0 * resistance / 25.0
        return solve_ivp(balance, (0.0, time[-1]), [start], t_eval=time, rtol=1e-8, max_step=10.0).y[0]

    unit, n = np.repeat(np.arange(3), time.size), 3 * time.size
    good, worse = housing(1.0), housing(1.0 + slack)
    assumed, real = np.tile(good, 3), np.concatenate([good, good, worse])
    read = np.tile(plate, 3) + 0.1 * rng.normal(size=n)
    return columns_of(pa.table({
        "dut": np.array(["A", "B", "C"])[unit], "step": np.tile((time // 1500.0).astype(int), 3),
        "time_s": np.tile(time, 3), "n_frames": np.full(n, 4),
        "sim_housing_temperature_c": assumed, "sim_housing_temperature_c_std": np.full(n, 0.1),
        "housing_temperature_c": real + 0.05 * rng.normal(size=n),
        "sim_plate_temperature_c": np.tile(plate, 3), "sim_plate_temperature_c_std": np.full(n, 0.2),
        "plate_temperature_c": np.where(unit == 0, read, np.nan),
    }))  # fmt: skip


def test_a_thermometer_that_is_written_beside_one_unit_hides_nothing_of_the_others():
    first = diagnose(one_plate(5, 0.3))[0].findings[0]
    assert first.effect == "thermal.contact_resistance"
    assert first.channels == ["housing_temperature_c"]


def test_light_of_the_background_and_of_monitors_comes_after_the_returns():
    names = {"ambient_counts", "signal_counts", "monitor_current_ua", "distance_m"}
    channels = find_channels(names | {f"sim_{name}" for name in names})
    assert [c.name for c in channels if c.role.value == "intensity"] == [
        "signal_counts", "ambient_counts", "monitor_current_ua",
    ]  # fmt: skip
