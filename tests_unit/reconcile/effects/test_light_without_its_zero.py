"""Stray light of a turning sensor of which few pixels were kept: by ranges alone, and behind a fitted zero."""

import numpy as np
import pytest
from operator_tables import fit, table
from rendered_bench import corrected, variant_of

LIGHT, RANGE = "intensity_counts", "distance_m"

SHARE, FAR_M, MEAN = 4e-3, 1.52, 700.0


def swept(*, zero):
    """Nine pixels over twelve angles; every row gathers the same light from a range that no row sees."""
    angle, pixel = (a.ravel() for a in np.meshgrid(np.arange(12) * 3.0, np.arange(9.0), indexing="ij"))
    rng = np.random.default_rng(8)
    light, far = np.exp(rng.uniform(4.4, 7.5, angle.size)), rng.choice([1.1, 1.6], angle.size)
    stray = SHARE * MEAN
    mixed = (light * far + stray * FAR_M) / (light + stray)  # a centroid, by light
    measured = light + stray - (stray if zero else 0.0)
    return table(
        stage_angle_deg=angle, pixel_u=10.0 * pixel, pixel_v=3.0 * pixel, step=np.zeros(angle.size),
        sim_intensity_counts=light, intensity_counts=measured, sim_distance_m=far, distance_m=mixed,
    )  # fmt: skip


@pytest.mark.parametrize("zero", [False, True])
def test_ranges_tell_how_much_light_comes_from_where(zero):
    view = swept(zero=zero)
    light = float(variant_of(view, "optics.veiling_glare", over="scene").options["light"])
    variant = variant_of(view, "optics.veiling_glare", over="scene", **({"zero": light} if zero else {}))
    found = fit(view, variant, RANGE, {"share": 1e-3, "far": 1.3})
    assert found["share"] * light == pytest.approx(SHARE * MEAN, rel=0.02)
    assert found["far"] == pytest.approx(FAR_M, abs=0.01)
    # what is scattered is missing where it would have gone: a few permille of a row's own light
    left = corrected(view, variant, **found)[LIGHT] - view.number(LIGHT)
    assert np.max(np.abs(left / view.sim[LIGHT])) < 1.5 * found["share"] + 1e-4
