"""Light that bounced twice about the nominal bench, where the table's simulation is seen to be that bench.

Panels and wall are cut into patches. What the sensor lights of them lights every target in turn: with the cosines of
both ends, the area over the square of their distance (two-bounce radiosity of diffuse surfaces; Immel, Cohen,
Greenberg, SIGGRAPH 1986), and arrives over half of the whole way from the sensor by the patch and the target back.

A plainer account holds the same: panels as lamps that shine alike to all sides, whatever faces them, and the wall as
none. What a real chamber does lies between the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_bench import Bench, bench_of
from arl_fixtures.reconcile.effects_common import per_table
from arl_fixtures.reconcile.effects_rays import Optics, Spots, look, rays_of
from arl_fixtures.reconcile.view import View
from arl_fixtures.twin.scene import Panel, SceneSettings

FloatArray = NDArray[np.float64]

_PATCH_M = 0.14
_WALL_STEP_DEG = 6.0
_CHUNK = 2000
_ON_PLANE_M = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class _Patches:
    """Pieces of the scene, in the bench's frame: positions and outward normals (n, 3), areas in m², reflectances."""

    place: FloatArray
    normal: FloatArray
    area: FloatArray
    reflectance: FloatArray


def bounced(view: View, *, plain: bool = False) -> tuple[FloatArray, FloatArray] | None:
    """Twice-bounced light of every row of the whole table over its own, and its extra one-way path.

    The light is over its mean: how reflective the rest of a chamber is remains to be fitted. The path is in the unit
    of the table's distances. None where the bench is not known.

    Args:
        view: of a table; plain: of panels as lamps.
    """
    bench = bench_of(view)
    if bench is None:
        return None

    def make() -> tuple[FloatArray, FloatArray] | None:
        light, detour = _of_lamps(bench) if plain else _of_spots(bench)
        mean = float(light.mean())
        if not mean > 0.0:
            return None
        return (light / mean)[bench.index], detour[bench.index] * bench.unit

    return per_table(view, ("bounced", plain), make)


def _of_spots(bench: Bench) -> tuple[FloatArray, FloatArray]:
    """Twice-bounced over direct light of each spot, and its extra one-way path in metres."""
    scene, spots = bench.optics.scene, bench.spots
    one = Optics(camera=bench.optics.camera, rays=1, soft_rad=0.0, scene=scene)
    ray, range_m, _ = aimed(one, spots)
    seen = [panel for panel in scene.panels if _on(panel, ray * range_m[:, None]).any()]
    patches = _patches_of(scene.model_copy(update={"panels": tuple(seen)}))  # of others the table tells nothing
    light, detour = np.zeros(spots.u.size), np.zeros(spots.u.size)
    for start in range(0, spots.u.size, _CHUNK):
        rows = slice(start, start + _CHUNK)
        some = spots.take(rows)
        ray, range_m, normal = aimed(one, some)
        target = ray * range_m[:, None]
        target[:, 2] += some.height_m
        light[rows], detour[rows] = _two_bounces(bench, some, patches, target, normal, ray, range_m)
    return light, detour


def _of_lamps(bench: Bench) -> tuple[FloatArray, FloatArray]:
    """The same from patches that shine to all sides: reflectance · area over (π · distance² + area) of each."""
    scene, spots = bench.optics.scene, bench.spots
    one = Optics(camera=bench.optics.camera, rays=1, soft_rad=0.0, scene=scene)
    ray, range_m, _ = aimed(one, spots)
    target = ray * range_m[:, None]
    light, detour = np.zeros(spots.u.size), np.zeros(spots.u.size)
    target[:, 2] += spots.height_m
    for panel in scene.panels:
        lamps, elsewhere = _on_panel(panel), ~_on(panel, target)
        for place, area, reflectance in zip(lamps.place, lamps.area, lamps.reflectance, strict=True):
            way = np.linalg.norm(target - place, axis=1)
            there = np.hypot(float(np.hypot(place[0], place[1])), place[2] - spots.height_m)
            share = reflectance * area / (np.pi * way**2 + area) * elsewhere
            light += share
            detour += share * 0.5 * (there + way - range_m)
    return light, detour / np.maximum(light, 1e-300)


def aimed(optics: Optics, spots: Spots) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The ray through each spot's centre in the bench's frame, its range in metres and the normal where it ends."""
    ahead, left, up = (part[:, 0] for part in rays_of(optics, spots))
    light, moment = look(optics, spots)
    range_m = moment / light
    turn = np.radians(spots.stage_deg)
    # the bench stands still: what lies ahead of a turned sensor lies at bearing −stage, counted to the left
    ray = np.stack(
        [ahead * np.cos(turn) + left * np.sin(turn), left * np.cos(turn) - ahead * np.sin(turn), up], axis=1
    )  # fmt: skip
    return ray, range_m, _normals(optics.scene, ray * range_m[:, None])


def incidence_deg(view: View) -> FloatArray | None:
    """Angle of incidence at the centre of every row's pixel, of the whole table.

    As the table says; where it does not, on the surfaces of the bench. None where neither is known.
    """
    if view.varies("incidence_deg"):
        return view.columns.numbers["incidence_deg"]
    bench = None if view.has("incidence_deg") else bench_of(view)
    return None if bench is None else per_table(view, "incidence", lambda: _incidence(bench))


def _incidence(bench: Bench) -> FloatArray:
    one = Optics(camera=bench.optics.camera, rays=1, soft_rad=0.0, scene=bench.optics.scene)
    ray, _, normal = aimed(one, bench.spots)
    cosine = np.clip(-np.sum(ray * normal, axis=1), 0.0, 1.0)
    return np.asarray(np.degrees(np.arccos(cosine))[bench.index])


def _two_bounces(
    bench: Bench,
    spots: Spots,
    patches: _Patches,
    target: FloatArray,
    normal: FloatArray,
    ray: FloatArray,
    range_m: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    sensor = np.zeros((len(target), 3))
    sensor[:, 2] = spots.height_m
    out = patches.place[None, :, :] - sensor[:, None, :]
    far = np.linalg.norm(out, axis=2)
    azimuth = -np.degrees(np.arctan2(patches.place[:, 1], patches.place[:, 0]))[None, :] - spots.stage_deg[:, None]
    azimuth = (azimuth + 180.0) % 360.0 - 180.0
    elevation = np.degrees(np.arcsin(np.clip(out[:, :, 2] / far, -1.0, 1.0)))
    camera = bench.optics.camera
    widest = float(camera.angles_deg(np.array([2.0 * camera.cx + 0.5]), np.array([camera.cy]))[0][0])
    tallest = float(camera.angles_deg(np.array([camera.cx]), np.array([-0.5]))[1][0])
    beam = np.exp(camera.log_beam_at(azimuth, elevation))
    beam = np.where((np.abs(azimuth) <= widest) & (np.abs(elevation) <= tallest), beam, 0.0)
    incoming = np.maximum(-np.einsum("spk,pk->sp", out, patches.normal) / far, 0.0)
    lit = beam * incoming / far**2 * (patches.reflectance * patches.area)[None, :]
    across = target[:, None, :] - patches.place[None, :, :]
    apart = np.einsum("spk,spk->sp", across, across) + patches.area[None, :] / np.pi
    length = np.sqrt(apart)
    leaving = np.maximum(np.einsum("spk,pk->sp", across, patches.normal) / length, 0.0)
    arriving = np.maximum(-np.einsum("spk,sk->sp", across, normal) / length, 0.0)
    bounce = lit * leaving * arriving / (np.pi * apart)
    direct = np.maximum(-np.sum(ray * normal, axis=1), 1e-3) / range_m**2
    light = bounce.sum(axis=1)
    longer = np.sum(bounce * 0.5 * (far + length - range_m[:, None]), axis=1) / np.maximum(light, 1e-300)
    return light / direct, longer


def _normals(scene: SceneSettings, place: FloatArray) -> FloatArray:
    """Normals towards the sensor of the surfaces on which points lie, (n, 3)."""
    level = np.hypot(place[:, 0], place[:, 1])
    normal = np.zeros_like(place)
    normal[:, :2] = -place[:, :2] / level[:, None]
    for panel in scene.panels:
        angle = np.radians(panel.azimuth_deg)
        normal[_on(panel, place)] = (-float(np.cos(angle)), -float(np.sin(angle)), 0.0)
    return normal


def _on(panel: Panel, place: FloatArray) -> NDArray[np.bool_]:
    """Whether points lie on a panel."""
    angle = np.radians(panel.azimuth_deg)
    c, s = float(np.cos(angle)), float(np.sin(angle))
    aside = np.abs(place[:, 1] * c - place[:, 0] * s)
    on_plane = np.abs(place[:, 0] * c + place[:, 1] * s - panel.radius_m) < _ON_PLANE_M
    return np.asarray(on_plane & (aside <= 0.5 * panel.width_m + _ON_PLANE_M))


def _patches_of(scene: SceneSettings) -> _Patches:
    parts = [_on_panel(panel) for panel in scene.panels]
    tall = max((panel.height_m for panel in scene.panels), default=1.0)
    bearings = np.arange(-180.0, 180.0, _WALL_STEP_DEG)
    heights = _middles(tall)
    angle, up = (a.ravel() for a in np.meshgrid(np.radians(bearings), heights, indexing="ij"))
    radius = scene.wall.radius_m
    behind = np.zeros(angle.size, dtype=bool)
    for panel in scene.panels:
        off = (np.degrees(angle) - panel.azimuth_deg + 180.0) % 360.0 - 180.0
        behind |= np.abs(off) < np.degrees(np.arctan(0.5 * panel.width_m / panel.radius_m))
    angle, up = angle[~behind], up[~behind]
    towards = np.stack([np.cos(angle), np.sin(angle), np.zeros(angle.size)], axis=1)
    size = radius * np.radians(_WALL_STEP_DEG) * tall / heights.size
    wall = _Patches(
        place=radius * towards + np.array([0.0, 0.0, 1.0]) * up[:, None], normal=-towards,
        area=np.full(angle.size, size), reflectance=np.full(angle.size, scene.wall.reflectance),
    )  # fmt: skip
    parts.append(wall)
    return _Patches(
        place=np.concatenate([part.place for part in parts]), normal=np.concatenate([part.normal for part in parts]),
        area=np.concatenate([part.area for part in parts]),
        reflectance=np.concatenate([part.reflectance for part in parts]),
    )  # fmt: skip


def _on_panel(panel: Panel) -> _Patches:
    angle = np.radians(panel.azimuth_deg)
    towards, aside = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
    across, up = (a.ravel() for a in np.meshgrid(_middles(panel.width_m), _middles(panel.height_m), indexing="ij"))
    place = panel.radius_m * towards + across[:, None] * aside + (up + panel.centre_z_m)[:, None] * np.eye(3)[2]
    area = panel.width_m * panel.height_m
    reflectance = panel.reflectance
    if panel.circles is not None:
        dots = panel.circles
        share = dots.columns * dots.rows * np.pi * dots.radius_m**2 / area
        reflectance = panel.reflectance + min(share, 1.0) * (dots.reflectance - panel.reflectance)
    return _Patches(
        place=place, normal=np.tile(-towards, (across.size, 1)), area=np.full(across.size, area / across.size),
        reflectance=np.full(across.size, reflectance),
    )  # fmt: skip


def _middles(length: float) -> FloatArray:
    count = max(int(np.ceil(length / _PATCH_M - 1e-9)), 1)
    return np.asarray(((np.arange(count) + 0.5) / count - 0.5) * length)
