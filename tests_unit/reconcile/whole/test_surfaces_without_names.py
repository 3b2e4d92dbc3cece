"""A surface of the bench that is brighter than its certificate, in a table that does not name surfaces."""

import numpy as np
import traced_bench
from traced_bench import LIGHT, RANGE, table, trace

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose

KNOWN = [library()[name] for name in ("air.multipath", "target.reflectance_error", "detector.compression",
         "stage.zero_offset", "optics.veiling_glare", "detector.pixel_response")]  # fmt: skip

def repainted(monkeypatch, *, more, seed=3):
    """The nominal simulation of a bench whose middle stripe reflects more by a part."""
    columns = table(seed=seed, noise=False, angles=13)
    numbers, rng = columns.numbers, np.random.default_rng(seed)
    place = numbers["pixel_u"], numbers["pixel_v"], numbers["stage_angle_deg"], 0.10
    before, _ = trace(*place)
    monkeypatch.setattr(traced_bench, "STRIPES", ((7.5, 0.18), (0.0, 0.50 * (1.0 + more)), (-7.5, 0.80)))
    after, far = trace(*place)
    noise = rng.normal(size=(2, columns.n)) / np.sqrt(10.0)
    numbers[LIGHT] = numbers[f"sim_{LIGHT}"] * after / before + numbers[f"sim_{LIGHT}_std"] * noise[0]
    numbers[RANGE] = far + numbers[f"sim_{RANGE}_std"] * noise[1]
    return columns


def test_a_stripe_is_told_by_the_rays_that_meet_it(monkeypatch):
    (found,) = diagnose(repainted(monkeypatch, more=0.012), effects=KNOWN)[0].findings
    assert found.effect == "target.reflectance_error"
    assert found.drivers == ["stage_angle_deg", "azimuth_deg"]
    assert "stripe_50" in found.statement
    error = found.parameters[0]
    assert error.low < 0.012 < error.high
