"""Names that tell whole steps apart, beside a scene that stands elsewhere than simulated, and stays there."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.fit import finish, fit
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.step_means import leaves_what_stays
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.terms import Term, default_values

STEPS, PIXELS = 9, 120
COUNTS = "intensity_counts"


def recorded(change):
    """A still image in which a tenth of the pixels see another surface than simulated; `change` is the detector's."""
    rng = np.random.default_rng(4)
    step, pixel = (x.ravel() for x in np.meshgrid(np.arange(STEPS), np.arange(PIXELS), indexing="ij"))
    of_pixel = rng.uniform(200.0, 2500.0, PIXELS)
    moved = np.where(rng.uniform(size=PIXELS) < 0.1, rng.normal(0.0, 0.15, PIXELS), 0.0)
    temperature = np.array([-10.0, 5.0, 20.0, 35.0, 50.0, 65.0, 80.0, 42.0, 12.0])[step]
    sim, sigma = of_pixel[pixel], np.sqrt(30.0 + 0.3 * of_pixel[pixel])
    true = change(sim * (1.0 + moved[pixel]), temperature)
    table = columns_of(pa.table({
        "step": step.astype(float), "pixel_u": (pixel % 15).astype(float), "pixel_v": (pixel // 15).astype(float),
        "tof_temperature_c": temperature, "n_frames": np.full(step.size, 20.0), f"sim_{COUNTS}": sim,
        f"sim_{COUNTS}_std": sigma, f"sim_{COUNTS}_repeat_std": 0.002 * sim,
        COUNTS: rng.normal(true, sigma / np.sqrt(20.0)),
    }))  # fmt: skip
    return table, moved[pixel]


def fitted(effect, table):
    """The engine's search on a table, with an effect of its library fitted in its channel."""
    search = Search(table, [library()[effect]])
    variant = next(iter(library()[effect].variants(search.full.view)))
    term = Term(effect=library()[effect], variant=variant, values=default_values(variant))
    found = finish(search.full, fit(search.full, [term], rounds=12))
    search.full.refit_scatter(found.state)  # what the name explains is no scatter of steps any more
    return search, found.terms


def stands_beside(effect, table, left):
    search, terms = fitted(effect, table)
    data = search.full.data[0]
    return leaves_what_stays(search.full, data, terms, terms[0], np.arange(len(data.use)), left[data.use])


def warm_gain(light, temperature):
    """Current of a photodiode behind an amplifier whose resistor warms by 0.4 % for ten kelvin."""
    return light * (1.0 + 4e-4 * (temperature - 25.0))


def leaking(light, temperature):
    """Charge of an exposure of 10 ms, thermally generated over half of silicon's gap."""
    kelvin = temperature + 273.15
    return light + 60.0 * np.exp(-0.56 / 8.617e-5 * (1.0 / kelvin - 1.0 / 353.15))


@pytest.mark.parametrize(
    ("change", "effect"),
    [(warm_gain, "detector.gain_temperature"), (leaking, "detector.dark_offset")],
    ids=["gain", "dark"],
)
def test_what_tells_steps_apart_stands_beside_what_stays(change, effect):
    table, moved = recorded(change)
    assert stands_beside(effect, table, moved)


def test_but_not_beside_what_comes_and_goes_with_it():
    table, moved = recorded(warm_gain)
    growing = moved * (table.numbers["tof_temperature_c"] - 30.0)
    assert not stands_beside("detector.gain_temperature", table, growing)


def test_nor_does_what_gains_by_what_stays():
    table, moved = recorded(lambda light, _t: light)
    assert not stands_beside("detector.gain_temperature", table, moved)
