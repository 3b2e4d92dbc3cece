"""Concealed effects of targets, air and mechanics on the flash sensor."""

from dataclasses import replace

import numpy as np

from benchmarks.concealed.designs import displaced, fine_sweep, smooth, sparse
from benchmarks.concealed.effect import DISTANCE, FIELD, INTENSITY, Effect, Parameter, sign, wide
from benchmarks.concealed.flash import Light, Reality
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.rows import Design, Rows
from benchmarks.concealed.scene import SURFACES, Hits, block_centres, pixel_rays, to_chamber, trace
from benchmarks.concealed.waveform import draw_receiver, strongest_return_m

EDGE = ("stage_angle_deg", "mixed", "surface", *FIELD)


def _non_lambertian(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    lobe_deg = wide(rng, 5.0, 15.0)

    def apply(reality: Reality, amount: float) -> None:
        def lobe(rows: Rows, hits: Hits) -> np.ndarray:
            # paint with microfacets: a retro-facing lobe about the normal, the coating only on the targets
            angle = np.degrees(np.arccos(np.clip(hits.cos_incidence, -1, 1)))
            return np.where(hits.surface > 0, 1 + amount * (np.exp(-((angle / lobe_deg) ** 2)) - 0.5), 1.0)

        reality.surface.append(lobe)

    return Effect(
        effect="target.non_lambertian",
        apply=apply,
        channels=(INTENSITY,),
        start=0.01,
        limit=1.0,
        drivers=("incidence_deg", "surface"),
        needs=("incidence_deg", "surface"),
        unseen=("steps", "angles"),
    )


def _reflectance_error(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    pick, way = int(rng.choice([1, 2, 3])), sign(rng)

    def apply(reality: Reality, amount: float) -> None:
        reality.surface.append(lambda rows, hits: np.where(hits.surface == pick, 1.0 + way * amount, 1.0))

    return Effect(
        effect="target.reflectance_error",
        apply=apply,
        channels=(INTENSITY,),
        drivers=("surface", "reflectance"),
        start=0.005,
        limit=0.6,
        needs=("surface",),
        unseen=("steps", "dut", "angles"),
        where={"surface": [SURFACES[pick]]},
        parameters=lambda a: (Parameter(pattern="error|reflect|rel|delta|rho|e", value=way * a, unit=""),),
    )


def _edge_mixing(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    receiver = draw_receiver(rng)

    def apply(reality: Reality, amount: float) -> None:
        def mix(rows: Rows, light: Light, distance: np.ndarray) -> np.ndarray:
            spread = np.ptp(light.hits.range_m, axis=1) > 0.05
            out = distance.copy()
            if spread.any():
                strongest = strongest_return_m(receiver, light.weight[spread], light.hits.range_m[spread])
                out[spread] += min(amount, 1.0) * (strongest - distance[spread])
            return out

        reality.mixing.append(mix)

    return Effect(
        effect="target.edge_mixing",
        apply=apply,
        channels=(DISTANCE,),
        drivers=EDGE,
        start=0.05,
        limit=1.0,
        needs=("mixed", "surface", "stage_angle_deg"),
        unseen=("steps",),
        where={"mixed": [True]},
    )


def _patches() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (P, 3), normals and reflectance × solid angle of a coarse frame's surfaces seen from the axis."""
    u, v = block_centres(6, 8)
    hits = trace(np.zeros(3), to_chamber(pixel_rays(u, v), np.asarray(0.0)))
    return hits.point_m, hits.normal, hits.reflectance * hits.cos_incidence / hits.range_m**2


def _multipath(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    points, normals, strength = _patches()

    def bounce(rows: Rows, light: Light) -> tuple[np.ndarray, np.ndarray]:
        """Share of twice-bounced light and its extra one-way path: sensor → patch → target → sensor."""
        spot, facing = light.hits.point_m[:, 4], light.hits.normal[:, 4]
        share, extra = np.zeros(len(rows)), np.zeros(len(rows))
        for p, n, s in zip(points, normals, strength, strict=True):
            way = p - spot
            far = np.sqrt(np.sum(way * way, axis=1) + 0.02)
            out = np.maximum(np.sum(way * facing, axis=1) / far, 0.0)
            back = np.maximum(-(way @ n) / far, 0.0)
            w = s * out * back / far**2
            share += w
            extra += w * 0.5 * (np.linalg.norm(p) + far - light.hits.range_m[:, 4])
        return share, extra / np.maximum(share, 1e-12)

    def apply(reality: Reality, amount: float) -> None:
        cache: dict[int, np.ndarray] = {}

        def lengthen(rows: Rows, light: Light, distance: np.ndarray) -> np.ndarray:
            share, extra = bounce(rows, light)
            own = light.hits.reflectance[:, 4] * light.hits.cos_incidence[:, 4] / light.hits.range_m[:, 4] ** 2
            ratio = amount * share * light.hits.reflectance[:, 4] / own
            cache[len(rows)] = ratio
            return distance + ratio / (1 + ratio) * extra

        def brighten(rows: Rows, intensity: np.ndarray) -> np.ndarray:
            return intensity * (1 + cache[len(rows)])

        reality.mixing.append(lengthen)
        reality.electronics.append(brighten)

    return Effect(
        effect="air.multipath",
        apply=apply,
        channels=(DISTANCE, INTENSITY),
        start=0.02,
        limit=3.0,
        drivers=("stage_angle_deg", "surface", *FIELD, "true_range_m", "sim_distance_m", "reflectance"),
        unseen=("steps", "angles"),
        needs=("surface", "stage_angle_deg"),
    )


def _zero_offset(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    way = sign(rng)

    def apply(reality: Reality, amount: float) -> None:
        # with sweeps in both directions the play of the drive is seen, not where its zero lies
        reality.stage_deg.append(
            lambda rows: way * amount * (rows.travel if design.both_ways else np.ones(len(rows)))
        )

    return Effect(
        effect="stage.zero_offset",
        apply=apply,
        channels=(INTENSITY, DISTANCE),
        drivers=("sweep_direction", *EDGE),
        start=0.02,
        limit=4.0,
        needs=("stage_angle_deg", "sweep_direction", *FIELD),
        unseen=("steps", "dut"),
        equivalents=(
            *(("mount.tilt",) if len(design.duts) == 1 and not design.both_ways else ()),
            # frames that come late in an ordered sweep shift every angle towards the one before
            *(("acquisition.frame_lag",) if way < 0 and not design.shuffled else ()),
        ),
        parameters=lambda a: (
            # play is the whole way from one end to the other
            Parameter(pattern="play|backlash|hysteresis", value=2.0 * way * a, unit="deg")
            if design.both_ways
            else Parameter(pattern="zero|offset|angle", value=way * a, unit="deg"),
        ),
    )


def _eccentricity(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    bearing = rng.uniform(0, 2 * np.pi)
    offset = np.array([np.sin(bearing), 0.0, np.cos(bearing)])  # right, down, forward

    def apply(reality: Reality, amount: float) -> None:
        reality.origin_m.append(lambda rows: np.tile(amount * offset, (len(rows), 1)))

    return Effect(
        effect="stage.eccentricity",
        apply=apply,
        channels=(DISTANCE, INTENSITY),
        start=1e-3,
        limit=0.04,
        drivers=("stage_angle_deg", *FIELD, "surface"),
        needs=("stage_angle_deg", *FIELD),
        unseen=("steps", "angles"),
        calibrations=("none", "global"),
    )


def _periodic_error(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    period, phase, second = wide(rng, 3.0, 15.0), rng.uniform(0, 6.28), rng.uniform(0.0, 0.3)

    def apply(reality: Reality, amount: float) -> None:
        def wobble(rows: Rows) -> np.ndarray:
            turn = 2 * np.pi * rows.angle_deg / period + phase
            return amount * (np.sin(turn) + second * np.sin(2 * turn + 1.0))

        reality.stage_deg.append(wobble)

    return Effect(
        effect="stage.periodic_error",
        apply=apply,
        channels=(INTENSITY, DISTANCE),
        drivers=EDGE,
        start=0.03,
        limit=4.0,
        needs=("stage_angle_deg", *FIELD),
        unseen=("steps",),
        parameters=lambda a: (Parameter(pattern="period", value=period, unit="deg"),),
    )


def _tilt(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    dut = int(rng.choice(design.duts))
    axis = rng.normal(size=3) * np.array([1.0, 1.0, 0.2])
    axis /= np.linalg.norm(axis)

    def apply(reality: Reality, amount: float) -> None:
        reality.tilt_deg.append(lambda rows: amount * axis[None, :] * (rows.dut == dut)[:, None])

    return Effect(
        effect="mount.tilt",
        apply=apply,
        channels=(INTENSITY, DISTANCE),
        drivers=("dut", *EDGE),
        start=0.1,
        limit=6.0,
        needs=("stage_angle_deg", "dut", *FIELD),
        unseen=("steps",),
        where={"dut": [f"#{dut}"]} if len(design.duts) > 1 else None,
        equivalents=("stage.zero_offset",) if len(design.duts) == 1 else (),
    )


def _repeatability(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    by_sweep, channel = rng.random() < 0.4, str(rng.choice([INTENSITY, DISTANCE]))
    scale = 1.0 if channel == INTENSITY else 0.1

    def apply(reality: Reality, amount: float) -> None:
        return

    def common(expected: np.ndarray, amount: float) -> np.ndarray:
        return amount * (expected if channel == INTENSITY else np.full(expected.size, scale))

    return Effect(
        effect="bench.repeatability",
        apply=apply,
        channels=(channel,),
        kind="common",
        start=0.003,
        limit=0.2,
        unseen=("angles",) if not by_sweep else ("steps",),
        calibrations=("none",),
        drivers=("stage_angle_deg", "time_s", "step") if by_sweep else ("step", "time_s", "cycle", "dut"),
        nature="sweep" if by_sweep else "step",
        common_scale=common,
    )


def _frame_lag(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    settling = rng.random() < 0.35

    def apply(reality: Reality, amount: float) -> None:
        if settling:  # the stage creeps in while the frames are taken, each as long as `amount` asks for
            creep = np.exp(-(np.arange(design.n_frames) + 1.0) / (8.0 * amount))
            reality.frames += [(1.0 / design.n_frames, float(f)) for f in creep]
        else:
            reality.frames += [(amount, 1.0), (1.0 - amount, 0.0)]

    return Effect(
        effect="acquisition.frame_lag",
        apply=apply,
        channels=(INTENSITY, DISTANCE),
        drivers=EDGE,
        start=0.03,
        limit=0.95,
        needs=("stage_angle_deg", "time_s", *FIELD),
        unseen=("steps",),
        equivalents=() if design.shuffled else ("stage.zero_offset",),
        parameters=lambda a: () if settling else (Parameter(pattern="share|fraction|late|stale", value=a, unit=""),),
    )


def _both_or_one_way(rng: np.random.Generator) -> Design:
    design = displaced(fine_sweep(rng, duts=int(rng.choice([1, 2]))), rng)
    return replace(design, both_ways=True, shuffled=False) if rng.random() < 0.3 else design


RECIPES = (
    Recipe("target.non_lambertian", lambda r: sparse(r, pixels=50, angles=15, steps=5), _non_lambertian),
    Recipe("target.reflectance_error", lambda r: sparse(r, angles=15), _reflectance_error),
    Recipe("target.edge_mixing", lambda r: fine_sweep(r, pixels=24, steps=5, span_deg=20), _edge_mixing),
    Recipe("air.multipath", lambda r: sparse(r, pixels=60, angles=15, steps=5), _multipath),
    Recipe("stage.zero_offset", _both_or_one_way, _zero_offset),
    Recipe("stage.eccentricity", lambda r: displaced(sparse(r, pixels=60, angles=19, steps=5), r), _eccentricity),
    Recipe("stage.periodic_error", lambda r: displaced(fine_sweep(r, pixels=24, span_deg=27), r), _periodic_error),
    Recipe("mount.tilt", lambda r: displaced(fine_sweep(r, duts=int(r.choice([2, 3])), pixels=20), r), _tilt),
    Recipe("bench.repeatability", lambda r: sparse(r, steps=30, angles=9, pixels=12), _repeatability),
    Recipe(
        "acquisition.frame_lag",
        lambda r: smooth(fine_sweep(r, pixels=24, shuffled=bool(r.random() < 0.6)), r),
        _frame_lag,
    ),
)
