"""What a law must gain to stand against a name: of a neighbour's rows, of the name's own columns."""

from operator_tables import image_of, image_view
from rendered_bench import bench, variant_of

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.rivals import needed_by_law
from arl_fixtures.reconcile.terms import Term, default_values
from arl_fixtures.reconcile.view import View


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


def test_one_line_of_another_column_needs_no_more_than_two_names_gain():
    view = image_view(*(image_of()[k] for k in (2, 3, 0, 1)))
    variants = [variant_of(view, f"detector.{name}") for name in ("compression", "crosstalk")]
    names = [Term(effect=library()[v.effect], variant=v, values=default_values(v)) for v in variants]
    assert needed_by_law(100.0, 0.0, names, ["simultaneous_returns"], is_line=True) == 100.0
    assert needed_by_law(100.0, 0.0, names, ["simultaneous_returns"]) > 100.0
    assert needed_by_law(100.0, 0.0, names[:1], ["simultaneous_returns"], is_line=True) > 100.0
    assert needed_by_law(100.0, 0.0, names, ["pixel_u"], is_line=True) > 100.0  # it is their own


def test_a_law_of_how_the_scene_turns_is_a_turning_names_own():
    """A free curve over the stage angle times what a degree changes has the freer shape; no other cause."""
    view = View(bench(angles=(-9.0, 9.0, 41), columns=(56, 72)))
    variant = variant_of(view, "stage.periodic_error")
    acting = [Term(effect=library()[variant.effect], variant=variant, values=default_values(variant))]
    turned, of_rail = (
        needed_by_law(1000.0, 0.0, acting, [column, "~per_turn(intensity_counts)"])
        for column in ("stage_angle_deg", "rail_1v8_v")
    )
    assert turned > of_rail
