"""A simulation that shows the strongest surface of a pixel; a sensor whose gate lets in some of the other echo."""

import numpy as np
from rendered_bench import make_columns

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_second_echo import second_echo
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.view import View

WIDTH, HEIGHT, FINE, FRAMES = 26, 18, 15, 8.0
WALL = 6.0, 0.45
BOARDS = (5.3, 0.8, 3.4, 9.7, 2.6, 11.3), (4.4, 0.2, 12.2, 17.6, 4.3, 15.2), (3.1, 0.6, 19.4, 23.8, 1.7, 8.9)
"""Range, reflectance; of boards their columns and rows from and to, in pixels."""
BINS = np.arange(2.0, 7.5, 0.05)
PULSE, GATE = 0.22, 0.8
"""Standard deviation of a pulse, and how far about the highest bin the range's centroid reaches, metres."""
NAMES = (
    "target.edge_mixing", "target.reflectance_error", "optics.defocus", "detector.crosstalk", "timing.range_walk",
    "timing.clock_scale", "stage.zero_offset", "air.multipath",
)  # fmt: skip


def echoes():
    """Light that each pixel gets of each surface, (surface, v, u), and the surfaces' ranges there."""
    part = (np.arange(WIDTH * FINE) + 0.5) / FINE, (np.arange(HEIGHT * FINE) + 0.5) / FINE
    u, v = np.meshgrid(*part)
    tilt = 1.0 + 0.004 * (u - WIDTH / 2)  # they lean by some centimetres from edge to edge
    which = np.zeros(u.shape, dtype=int)
    for number, (_, _, left, right, top, foot) in enumerate(BOARDS, start=1):
        which[(u > left) & (u < right) & (v > top) & (v < foot)] = number
    paint = np.array([WALL[1], *(board[1] for board in BOARDS)])
    far = np.array([WALL[0], *(board[0] for board in BOARDS)])[:, None, None] * tilt
    pixels = HEIGHT, FINE, WIDTH, FINE
    light = [
        np.where(which == k, 9e4 * paint[k] / far[k] ** 2, 0.0).reshape(pixels).mean(axis=(1, 3))
        for k in range(paint.size)
    ]
    return np.array(light), far.reshape(-1, *pixels).mean(axis=(2, 4))


def gated(light, far):
    """Range by the centroid of a sampled waveform, from the gate about its highest bin."""
    wave = np.sum(light[..., None] * np.exp(-0.5 * ((BINS - far[..., None]) / PULSE) ** 2), axis=0)
    top = BINS[wave.argmax(axis=-1)]
    inside = 1.0 / (1.0 + np.exp((np.abs(BINS - top[..., None]) - GATE) / 0.1))
    return (wave * inside) @ BINS / (wave * inside).sum(axis=-1)


def camera(steps=9):
    rng = np.random.default_rng(3)
    light, far = echoes()
    total, strongest = light.sum(axis=0), light.argmax(axis=0)
    alone = np.take_along_axis(far, strongest[None], axis=0)[0]
    one = np.where(np.arange(len(light))[:, None, None] == strongest, light, 0.0)
    bias = gated(light, far) - gated(one, far)  # bins err in both
    v, u = np.indices(total.shape)
    error = 0.12 * (total / total.mean()) ** -0.5
    names = np.array(["wall", "near_board", "dark_board", "side_board"])
    flat = {
        "pixel_u": u.ravel(), "pixel_v": v.ravel(), "n_frames": np.full(u.size, FRAMES),
        "sim_intensity_counts": total.ravel(), "sim_distance_m": alone.ravel(),
        "sim_intensity_counts_std": 0.02 * total.ravel(), "sim_distance_m_std": error.ravel(),
    }  # fmt: skip
    numbers = {name: np.tile(values.astype(float), steps) for name, values in flat.items()}
    noise = rng.normal(size=(2, steps * u.size)) / np.sqrt(FRAMES)
    numbers |= {
        "step": np.repeat(np.arange(float(steps)), u.size),
        "housing_temperature_c": np.repeat(np.linspace(0.0, 60.0, steps), u.size),
        "intensity_counts": numbers["sim_intensity_counts"] + noise[0] * numbers["sim_intensity_counts_std"],
        "distance_m": np.tile((alone + bias).ravel(), steps) + noise[1] * numbers["sim_distance_m_std"],
    }
    labels = {
        "surface": np.tile(names[strongest.ravel()], steps),
        "mixed": np.tile(np.where(((light > 0.0).sum(axis=0) > 1).ravel(), "true", "false"), steps),
    }
    return make_columns(numbers, labels)[0]


def test_both_surfaces_of_a_pixel_are_told_by_its_neighbours():
    view = View(camera(steps=1))
    part, range_ = second_echo(view, "distance_m")
    light, far = echoes()
    order, u, v = np.argsort(light, axis=0), *(view.number(n).astype(int) for n in ("pixel_u", "pixel_v"))
    second = np.take_along_axis(light, order[-2:-1], axis=0)[0] / light.sum(axis=0)
    behind = np.take_along_axis(far, order[-2:-1], axis=0)[0]
    two = ((light > 0.0).sum(axis=0) == 2)[v, u]
    known = np.isfinite(part)
    assert not (known & ~two & ((light > 0.0).sum(axis=0) == 1)[v, u]).any()
    assert np.count_nonzero(known & two) > 0.5 * np.count_nonzero(two)
    assert np.median(np.abs(part - second[v, u])[known & two]) < 0.02
    assert np.max(np.abs(range_ / behind[v, u] - 1.0)[known & two]) < 0.02


def test_the_left_out_echo_is_named():
    found = diagnose(camera(), effects=[library()[name] for name in NAMES])[0].findings
    assert [f.effect for f in found] == ["target.edge_mixing"]
