"""Which conditions a bench table samples: few pixels over many angles, whole rows, blocks, or many cycles."""

from dataclasses import replace

import numpy as np

from benchmarks.concealed.effect import wide
from benchmarks.concealed.rows import Design, block_pixels, random_pixels
from benchmarks.concealed.thermal_network import Network


def _steps(rng: np.random.Generator, count: int, *, ramps: bool) -> tuple[int, ...]:
    """Step indices of a cycle of 39, spread, both ramps or heating only."""
    pool = np.arange(39 if ramps else 20)
    chosen = np.unique(np.round(np.linspace(0, pool[-1], count) + rng.uniform(-0.4, 0.4, size=count)).astype(int))
    return tuple(int(s) for s in np.clip(chosen, 0, pool[-1]))


def sparse(
    rng: np.random.Generator,
    *,
    duts: int | None = None,
    cycles: tuple[int, ...] = (1,),
    steps: int = 16,
    angles: int = 11,
    pixels: int = 24,
    span_deg: float = 27.0,
    ramps: bool = True,
    laser_program_k: float = 0.0,
    rail_wander: float = 0.0,
    shuffled: bool | None = None,
    network: Network | None = None,
    dew_point_c: float = -40.0,
    dwell_s: float = 6.0,
) -> Design:
    """Pixels strewn over the image, a coarse sweep, many steps: the usual table."""
    count = int(rng.choice([1, 2, 3], p=[0.3, 0.3, 0.4])) if duts is None else duts
    network = network or Network(tof_lag_s=wide(rng, 40, 120), frame_lag_s=wide(rng, 1800, 7200))
    return Design(
        duts=tuple(range(count)),
        cycles=cycles,
        steps=_steps(rng, steps, ramps=ramps),
        angles_deg=np.round(np.linspace(-span_deg, span_deg, angles) / 0.9) * 0.9,
        pixels=random_pixels(rng, pixels),
        shuffled=bool(rng.random() < 0.5) if shuffled is None else shuffled,
        laser_program_k=laser_program_k,
        rail_wander=rail_wander,
        rail_name=str(rng.choice(["rail_1v0_v", "rail_1v8_v", "rail_3v3_v", "rail_5v0_v", "rail_12v0_v"])),
        n_frames=int(rng.choice([5, 10, 10, 20])),
        network=network,
        dew_point_c=dew_point_c,
        dwell_s=dwell_s,
    )


def dense_rows(rng: np.random.Generator, *, rows: int = 3, steps: int = 4, angles: int = 9, duts: int = 1) -> Design:
    """Whole image rows next to each other: neighbours in the image are in the table."""
    v0 = int(rng.integers(4, 24))
    return Design(
        duts=tuple(range(duts)),
        steps=_steps(rng, steps, ramps=True),
        angles_deg=np.round(np.linspace(-24, 24, angles) / 0.9) * 0.9,
        pixels=block_pixels(0, v0, 128, rows),
        shuffled=bool(rng.random() < 0.5),
        n_frames=int(rng.choice([5, 10, 20])),
    )


def full_frame(
    rng: np.random.Generator, *, steps: int = 2, angles: int = 3, duts: int = 1, stride: int = 1
) -> Design:
    """Every pixel (or every second), few angles, few steps."""
    pixels = block_pixels(0, 0, 128, 32)
    if stride > 1:
        pixels = pixels[(pixels[:, 0] % stride == 0) & (pixels[:, 1] % stride == 0)]
    return Design(
        duts=tuple(range(duts)),
        steps=_steps(rng, steps, ramps=True),
        angles_deg=np.round(np.linspace(-9, 9, angles) / 0.9) * 0.9,
        pixels=pixels,
        n_frames=int(rng.choice([5, 10])),
    )


def fine_sweep(
    rng: np.random.Generator,
    *,
    steps: int = 4,
    pixels: int = 16,
    duts: int = 1,
    span_deg: float = 18.0,
    shuffled: bool | None = None,
) -> Design:
    """Every stage position of 0.9° over a part of the arc: edges pass through each pixel."""
    return sparse(
        rng,
        duts=duts,
        steps=steps,
        pixels=pixels,
        angles=int(2 * span_deg / 0.9) + 1,
        span_deg=span_deg,
        shuffled=shuffled,
    )


def ageing(rng: np.random.Generator, *, pixels: int = 16, angles: int = 7, steps: int = 10) -> Design:
    """Several cycles, far apart in count."""
    first = int(rng.integers(1, 20))
    gap = int(rng.integers(40, 200))
    cycles = tuple(first + gap * k for k in range(int(rng.choice([4, 5]))))
    return sparse(rng, duts=int(rng.choice([1, 2])), cycles=cycles, steps=steps, pixels=pixels, angles=angles)


def smooth(design: Design, rng: np.random.Generator) -> Design:
    """The same design, three times in four with a renderer through which edges pass smoothly.

    Nine sharp rays per pixel turn a small displacement into a few large jumps at edges: visible, but never faint.
    """
    return replace(design, smooth=bool(rng.random() < 0.75))


def displaced(design: Design, rng: np.random.Generator) -> Design:
    """A design for displacements: smooth edges, or none at all, so that only distances and the beam tell of them."""
    return replace(design, inside_only=True) if rng.random() < 0.35 else smooth(design, rng)
