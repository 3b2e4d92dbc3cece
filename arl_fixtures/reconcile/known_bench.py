"""The bench that a twin's own frame shows: nothing needs to be recognised where the settings are at hand."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_bench import Bench
from arl_fixtures.reconcile.effects_camera import Camera
from arl_fixtures.reconcile.effects_rays import Optics, Spots
from arl_fixtures.twin.beam import BeamSettings
from arl_fixtures.twin.projection import Intrinsics
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings, Mount


def known_bench(dut: DutSettings, scene: SceneSettings, stage_angle_deg: float) -> Bench | None:
    """The bench of a whole frame, its pixels row by row.

    Args:
        dut: the sensor that the frame is simulated of.
        scene: what it looks at.
        stage_angle_deg: of the frame.

    Returns:
        None where such a bench cannot say how the sensor sees: mounted elsewhere than in the nominal place, another
        beam, or a lens of more than `k4`.
    """
    lens = dut.intrinsics
    plain = Intrinsics(fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy, k4=lens.k4)
    if dut.mount != Mount() or dut.beam != BeamSettings() or lens != plain:
        return None
    camera = Camera(fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy, k4=lens.k4)
    v, u = (place.ravel().astype(float) for place in np.mgrid[: dut.rows, : dut.columns])
    everywhere = np.ones(u.size)
    spots = Spots(u=u, v=v, stage_deg=stage_angle_deg * everywhere, height_m=dut.height_m * everywhere)
    counts = dut.full_scale_counts * dut.gain * dut.reference_range_m**2 * np.exp(camera.log_beam(u, v))
    with np.errstate(divide="ignore", invalid="ignore"):
        pedestal = np.where(counts > 0.0, dut.offset_counts / counts, 0.0)
    return Bench(
        index=np.arange(u.size), spots=spots, frame=np.zeros(u.size, dtype=np.int64), unit=1.0,
        optics=Optics(camera=camera, rays=dut.field_samples, soft_rad=0.0, scene=scene),
        pedestal=pedestal, ahead_m=0.0 * everywhere, complete=True,
    )  # fmt: skip
