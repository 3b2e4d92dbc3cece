"""Pulses as sampled waveforms through a detector to a time stamp: range walk and mixed returns come out, not in.

A pulse is sampled at 20 ps, convolved with the detector's impulse response, and timed by a threshold, by a comparator
that needs charge, or by the peak of a saturating amplifier.
"""

from dataclasses import dataclass

import numpy as np

LIGHT_M_NS = 0.299792458
TICK_NS = 0.02
SPAN_NS = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Receiver:
    """Pulse family and electronics: `width_ns` full width at half maximum of the light, `tau_ns` of the detector.

    `level` is the comparator's threshold in counts, `charge` what a comparator needs above it (counts·ns), `knee` the
    saturation level of the amplifier in counts.
    """

    family: str = "gaussian"
    width_ns: float = 5.0
    tau_ns: float = 1.5
    estimator: str = "threshold"
    level: float = 25.0
    charge: float = 30.0
    knee: float = 3000.0


def draw_receiver(rng: np.random.Generator) -> Receiver:
    """A receiver of any family; three in ten lie outside of what is usual."""
    stretch = float(np.exp(rng.uniform(np.log(0.5), np.log(2.0)))) if rng.random() < 0.3 else 1.0
    return Receiver(
        family=str(rng.choice(["gaussian", "double_exponential", "q_switch"])),
        width_ns=float(rng.uniform(3.0, 8.0)) * stretch,
        tau_ns=float(rng.uniform(0.5, 3.0)) * stretch,
        estimator=str(rng.choice(["threshold", "charge"], p=[0.65, 0.35])),
        level=float(rng.uniform(6.0, 30.0)),
        charge=float(rng.uniform(10.0, 60.0)),
    )


def pulse(receiver: Receiver) -> tuple[np.ndarray, np.ndarray]:
    """Time (ns) and detected pulse of unit peak."""
    t = np.arange(0.0, SPAN_NS, TICK_NS)
    w = receiver.width_ns
    if receiver.family == "gaussian":
        light = np.exp(-0.5 * ((t - 3.0 * w) / (w / 2.3548)) ** 2)
    elif receiver.family == "double_exponential":
        s = np.maximum(t - 1.5 * w, 0.0)
        light = np.exp(-s / (0.9 * w)) - np.exp(-s / (0.35 * w))
    else:
        # gain-switched build-up is steeper than the cavity's decay
        s = t - 2.5 * w
        light = 1.0 / (np.exp(np.minimum(-s / (0.22 * w), 300.0)) + np.exp(np.minimum(s / (0.42 * w), 300.0)))
    response = np.exp(-t / receiver.tau_ns)
    detected = np.convolve(light, response)[: t.size]
    return t, detected / detected.max()


def stamp_ns(receiver: Receiver, amplitude: np.ndarray) -> np.ndarray:
    """Time stamps of pulses with the given peak amplitudes (counts), any shape."""
    t, shape = pulse(receiver)
    grid = np.geomspace(max(receiver.level * 1.05, 5.0), 8000.0, 240)
    if receiver.estimator == "peak":
        response = np.exp(-t / receiver.tau_ns)
        stamps = []
        for a in grid:
            driven = np.convolve(np.tanh(a * shape / receiver.knee), response)[: t.size]
            k = int(np.argmax(driven))
            left, mid, right = driven[k - 1 : k + 2]
            stamps.append(t[k] + 0.5 * TICK_NS * (left - right) / (left - 2 * mid + right))
        times = np.array(stamps)
    elif receiver.estimator == "charge":
        above = np.cumsum(np.maximum(grid[:, None] * shape - receiver.level, 0.0), axis=1) * TICK_NS
        need = np.minimum(receiver.charge, 0.5 * above[:, -1])
        times = np.array([np.interp(q, row, t) for q, row in zip(need, above, strict=True)])
    else:
        rising = slice(0, int(np.argmax(shape)) + 1)
        times = np.interp(receiver.level / grid, shape[rising], t[rising])
    return np.interp(np.log(np.maximum(amplitude, grid[0])), np.log(grid), times)


def strongest_return_m(receiver: Receiver, weight: np.ndarray, range_m: np.ndarray) -> np.ndarray:
    """Distance of the highest peak of the summed returns of sub-rays (N, S): what a peak detector reports."""
    t, shape = pulse(receiver)
    t, shape = t[::4], shape[::4]
    first = range_m.min(axis=1, keepdims=True)
    delay = 2.0 * (range_m - first) / LIGHT_M_NS
    total = np.zeros((weight.shape[0], t.size))
    for s in range(weight.shape[1]):
        total += weight[:, s : s + 1] * np.interp(t[None, :] - delay[:, s : s + 1], t, shape, left=0.0, right=0.0)
    peak = t[np.argmax(total, axis=1)] - t[np.argmax(shape)]
    return first[:, 0] + 0.5 * LIGHT_M_NS * peak
