"""What a column is, told from its name alone: role of a channel, unit of a suffix."""

from __future__ import annotations

import re
from enum import Enum

UNIT_SUFFIXES = {
    "counts": "counts", "m": "m", "mm": "mm", "cm": "cm", "km": "km", "um": "um", "nm": "nm", "deg": "deg",
    "rad": "rad", "c": "°C", "k": "K", "s": "s", "ms": "ms", "us": "us", "ns": "ns", "ps": "ps", "min": "min",
    "h": "h", "v": "V", "mv": "mV", "uv": "uV", "a": "A", "ma": "mA", "ua": "uA", "na": "nA", "w": "W", "mw": "mW",
    "uw": "uW", "nw": "nW", "j": "J", "mj": "mJ", "uj": "uJ", "nj": "nJ", "hz": "Hz", "khz": "kHz", "mhz": "MHz",
    "ghz": "GHz", "pa": "Pa", "hpa": "hPa", "bar": "bar", "pct": "%", "percent": "%", "px": "px", "cps": "1/s",
    "kcps": "1/s", "mcps": "1/s", "lux": "lx", "ohm": "Ohm", "g": "g", "kg": "kg", "n": "N", "rpm": "1/min",
    "db": "dB", "dbm": "dBm", "cnt": "counts", "kcnt": "counts", "adu": "counts", "dn": "counts", "lsb": "counts",
    "electrons": "counts", "photons": "counts", "pe": "counts", "degc": "°C", "celsius": "°C",
}  # fmt: skip
"""Suffix after the last underscore to the unit it stands for."""

_NO_UNIT = frozenset({"pixel_u", "pixel_v"})
"""Numbers of a column and a row: their last letter is no unit."""
_SIGNAL_WORDS = (
    "intensity", "signal", "photo", "amplitude", "power", "optical", "radiance", "light", "return", "echo",
    "brightness", "flux", "luminance", "emission", "transmittance", "transmission", "responsivity", "reflected",
    "throughput", "irradiance", "fluorescence",
)  # fmt: skip
_SIGNAL_NAMES = frozenset(
    {"counts", "cnt", "adu", "dn", "electrons", "hits", "events", "grey", "gray", "strength", "peak", "amp"}
)
"""Words that name light only when they stand alone between underscores: `lamp_v` is no amplitude."""
_DETECTOR_NAMES = frozenset({"monitor", "pd", "mpd", "apd", "pmt", "sipm", "spad", "dc", "dark", "anode", "cathode"})
_CURRENTS = {"a", "ma", "ua", "na"}
"""A detector's current is light: a laser's monitor diode, say."""
_SIGNAL_UNITS = {
    "counts", "cnt", "kcnt", "adu", "dn", "lsb", "electrons", "photons", "pe", "cps", "kcps", "mcps",
    "w", "mw", "uw", "nw", "j", "mj", "uj", "nj", "lux",
}  # fmt: skip
_POWERS = {"", "w", "mw", "uw"}
_READ_IN = {"", "a", "ma", "ua", "na", "v", "mv", "uv", "hz", "khz", "mhz", "pct", "percent"}
LIGHT_SPEED_M_S = 299_792_458.0
_PER_METRE = {
    "m": 1.0, "mm": 1e3, "cm": 1e2, "km": 1e-3, "ns": 2e9 / LIGHT_SPEED_M_S, "ps": 2e12 / LIGHT_SPEED_M_S,
}  # fmt: skip
"""Units of a distance in a metre; a time of flight counts the way there and back."""
_FLIGHT_WORDS = ("tof", "flight", "delay", "arrival", "echo_time", "round_trip", "return_time")
_SUPPLY_WORDS = ("rail", "laser", "supply", "bias", "tec", "pump", "heater", "drive", "battery", "clock", "rate")
_NO_LIGHT_WORDS = frozenset(
    {"supply", "heater", "heating", "heat", "tec", "peltier", "pump", "fan", "electric", "electrical", "consumption",
     "consumed", "dissipation", "dissipated", "cooling", "compressor", "chiller", "battery", "mains"}
)  # fmt: skip
"""Words of a power that is drawn or carried off, not light."""
_VISIT_WORDS = (
    "step", "stop", "readout", "read_out", "visit", "position", "placement", "station", "pose", "point", "setting",
    "session", "record", "measurement", "soak", "dwell", "burst", "shot", "batch", "interval", "sequence",
)  # fmt: skip
_REPEAT_WORDS = frozenset({"repetition", "repeat", "rep", "trial", "scan", "sweep", "pass"})
"""Words of a name that say the same was done again."""

HALF_TURN_DEG = 130.0
"""Span of azimuths beyond which rays are a scanner's that looks around: a camera's field is less wide. They have no
axis to lie about, and are too far apart for curves over the bearing."""
PIXEL_COLUMNS = frozenset({"pixel_u", "pixel_v", "azimuth_deg", "elevation_deg"})
"""Where a pixel is in the image, or looks."""
ORDERS = frozenset({"step", "time_s"})
"""Columns that tell when something was measured."""
FIELD_COLUMNS = ("~radius(field)", "~twist(field)")
"""Derived from both columns of a pixel's place: what optics that are round, or bent by torsion, depend on."""
PIXEL = "~pixel"
"""Number of a pixel of a device, the same in every table: a name of it, not a size."""
_PLAY = "~play("
PER_TURN = "~per_turn("
"""How features begin that say how much a channel changes per degree of the stage (see `turned`)."""
BEARING_SIGNS = {"~bearing(azimuth + stage)": 1.0, "~bearing(azimuth - stage)": -1.0}
"""Where a pixel looks in the room, by the sense in which azimuths and stage angles count: what stands there shows on
whichever pixel looks at it."""
MADE_OF = {PIXEL: ("pixel_u", "pixel_v"), **dict.fromkeys(BEARING_SIGNS, ("stage_angle_deg", "azimuth_deg"))}
"""Columns without which a derived one cannot be."""


class Role(Enum):
    """What kind of quantity a channel is; effects choose their channels by role."""

    INTENSITY = "intensity"
    DISTANCE = "distance"
    TEMPERATURE = "temperature"
    FRACTION = "fraction"
    SCATTER = "scatter"
    OTHER = "other"


def suffix(name: str) -> str:
    """Unit suffix of a column name without `sim_` and `_std`; empty where there is none.

    >>> suffix("intensity_counts_std"), suffix("reflectance"), suffix("rail_1v8_v"), suffix("pixel_v")
    ('counts', '', 'v', '')
    >>> suffix("run_h"), suffix("rain_mm_h")
    ('h', '')
    """
    bare = re.sub(r"(_repeat)?_std$", "", name)
    words = bare.split("_")
    if len(words) < 2 or bare in _NO_UNIT or words[-1] not in UNIT_SUFFIXES:
        return ""
    is_rate = words[-1] in {"s", "min", "h"} and words[-2] in UNIT_SUFFIXES  # rain_mm_h, air_flow_m_s
    return "" if is_rate else words[-1]


def unit_of(name: str) -> str:
    """Unit of a column, `1` for a dimensionless one."""
    return UNIT_SUFFIXES.get(suffix(name), "1")


def role_of(name: str, channels: frozenset[str] | set[str] = frozenset()) -> Role:
    """Role of a channel, by the meaning its name has in the observation format, else by its unit suffix.

    >>> [role_of(name).value for name in ("return_v", "echo_mv", "pulse_energy_mj", "laser_voltage_v", "n_returns")]
    ['intensity', 'intensity', 'intensity', 'other', 'other']
    >>> [role_of(name).value for name in ("monitor_current_ua", "monitor_v", "apd_bias_v")]
    ['intensity', 'other', 'other']
    >>> [role_of(name).value for name in ("dc_current_a", "dark_current_na", "laser_current_a")]
    ['intensity', 'intensity', 'other']
    >>> [role_of(name).value for name in ("supply_power_w", "tec_power_w", "laser_power_w", "detector_power_uw")]
    ['other', 'other', 'intensity', 'intensity']
    >>> [role_of(name).value for name in ("counts", "peak_v", "lamp_v", "depth_cm", "tof_ps", "width_ns")]
    ['intensity', 'intensity', 'other', 'distance', 'distance', 'other']
    """
    if name.endswith("_std") and (name.removesuffix("_std") in channels or not channels):
        return Role.SCATTER
    unit = suffix(name)
    if name.endswith("_fraction"):
        return Role.FRACTION
    if name.startswith("n_"):
        return Role.OTHER
    if unit in {"ns", "ps"} and any(word in name for word in _FLIGHT_WORDS):
        return Role.DISTANCE
    words = set(name.split("_"))
    if unit in _POWERS and _NO_LIGHT_WORDS & words and "optical" not in words:
        return Role.OTHER
    named = any(word in name for word in _SIGNAL_WORDS) or bool(_SIGNAL_NAMES & words)
    named = named or bool(_DETECTOR_NAMES & words and unit in _CURRENTS)
    if unit in _SIGNAL_UNITS or (unit in _READ_IN and named):
        return Role.INTENSITY
    if unit in {"m", "mm", "cm", "km"}:
        return Role.DISTANCE
    if UNIT_SUFFIXES.get(unit) == "°C":
        return Role.TEMPERATURE
    return Role.OTHER


def per_metre(unit: str) -> float:
    """What a metre of distance is in a unit of length, or of time of flight; 1 for any other unit.

    >>> per_metre("mm"), round(per_metre("ns"), 4), per_metre("m")
    (1000.0, 6.6713, 1.0)
    """
    return _PER_METRE.get(unit, 1.0)


def is_aside(name: str) -> bool:
    """Whether a channel's name says that its light is not the return's.

    >>> is_aside("ambient_counts"), is_aside("intensity_counts"), is_aside("monitor_current_ua"), is_aside("dc_v")
    (True, False, True, True)
    """
    return is_other_light(name) or "monitor" in name or "dc" in name.split("_")


def is_other_light(name: str) -> bool:
    """Whether a channel's name says that its light is not the laser's at all.

    >>> is_other_light("ambient_counts"), is_other_light("dark_counts"), is_other_light("monitor_current_ua")
    (True, True, False)
    """
    return any(word in name for word in ("ambient", "background", "dark"))


def may_be_light(name: str) -> bool:
    """Whether a channel beside no other kind may be how light was read: a voltage or current that supplies nothing.

    >>> may_be_light("voltage_v"), may_be_light("output_a"), may_be_light("rail_1v8_v"), may_be_light("force_n")
    (True, True, False, False)
    """
    return suffix(name) in _READ_IN - {""} and not any(word in name for word in _SUPPLY_WORDS)


def told_by(column: str) -> str:
    """What a driver tells of: a column and its simulation tell the same, and so do a range and a distance.

    >>> [told_by(name) for name in ("sim_distance_mm", "true_range_m", "sim_lens_temperature_c", "distance_stop")]
    ['distance', 'distance', 'lens_temperature_c', 'distance_stop']
    """
    bare = column.removeprefix("sim_")
    is_distance = bare.startswith(("distance_", "true_range_")) and role_of(bare) is Role.DISTANCE
    return "distance" if is_distance else bare


def play_name(temperature: str) -> str:
    """Name of the derived column that tells from which side a temperature came."""
    return f"{_PLAY}{temperature})"


def played(name: str) -> str:
    """The temperature of such a column; empty where it is none."""
    return name.removeprefix(_PLAY).removesuffix(")") if name.startswith(_PLAY) else ""


def counts_visits(name: str) -> bool:
    """Whether a column seems to number what a bench did one after the other: a name without unit.

    >>> counts_visits("distance_stop"), counts_visits("readout"), counts_visits("position_m"), counts_visits("dut")
    (True, True, False, False)
    """
    taken = name.startswith(("sim_", "pixel_", "~")) or bool(suffix(name))
    return not taken and any(word in name for word in _VISIT_WORDS)


def counts_repeats(name: str) -> bool:
    """Whether a column seems to number how often a bench did the same: what it did is in others.

    >>> counts_repeats("repetition"), counts_repeats("sweep_no"), counts_repeats("rate_hz"), counts_repeats("echo")
    (True, True, False, False)
    """
    taken = name.startswith(("sim_", "pixel_", "~")) or bool(suffix(name))
    return not taken and not _REPEAT_WORDS.isdisjoint(name.split("_"))
