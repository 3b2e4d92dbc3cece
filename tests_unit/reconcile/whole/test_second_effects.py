"""The fainter of two effects on one channel keeps its name where it is no mend of the stronger one's law."""

import numpy as np
import pyarrow as pa
from upright_boards import BOARDS, COLUMNS, F_PX, ROWS, seen

from arl_fixtures.reconcile.acceptance import TWIN_GAIN
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.fit import finish, fit
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.screen import screen
from arl_fixtures.reconcile.search import POLISHED, Search
from arl_fixtures.reconcile.table import columns_of


def some(*names):
    return [library()[name] for name in names]


def test_a_gain_that_steps_differ_by_is_the_first_of_its_kind_beside_unequal_columns(make_table):
    """A breakdown voltage that follows the warmth, and two converters in turn; the bench's repeatability unknown."""

    def both(columns, _rng):
        share = 150.0 / (165.0 + 0.14 * 0.04 * (columns["tof_temperature_c"] - 40.0))
        gain = (1.0 - (150.0 / 165.0) ** 2) / (1.0 - share**2)
        apart = np.where(columns["pixel_u"] % 2 == 0, 1.5, -1.5)
        columns["intensity_counts"] = columns["intensity_counts"] * gain + apart

    table = {name: x for name, x in make_table(73, both, duts=1, steps=8).items() if "distance_m" not in name}
    del table["sim_intensity_counts_repeat_std"]
    rivals = some(
        "readout.column_pattern", "detector.gain_temperature", "laser.thermal_rolloff", "laser.power_decay",
        "detector.dark_offset", "detector.compression", "optics.vignetting", "target.reflectance_error",
    )  # fmt: skip
    findings = diagnose(columns_of(pa.table(table)), effects=rivals)[0].findings
    assert [f.effect for f in findings] == ["readout.column_pattern", "detector.gain_temperature"]


def diode(current, sink, loss):
    """Power of a diode whose junction lies 8 K/W of its lost power above the heat sink, with `loss` per cm inside."""
    junction = sink.copy()
    for _ in range(60):
        limit = 0.25 * (loss + 12.0) / 16.0 * np.exp((junction - 25.0) / 120.0)
        slope = 1.0 * 16.0 / (loss + 12.0) * np.exp(-(junction - 25.0) / 400.0)
        power = slope * 0.008 * np.logaddexp(0.0, (current - limit) / 0.008)
        lost = current * (1.6 + 0.3 * current) - power
        junction = 0.5 * junction + 0.5 * (sink + 8.0 * lost)
    return power


def life_test(seed, heat, wear):
    """Curves at three heat sinks after four ages; `heat` and `wear` are the shares of what a diode really does."""
    rng = np.random.default_rng(seed)
    age, level, place = (
        a.ravel() for a in np.meshgrid(np.arange(4), np.arange(3), np.arange(32), indexing="ij")
    )  # fmt: skip
    current, hours = 0.02 + 0.05 * place, 700.0 * age
    sink = 25.0 + heat * 24.0 * (level - 0.5)
    cold = diode(current, np.full(place.size, 25.0), np.full(place.size, 4.0))
    seen = diode(current, sink, 4.0 + wear * 0.25 * (hours / 2100.0) ** 0.8)
    sigma = np.hypot(4e-4, 0.002 * cold)
    shared = 1.0 + 0.002 * rng.normal(size=12)[age * 3 + level]
    return columns_of(pa.table({
        "operating_h": hours, "readout": (100 * age + level).astype(float), "laser_current_a": current,
        "heatsink_temperature_c": 25.0 + 24.0 * (level - 0.5), "n_frames": np.full(place.size, 5.0),
        "sim_optical_power_w": cold, "sim_optical_power_w_std": sigma,
        "optical_power_w": seen * shared + sigma / np.sqrt(5.0) * rng.normal(size=place.size),
    }))  # fmt: skip


LASER = ("laser.thermal_rolloff", "laser.power_decay", "detector.compression", "detector.gain_temperature",
         "detector.dark_offset", "bench.repeatability")  # fmt: skip


def test_a_diode_that_ages_is_told_beside_its_heat_though_both_are_read_off_the_drive_current():
    found = diagnose(life_test(11, 0.12, 1.0), effects=some(*LASER))[0].findings
    assert {f.effect for f in found} == {"laser.thermal_rolloff", "laser.power_decay"}
    aged = next(f for f in found if f.effect == "laser.power_decay")
    assert "operating_h" in aged.drivers


def test_a_diode_that_is_warm_and_new_has_not_aged():
    found = diagnose(life_test(12, 0.12, 0.0), effects=some(*LASER))[0].findings
    assert "laser.power_decay" not in {f.effect for f in found}


def test_a_round_fits_every_variant_of_the_effect_that_it_chooses(make_table):
    """Of one effect the shortlist holds the two that promise most to first order; the rest is fitted all the same."""

    def veiled(columns, _rng):
        far = np.hypot(columns["azimuth_deg"], columns["elevation_deg"])
        columns["intensity_counts"] = columns["intensity_counts"] * np.cos(np.radians(0.4 * far)) ** 4

    search = Search(columns_of(pa.table(make_table(31, veiled))), some("beam.profile_change"))
    base = finish(search.full, fit(search.full, ()))
    screening = screen(search.small, search.variants, with_chance=True)
    stage = search.ask(base, screening, screening)
    promising = [c.term.label for c in screening.candidates if c.gain > 0.0 and not c.term.unit]
    assert stage.chosen is not None
    assert len(promising) > 2
    if not stage.chosen.candidate.term.unit:
        assert {r.candidate.term.label for r in stage.ranked} >= set(promising[:POLISHED])
    assert stage.chosen.gain >= max(r.gain for r in stage.ranked) - 2.0 * TWIN_GAIN


def board_at(bearing):
    """Number of the board that a ray meets, −1 for the wall."""
    met = np.full(bearing.size, -1)
    for number, (middle, half, _, _) in enumerate(BOARDS):
        met[np.abs(bearing - middle) < half] = number
    return met


def boards(seed, whiter, stretch):
    """Boards before a wall, in one image row, from fifteen angles: the last is whiter than thought, ranges longer."""
    rng = np.random.default_rng(seed)
    step, stage, v, u = (
        x.ravel()
        for x in np.meshgrid(np.arange(4), np.arange(-28.0, 28.5, 4.3), [(ROWS - 1) / 2], np.arange(1.0, 29.0, 4.0),
                             indexing="ij")
    )  # fmt: skip
    light, far = seen(u, v, stage)
    middle, half, level, white = BOARDS[-1]
    true, there = seen(u, v, stage, boards=(*BOARDS[:-1], (middle, half, level, white * (1.0 + whiter))))
    x = u - (COLUMNS - 1) / 2
    left, own, right = (board_at(np.degrees(np.arctan((x + at) / F_PX)) + stage) for at in (-0.5, 0.0, 0.5))
    gain, off = 1.0 + 0.003 * rng.normal(size=4)[step], 0.001 * rng.normal(size=4)[step]
    return columns_of(pa.table({
        "step": step, "housing_temperature_c": 10.0 + 15.0 * step, "pixel_u": u, "pixel_v": v,
        "stage_angle_deg": stage, "azimuth_deg": np.degrees(np.arctan(x / F_PX)),
        "elevation_deg": np.degrees(np.arctan(((ROWS - 1) / 2 - v) / np.hypot(F_PX, x))),
        "surface": np.array(["wall", "a", "b", "c", "d"])[own + 1], "mixed": (left != own) | (right != own),
        "sim_intensity_counts": 1e3 * light, "sim_intensity_counts_std": 4.6 * light,
        "sim_intensity_counts_repeat_std": 3.0 * light,
        "intensity_counts": 1e3 * true * gain + 4.6 * light * rng.normal(size=u.size),
        "sim_distance_m": far, "sim_distance_m_std": np.full(u.size, 0.0012),
        "sim_distance_m_repeat_std": np.full(u.size, 0.001),
        "distance_m": there * (1.0 + stretch) + off + 0.0012 * rng.normal(size=u.size),
    }))  # fmt: skip


def test_what_all_ranges_show_is_no_mend_of_one_whiter_board():
    """The board moves ranges too, of the few pixels that see its edges; surfaces differ in range, so most of a scale
    lies between them."""
    findings = diagnose(boards(3, 0.04, 1.6e-3))[0].findings
    assert [f.effect for f in findings] == ["target.reflectance_error", "timing.clock_scale"]
