"""An effect does what it does to more than one row: where one wild reading alone speaks for a name, none is given."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.effect import Effect, Stage, Variant
from arl_fixtures.reconcile.effects_common import amplitude
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

ROWS, WILD, NOISE_M = 2400, 0.04, 0.002


class Splash(Effect):
    """Rain on the window delays what a wet row reports."""

    id = "plugin.splash"
    stage = Stage.TIMING
    source = "this test"

    def variants(self, view):
        yield Variant(effect=self.id, options={}, parameters=(amplitude("delay", "m", -5.0, 5.0, 0.1),),
                      channels=("distance_m",), drivers=("rain_mm",))  # fmt: skip

    def apply(self, variant, values, state, view):
        state["distance_m"] = state["distance_m"] + values["delay"] * view.number("rain_mm")

    def expression(self, variant):
        return "distance_m += delay * rain_mm"

    def sentence(self, variant, values, view):
        return "Rain delays the distance."


def in_the_rain(wet, by=-1.3, seed=5):
    """A rangefinder among other lasers: some readings are metres early; rows `wet` saw rain, which is off by `by`."""
    rng = np.random.default_rng(seed)
    far = rng.uniform(2.0, 30.0, ROWS)
    early = np.where(rng.random(ROWS) < WILD, -rng.uniform(0.5, 2.0, ROWS), 0.0)
    rain = np.zeros(ROWS)
    rain[wet], early[wet] = 1.0, by
    return columns_of(pa.table({
        "step": np.repeat(np.arange(24.0), ROWS // 24), "rain_mm": rain, "n_frames": np.ones(ROWS),
        "sim_distance_m": far, "sim_distance_m_std": np.full(ROWS, NOISE_M),
        "distance_m": far + early + rng.normal(0.0, NOISE_M, ROWS),
    }))  # fmt: skip


@pytest.mark.parametrize(("wet", "named"), [([700], []), (range(300, 2400, 150), ["plugin.splash"])])
def test_one_wild_reading_is_no_witness(wet, named):
    found = diagnose(in_the_rain(list(wet)), effects=[Splash()])[0].findings
    assert [finding.effect for finding in found if finding.effect != "unknown"] == named


class Drizzle(Splash):
    """Rain on the window delays what a wet row reports, and dims it."""

    id = "plugin.drizzle"

    def variants(self, view):
        both = amplitude("delay", "m", -5.0, 5.0, 0.1), amplitude("dim", "counts", -90.0, 90.0, 9.0)
        yield Variant(effect=self.id, options={}, parameters=both, channels=("distance_m", "intensity_counts"),
                      drivers=("rain_mm",))  # fmt: skip

    def apply(self, variant, values, state, view):
        super().apply(variant, values, state, view)
        state["intensity_counts"] = state["intensity_counts"] - values["dim"] * view.number("rain_mm")


@pytest.mark.parametrize(("wet", "named"), [([700], []), (range(300, 2400, 150), ["plugin.drizzle"])])
def test_one_reading_that_is_wild_in_two_channels_is_no_witness_either(wet, named):
    columns = in_the_rain(list(wet), by=-4.5 * NOISE_M)
    rng, rain = np.random.default_rng(8), columns.numbers["rain_mm"]
    light = rng.uniform(500.0, 900.0, ROWS)
    seen = light - 4.5 * 4.0 * rain + rng.normal(0.0, 4.0, ROWS)
    table = pa.table(dict(columns.numbers) | {
        "sim_intensity_counts": light, "sim_intensity_counts_std": np.full(ROWS, 4.0), "intensity_counts": seen,
    })  # fmt: skip
    found = diagnose(columns_of(table), effects=[Drizzle()])[0].findings
    assert [finding.effect for finding in found if finding.effect != "unknown"] == named
