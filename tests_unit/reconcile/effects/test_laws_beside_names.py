"""What a law must gain to stand against a name: of a neighbour's rows, of the name's own columns."""

import numpy as np
import pytest
from operator_tables import image_of, image_view, table
from rendered_bench import corrected, variant_of

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.rivals import needed_by_law
from arl_fixtures.reconcile.terms import Term, default_values


def test_a_law_of_neighbouring_rows_is_no_rival_of_a_name_that_mixes_them():
    """Neighbours say in other words what crosstalk says; a temperature, or a name of one row, is another matter."""
    view = image_view(*(image_of()[k] for k in (2, 3, 0, 1)))

    def term(effect):
        variant = variant_of(view, effect)
        return Term(effect=library()[effect], variant=variant, values=default_values(variant))

    needed = [
        needed_by_law(100.0, 0.0, [term(effect)], columns)
        for effect, columns in (
            ("detector.crosstalk", ["tof_temperature_c", "~edge(intensity_counts)"]),
            ("detector.crosstalk", ["tof_temperature_c"]),
            ("detector.compression", ["~edge(intensity_counts)"]),
        )
    ]
    assert needed[0] > 1.5 * needed[1] == 1.5 * needed[2]


def test_a_law_of_a_names_own_columns_must_do_better_than_one_of_others():
    """It has the freer shape only; a law of other columns tells of another cause."""
    view = image_view(*(image_of()[k] for k in (2, 3, 0, 1)))
    variant = variant_of(view, "detector.crosstalk")
    acting = [Term(effect=library()[variant.effect], variant=variant, values=default_values(variant))]
    own, other = (needed_by_law(100.0, 0.0, acting, columns) for columns in (["pixel_u"], ["tof_temperature_c"]))
    assert own > other


@pytest.mark.parametrize("end", ["low", "high"])
def test_a_beam_is_blurred_by_no_more_than_a_law_of_second_order_holds_for(end):
    u, v = (a.ravel().astype(float) for a in np.meshgrid(np.arange(48), np.arange(6)))
    angle = 0.75 * (u - 23.5)
    fine = np.arange(-90.0, 90.0, 0.02)

    def beam(variance):  # of rays of 6 deg, each spread by 8 deg and what the blur adds to that
        spread = np.exp(-0.5 * np.arange(-60.0, 60.01, 0.02) ** 2 / (64.0 + variance))
        rays = np.exp(-0.5 * (fine / 6.0) ** 2)
        return np.interp(angle, fine, np.convolve(rays, spread / spread.sum(), mode="same"))

    view = table(pixel_u=u, pixel_v=v, azimuth_deg=angle, elevation_deg=0.75 * (v - 2.5),
        sim_signal_counts=1000.0 * beam(0.0),
    )  # fmt: skip
    blur = variant_of(view, "beam.profile_change", kind="blur")
    along = blur.parameters[0]
    most = getattr(along, end)
    values = {p.name: most if p is along else 0.0 for p in blur.parameters}
    told = corrected(view, blur, **values)["signal_counts"] / view.sim["signal_counts"]
    np.testing.assert_allclose(told, beam(most) / beam(0.0), rtol=0.16)
