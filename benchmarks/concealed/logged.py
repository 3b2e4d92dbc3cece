"""What a bench recording logs beside the sensor's channels: temperatures, operating data, and decoys among them."""

import numpy as np

from benchmarks.concealed.flash import Light
from benchmarks.concealed.rows import SERIALS, Design, Rows
from benchmarks.concealed.scene import SURFACES


def _per_sweep(rng: np.random.Generator, rows: Rows, sigma: float) -> np.ndarray:
    """Logger noise: one draw for all pixels of a sweep position, as the log is read once per position."""
    _, where = np.unique(rows.sweep, return_inverse=True)
    return rng.normal(0.0, sigma, size=int(where.max()) + 1)[where]


def covariates(rng: np.random.Generator, rows: Rows, design: Design, light: Light) -> dict[str, np.ndarray]:
    """Every column that a bench table may hold beside its channels."""
    housing = np.round((rows.node_c["housing"] + _per_sweep(rng, rows, 0.1)) * 10) / 10
    hot = rows.node_c["housing"] - 25.0
    tec_a = np.clip(0.030 * hot, -2.5, 2.5)
    hits = light.hits
    surface = np.array(SURFACES)[hits.surface[:, hits.surface.shape[1] // 2]]
    columns: dict[str, np.ndarray] = {
        "dut": np.array(SERIALS)[rows.dut],
        "cycle": rows.cycle,
        "step": rows.step,
        "set_temperature_c": rows.set_c,
        "ramp": rows.ramp.astype(np.int64),
        "time_s": np.round(rows.time_s, 2),
        "stage_angle_deg": np.round(rows.angle_deg, 2),
        "pixel_u": rows.u.astype(np.int64),
        "pixel_v": rows.v.astype(np.int64),
        "azimuth_deg": light.azimuth_deg,
        "elevation_deg": light.elevation_deg,
        "surface": surface,
        "mixed": np.ptp(hits.surface, axis=1) > 0,
        "true_range_m": hits.range_m[:, hits.range_m.shape[1] // 2],
        "incidence_deg": np.degrees(np.arccos(np.clip(hits.cos_incidence[:, hits.range_m.shape[1] // 2], 0, 1))),
        "reflectance": hits.reflectance[:, hits.range_m.shape[1] // 2],
        "housing_temperature_c": housing,
        "fpga_temperature_c": rows.node_c["fpga"] + _per_sweep(rng, rows, 0.1),
        "tof_temperature_c": rows.node_c["tof"] + _per_sweep(rng, rows, 0.1),
        "laser_temperature_c": rows.node_c["laser"] + _per_sweep(rng, rows, 0.1),
        "plate_temperature_c": np.round((rows.node_c["plate"] + _per_sweep(rng, rows, 0.1)) * 10) / 10,
        "coolant_temperature_c": np.round((rows.node_c["coolant"] + _per_sweep(rng, rows, 0.1)) * 10) / 10,
        "ambient_temperature_c": np.round((23.0 + _per_sweep(rng, rows, 0.1)) * 10) / 10,
        "laser_current_a": 90.0 * (1 + _per_sweep(rng, rows, 1e-3)),
        "laser_voltage_v": (24.0 - 0.01 * hot) * (1 + _per_sweep(rng, rows, 1e-3)),
        "pump_time_us": 180.0 * (1 + _per_sweep(rng, rows, 1e-3)),
        "tec_current_a": tec_a + _per_sweep(rng, rows, 2e-3),
        "tec_voltage_v": 1.2 * tec_a + _per_sweep(rng, rows, 2e-3),
    }
    if design.both_ways:
        columns["sweep_direction"] = rows.travel
    for name, volts in (("1v0", 1.0), ("1v8", 1.8), ("3v3", 3.3), ("5v0", 5.0), ("12v0", 12.0)):
        column = f"rail_{name}_v"
        true = rows.rail if column == design.rail_name else 1.0
        columns[column] = volts * true * (1 - 20e-6 * hot) * (1 + _per_sweep(rng, rows, 1e-3))
    return columns


DECOYS = (
    "laser_current_a",
    "laser_voltage_v",
    "pump_time_us",
    "tec_current_a",
    "tec_voltage_v",
    "rail_1v0_v",
    "rail_1v8_v",
    "rail_3v3_v",
    "rail_5v0_v",
    "rail_12v0_v",
    "ambient_temperature_c",
    "coolant_temperature_c",
    "plate_temperature_c",
    "fpga_temperature_c",
    "laser_temperature_c",
)
OPTIONAL = ("incidence_deg", "reflectance", "true_range_m", "mixed", "azimuth_deg", "elevation_deg", "time_s")
