"""Temperatures of a cycle as a network of heat capacities and conductances, and the frost that its window collects.

Many nodes, one explicit Euler march: coolant, plate, housing, ToF die, FPGA die, laser mount, window, chamber frame.
"""

from dataclasses import dataclass

import numpy as np

STEP_K, LOW_C, HIGH_C = 5.0, -10.0, 85.0
STEP_S, MARCH_S = 540.0, 4.0
NODES = ("coolant", "plate", "housing", "tof", "fpga", "laser", "window", "frame")


@dataclass(frozen=True, slots=True, kw_only=True)
class Network:
    """Time constants (s) and self-heating (K at rest) of the nodes that hang on the housing."""

    tof_lag_s: float = 90.0
    fpga_lag_s: float = 60.0
    laser_lag_s: float = 40.0
    window_lag_s: float = 240.0
    frame_lag_s: float = 3600.0
    slow_die_lag_s: float = 600.0
    ambient_c: float = 23.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """Node temperatures against time: `time_s` (T,), `node_c` name -> (T,), `slow_die_c`, `set_c`, `frost_kg_m2`."""

    time_s: np.ndarray
    set_c: np.ndarray
    ramp: np.ndarray
    node_c: dict[str, np.ndarray]
    frost_kg_m2: np.ndarray


def set_points() -> tuple[np.ndarray, np.ndarray]:
    """Set temperatures of one cycle up and down, with the ramp's sign."""
    up = np.arange(LOW_C, HIGH_C + 0.1, STEP_K)
    down = up[-2::-1]
    return np.concatenate([up, down]), np.concatenate([np.ones(up.size), -np.ones(down.size)])


def saturation_density_kg_m3(temperature_c: np.ndarray | float) -> np.ndarray:
    """Water vapour density at saturation, Magnus form over water above and over ice below 0 °C."""
    t = np.asarray(temperature_c, dtype=float)
    over = np.where(t >= 0, 611.2 * np.exp(17.62 * t / (243.12 + t)), 611.2 * np.exp(22.46 * t / (272.62 + t)))
    return over / (461.5 * (t + 273.15))


def march(network: Network, *, dew_point_c: float = -40.0, film_m_s: float = 4e-3) -> Course:
    """One cycle through all set points.

    Args:
        network: lags and ambient.
        dew_point_c: of the air before the window; sets the mass flow of frost.
        film_m_s: convective mass transfer coefficient.
    """
    sets, ramps = set_points()
    time = np.arange(0.0, sets.size * STEP_S, MARCH_S)
    index = np.minimum((time // STEP_S).astype(int), sets.size - 1)
    state = dict.fromkeys(NODES, LOW_C)
    state |= {
        "tof": LOW_C + 9.0,
        "fpga": LOW_C + 14.0,
        "laser": 25 + 0.04 * (LOW_C - 25),
        "frame": 20.0,
        "window": 0.0,
    }
    state["slow"] = LOW_C
    out = {name: np.empty(time.size) for name in state}
    frost, frost_out = 0.0, np.empty(time.size)
    vapour = float(saturation_density_kg_m3(dew_point_c))
    limit = 3.0 / 60.0 * MARCH_S
    surface = saturation_density_kg_m3(np.arange(-60.0, 120.0, 0.05))
    for k in range(time.size):
        # the bench's controller holds the housing, not the coolant, at the set temperature
        goal = (25.6 * sets[index[k]] - 0.6 * network.ambient_c - 12.0) / 25.0
        state["coolant"] += float(np.clip(goal - state["coolant"], -limit, limit))
        plate_w = 150.0 * (state["coolant"] - state["plate"]) + 3 * 25.0 * (state["housing"] - state["plate"])
        house_w = 25.0 * (state["plate"] - state["housing"]) + 0.6 * (network.ambient_c - state["housing"]) + 12.0
        state["plate"] += MARCH_S * plate_w / 4500.0
        state["housing"] += MARCH_S * house_w / 900.0
        house = state["housing"]
        for name, goal, lag in (
            ("tof", house + 9.0, network.tof_lag_s),
            ("fpga", house + 14.0, network.fpga_lag_s),
            ("laser", 25.0 + 0.04 * (house - 25.0), network.laser_lag_s),
            ("window", 0.92 * house + 0.08 * network.ambient_c, network.window_lag_s),
            ("frame", network.ambient_c + 0.3 * (house - network.ambient_c), network.frame_lag_s),
            ("slow", house, network.slow_die_lag_s),
        ):
            state[name] += (goal - state[name]) * (1.0 - np.exp(-MARCH_S / lag))
        flow = film_m_s * (vapour - surface[int((state["window"] + 60.0) / 0.05)])
        melting = 3e-5 * max(state["window"] - 0.5, 0.0) if frost > 0 else 0.0
        frost = max(frost + MARCH_S * (flow - melting), 0.0)
        for name, value in state.items():
            out[name][k] = value
        frost_out[k] = frost
    return Course(time_s=time, set_c=sets[index], ramp=ramps[index], node_c=out, frost_kg_m2=frost_out)
