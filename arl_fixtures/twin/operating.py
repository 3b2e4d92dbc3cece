"""Operating data of a DUT: temperatures, currents and voltages it reports about itself."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from arl_fixtures.yaml_model import FiniteModel


class OperatingSettings(FiniteModel):
    """Nominal operating data; temperatures follow the housing temperature T_h."""

    fpga_above_housing_k: float = Field(default=14.0, description="FPGA above housing")
    tof_above_housing_k: float = Field(default=9.0, description="ToF imager above housing")
    laser_temperature_c: float = Field(default=25.0, description="the TEC holds the laser there, idle at this T_h")
    laser_per_housing: float = Field(default=0.04, description="share of T_h that the TEC lets through to the laser")
    tec_a_per_k: float = Field(default=0.030, description="TEC current per kelvin of T_h")
    tec_limit_a: float = Field(default=2.5, ge=0, description="TEC current at most, both ways")
    tec_bias_v: float = Field(default=2.5, description="both TEC voltages without current")
    tec_resistance_ohm: float = Field(default=0.6, description="TEC voltage per current, up on p, down on n")
    laser_current_a: float = Field(default=90.0, description="pulse current")
    laser_voltage_v: float = Field(default=24.0, description="at `reference_c`")
    laser_voltage_per_k: float = Field(default=-0.01, description="volts per kelvin of T_h")
    pump_time_us: float = Field(default=180.0, description="pump time")
    rails_v: dict[str, float] = Field(
        default_factory=lambda: {
            "rail_1v0_v": 1.0,
            "rail_1v8_v": 1.8,
            "rail_3v3_v": 3.3,
            "rail_5v0_v": 5.0,
            "rail_12v0_v": 12.0,
        },
        description="supply rails by signal name, at `reference_c`",
    )
    rail_ppm_per_k: float = Field(default=-20.0, description="change of all rails")
    reference_c: float = Field(default=25.0, description="T_h at which rails and laser voltage are nominal")
    relative_noise: float = Field(default=0.001, ge=0, description="of currents, voltages and times")
    temperature_noise_k: float = Field(default=0.1, ge=0, description="of temperatures")


def operating_data(
    settings: OperatingSettings, housing_c: float, generator: np.random.Generator | None = None
) -> dict[str, float]:
    """Operating data at a housing temperature.

    Args:
        settings: nominal values and slopes.
        housing_c: T_h, degrees Celsius.
        generator: source of the noise (a tenth of a percent, or 0.1 K); none gives the nominal values.

    Returns:
        Value by signal name with unit suffix, in a fixed order.
    """
    above_k = housing_c - settings.reference_c
    tec_k = housing_c - settings.laser_temperature_c
    tec_a = min(settings.tec_limit_a, max(-settings.tec_limit_a, settings.tec_a_per_k * tec_k))
    rail_factor = 1 + settings.rail_ppm_per_k * 1e-6 * above_k
    data = {
        "fpga_temperature_c": housing_c + settings.fpga_above_housing_k,
        "tof_temperature_c": housing_c + settings.tof_above_housing_k,
        "laser_temperature_c": settings.laser_temperature_c + settings.laser_per_housing * tec_k,
        "tec_current_a": tec_a,
        "tec_voltage_p_v": settings.tec_bias_v + settings.tec_resistance_ohm * tec_a,
        "tec_voltage_n_v": settings.tec_bias_v - settings.tec_resistance_ohm * tec_a,
        "laser_current_a": settings.laser_current_a,
        "laser_voltage_v": settings.laser_voltage_v + settings.laser_voltage_per_k * above_k,
        "pump_time_us": settings.pump_time_us,
        **{name: volts * rail_factor for name, volts in settings.rails_v.items()},
    }
    if generator is None:
        return data
    return {
        name: value
        + normal * (settings.temperature_noise_k if name.endswith("_c") else settings.relative_noise * abs(value))
        for (name, value), normal in zip(data.items(), generator.standard_normal(len(data)).tolist(), strict=True)
    }
