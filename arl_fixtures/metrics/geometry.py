"""What every pixel should see at every angle of a sweep, stacked; 39 steps of a cycle share it."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Collection, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Final, TypeVar, final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.geometry_store import GeometryStore
from arl_fixtures.metrics.panels import centre_rays, pixel_extent_rad, view_panel
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.scene import WALL, SceneSettings
from arl_fixtures.twin.settings import DutSettings

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

Derived = TypeVar("Derived")

_SEEN: Final = "seen."
_IMAGES: Final = (
    "power",
    "azimuth_deg",
    "elevation_deg",
    "intensity_counts",
    "distance_m",
    "true_range_m",
    "cos_incidence",
    "reflectance",
    "surface",
    "mixed",
)

KEPT_SWEEPS: Final = 2
"""Ascending sweeps repeat exactly; some 15 MB each at full resolution."""
ANGLE_DIGITS: Final = 6
EDGE_PX: Final = 1.25
"""Half a pixel for its own field, the rest is 3.5 times what mount (0.2°), K and targets are known to: a pixel that
looks past the edge is off by tens of percent, and by another amount each time the stage comes to rest elsewhere."""


@final
class Geometry:
    """The twin's expectation for one DUT over a sweep; n angles, image H × W.

    Args:
        renderer: the twin of the DUT.
        stage_angle_deg: (n,) angles.
        known: what `stored` gave of the same twin at the same angles; rendered where not given.
        store: where `kept` keeps; None for nowhere.

    Attributes:
        stage_angle_deg: (n,).
        intensity_counts: (n, H, W) expected intensity.
        distance_m: (n, H, W) expected radial range (weighted over the pixel's field).
        true_range_m: (n, H, W) range of the pixel's centre ray.
        cos_incidence: (n, H, W) of the centre ray.
        reflectance: (n, H, W) where the centre ray hits.
        surface: (n, H, W) surface number.
        mixed: (n, H, W) the pixel's field touches more than one surface.
    """

    def __init__(
        self,
        renderer: Renderer,
        stage_angle_deg: Float64Array,
        known: Mapping[str, npt.NDArray[Any]] | None = None,
        store: GeometryStore | None = None,
    ) -> None:
        self._store = store
        self._derived: dict[Callable[[Geometry], Any], Any] = {}
        self.dut: DutSettings = renderer.dut
        self.scene: SceneSettings = renderer.scene
        self.stage_angle_deg = stage_angle_deg
        if known is not None:
            self._take(known)
            return
        self.power = renderer.power.astype(np.float32)
        azimuth_rad, elevation_rad = renderer.centre_directions_rad
        self.azimuth_deg: Float64Array = np.degrees(azimuth_rad)
        self.elevation_deg: Float64Array = np.degrees(elevation_rad)
        shape = (len(stage_angle_deg), renderer.dut.rows, renderer.dut.columns)
        self.intensity_counts = np.empty(shape, np.float32)
        self.distance_m = np.empty(shape, np.float32)
        self.true_range_m = np.empty(shape, np.float32)
        self.cos_incidence = np.empty(shape, np.float32)
        self.reflectance = np.empty(shape, np.float32)
        self.surface = np.empty(shape, np.int8)
        self.mixed = np.empty(shape, np.bool_)
        for k, angle_deg in enumerate(stage_angle_deg):
            frame = renderer.expected(float(angle_deg))
            self.intensity_counts[k] = frame.intensity_counts
            self.distance_m[k] = frame.distance_m
            self.true_range_m[k] = frame.true_range_m
            self.cos_incidence[k] = np.cos(np.radians(frame.incidence_deg))
            self.reflectance[k] = frame.reflectance
            self.surface[k] = frame.surface
            self.mixed[k] = frame.mixed

    def _take(self, known: Mapping[str, npt.NDArray[Any]]) -> None:
        for name in _IMAGES:
            setattr(self, name, known[name])
        # a cached property that is known need not be computed
        self.__dict__["_seen"] = {
            name.removeprefix(_SEEN): index for name, index in known.items() if name.startswith(_SEEN)
        }

    @property
    def stored(self) -> dict[str, npt.NDArray[Any]]:
        """Everything that is dear to compute, by name, for another process."""
        seen = {f"{_SEEN}{name}": index for name, index in self._seen.items()}
        return {name: getattr(self, name) for name in _IMAGES} | seen

    def derive(self, function: Callable[[Geometry], Derived]) -> Derived:
        """`function(self)`, computed once: what depends on the geometry alone is shared by all steps."""
        if function not in self._derived:
            self._derived[function] = function(self)
        return self._derived[function]  # type: ignore[no-any-return]  # keyed by the function that made it

    def kept(
        self, part: str, names: Collection[str], make: Callable[[], Mapping[str, npt.NDArray[Any]]]
    ) -> Mapping[str, npt.NDArray[Any]]:
        """Arrays that depend on the geometry alone and are dear: what `make` gives, or what it gave another process.

        Args:
            part: what they are, in one word.
            names: of the arrays; what lacks one of them is made anew.
            make: makes them.
        """
        known = None if self._store is None else self._store.read(self.stage_angle_deg, part)
        if known is not None and known.keys() >= set(names):
            return known
        made = make()
        if self._store is not None and made.keys() >= set(names):
            self._store.write(self.stage_angle_deg, made, part)
        return made

    @cached_property
    def stripes(self) -> tuple[str, ...]:
        """Names of the reflectance targets: panels without circles, dark to bright."""
        plain = [panel for panel in self.scene.panels if panel.circles is None]
        return tuple(panel.name for panel in sorted(plain, key=lambda panel: panel.reflectance))

    @cached_property
    def boards(self) -> tuple[str, ...]:
        """Names of the intrinsic targets: panels with circles."""
        return tuple(panel.name for panel in self.scene.panels if panel.circles is not None)

    @cached_property
    def _seen(self) -> dict[str, Int64Array]:
        surface = np.where(self.mixed, np.int8(-1), self.surface).ravel()
        seen = {self.scene.wall.name: np.flatnonzero(surface == WALL)}
        size = self.azimuth_deg.size
        rays = centre_rays(self.dut)
        width_rad, height_rad = pixel_extent_rad(self.dut)
        for number, panel in enumerate(self.scene.panels, start=1):
            index = np.flatnonzero(surface == number)
            angle, pixel = np.divmod(index, size)
            view = view_panel(self.dut, rays, panel, stage_angle_deg=self.stage_angle_deg, angle=angle, pixel=pixel)
            inside = np.abs(view.aside_m) < panel.width_m / 2 - EDGE_PX * width_rad[pixel] * view.range_m
            inside &= np.abs(view.up_m) < panel.height_m / 2 - EDGE_PX * height_rad[pixel] * view.range_m
            seen[panel.name] = index[inside]
        return seen

    def seen(self, surface: str) -> Int64Array:
        """Flat indices into (n, H, W) of pixels whose centre ray meets a surface well inside of it.

        From a panel's edges they keep `EDGE_PX`.
        """
        return self._seen[surface]

    @cached_property
    def weight(self) -> Float32Array:
        """Geometry and material without the beam: ρ cos θ (reference range / R)², (n, H, W)."""
        reference_m = np.float32(self.dut.reference_range_m)
        weight: Float32Array = self.reflectance * self.cos_incidence * (reference_m / self.true_range_m) ** 2
        return weight


@final
class GeometryCache:
    """Geometry of one DUT, remembered for the sweeps that were asked for last.

    Args:
        dut: the DUT as its file describes it: what it is compared with, not what it has become.
        scene: the chamber.
        store: folder where other processes find it, too; None for none.
    """

    def __init__(self, dut: DutSettings, scene: SceneSettings | None = None, store: Path | None = None) -> None:
        self._renderer = Renderer(dut, scene)
        self._store = None if store is None else GeometryStore(store, self._renderer)
        self._sweeps: OrderedDict[bytes, Geometry] = OrderedDict()

    def at(self, stage_angle_deg: Float64Array) -> Geometry:
        """Geometry at these angles.

        Args:
            stage_angle_deg: (n,) as in `SweepSummary`; rounded to a millionth of a degree.
        """
        rounded: Float64Array = np.round(stage_angle_deg, ANGLE_DIGITS).astype(np.float64)
        key = rounded.tobytes()
        known = self._sweeps.pop(key, None) or self._found(rounded)
        self._sweeps[key] = known
        while len(self._sweeps) > KEPT_SWEEPS:
            self._sweeps.popitem(last=False)
        return known

    def _found(self, stage_angle_deg: Float64Array) -> Geometry:
        known = None if self._store is None else self._store.read(stage_angle_deg)
        if known is not None and not known.keys() >= set(_IMAGES):
            known = None
        geometry = Geometry(self._renderer, stage_angle_deg, known, self._store)
        if known is None and self._store is not None:
            self._store.write(stage_angle_deg, geometry.stored)
        return geometry
