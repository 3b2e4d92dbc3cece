"""What an effect does to other channels, or at the ends of an array, by the way: counted and convolved here."""

import numpy as np

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.terms import Term, forward
from arl_fixtures.reconcile.view import View
from tests_unit.reconcile.whole.test_seldom_names import columns_of

LIGHT, FAR = "intensity_counts", "distance_m"
ROWS, COLUMNS, STEPS = 12, 16, 10


def leaking_array(share: float, *, dummies: bool, seed: int = 3) -> Columns:
    """Charge diffuses to four neighbours; at the ends of the array into dummy pixels, or nowhere."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0:ROWS, 0:COLUMNS]
    images = []
    for step in range(STEPS):
        board = np.where((u + 3 * step) % 11 < 5, 0.8, 0.2)
        images.append(5e3 * board * np.exp(-0.5 * (((u - 7.5) / 11.0) ** 2 + ((v - 5.5) / 9.0) ** 2)))
    image = np.stack(images)
    padded = np.pad(image, ((0, 0), (1, 1), (1, 1)), mode="constant" if dummies else "edge")
    beside = padded[:, :-2, 1:-1] + padded[:, 2:, 1:-1] + padded[:, 1:-1, :-2] + padded[:, 1:-1, 2:]
    real = (image + share * (beside - 4.0 * image)).ravel()
    step, row, column = (a.ravel() for a in np.meshgrid(np.arange(STEPS), np.arange(ROWS), np.arange(COLUMNS),
                                                        indexing="ij"))  # fmt: skip
    spread = np.sqrt(40.0 + image.ravel())
    return columns_of(
        {
            "step": step, "pixel_u": column, "pixel_v": row, "n_frames": np.full(step.size, 40.0),
            "azimuth_deg": 1.5 * (column - 7.5), "elevation_deg": 1.5 * (row - 5.5),
            f"sim_{LIGHT}": image.ravel(), f"sim_{LIGHT}_std": spread,
            f"sim_{LIGHT}_repeat_std": 1e-4 * image.ravel(),
            LIGHT: real + spread / np.sqrt(40.0) * rng.normal(size=step.size),
        }
    )  # fmt: skip


def test_charge_that_leaves_the_array_is_no_second_finding():
    findings = diagnose(leaking_array(0.004, dummies=True))[0].findings
    assert [found.effect for found in findings] == ["detector.crosstalk"]
    share = next(p for p in findings[0].parameters if p.name == "share")
    assert share.low <= 0.004 <= share.high


def test_charge_that_stays_in_the_array_is_found_as_well():
    findings = diagnose(leaking_array(0.004, dummies=False))[0].findings
    assert [found.effect for found in findings] == ["detector.crosstalk"]
    assert "ends" not in findings[0].terms[0].variant.options


def test_a_line_of_pixels_has_ends_along_itself_only():
    columns = leaking_array(0.004, dummies=False)
    line = {name: values[columns.numbers["pixel_v"] == 4.0] for name, values in columns.numbers.items()}
    view = View(columns_of({name: values for name, values in line.items() if name != "pixel_v"}))
    variant = next(iter(library()["detector.crosstalk"].variants(view)))
    (aside,) = library()["detector.crosstalk"].aside(variant, view)
    term = Term(effect=library()["detector.crosstalk"], variant=aside, values={"share": 0.01})
    lost = view.sim[LIGHT] - forward([term], view)[LIGHT]
    plain = view.sim[LIGHT] - forward([Term(effect=term.effect, variant=variant, values=term.values)], view)[LIGHT]
    at_end = np.isin(view.number("pixel_u"), [0.0, COLUMNS - 1.0])
    np.testing.assert_allclose((lost - plain)[at_end], 0.01 * view.sim[LIGHT][at_end])
    assert not np.any((lost - plain)[~at_end])


BIN_M, BINS, PULSE_M, FRAMES = 0.05, 24, 0.08, 200


def counter(dark_per_bin: float, seed: int = 6) -> Columns:
    """Photons counted in bins about a pulse, from 7 before it to 16 behind: their sum and their mean time."""
    rng = np.random.default_rng(seed)
    place = BIN_M * (np.arange(BINS) - 7.0)
    shape = np.exp(-0.5 * (place / PULSE_M) ** 2)
    shape /= shape.sum()
    step, target, _ = (a.ravel() for a in np.meshgrid(np.arange(12), np.arange(6), np.arange(4), indexing="ij"))
    warm = np.linspace(10.0, 85.0, 12)[step]
    photons, true = np.array([9.0, 40.0, 18.0, 75.0, 28.0, 13.0])[target], 1.5 + 0.6 * target
    dark = dark_per_bin * 2.0 ** ((warm - 85.0) / 9.0)
    seen = []
    for light, noise in zip(photons, dark, strict=True):
        counts = rng.poisson(light * shape + noise, size=(FRAMES, BINS))
        total = counts.sum(axis=1)
        middle = (counts @ place)[total > 0] / total[total > 0]
        seen.append((total.mean(), total.std(ddof=1), middle.mean(), middle.std(ddof=1)))
    total, total_std, middle, middle_std = np.array(seen).T
    return columns_of(
        {
            "step": step, "tof_temperature_c": warm, "true_range_m": true,
            "n_frames": np.full(step.size, float(FRAMES)), f"sim_{LIGHT}": photons,
            f"sim_{LIGHT}_std": np.sqrt(photons), LIGHT: total, f"{LIGHT}_std": total_std,
            f"sim_{FAR}": true, f"sim_{FAR}_std": PULSE_M / np.sqrt(photons), FAR: true + middle,
            f"{FAR}_std": middle_std,
        }
    )  # fmt: skip


def test_dark_counts_that_pull_and_widen_a_centroid_are_one_finding():
    findings = diagnose(counter(0.12))[0].findings
    assert [found.effect for found in findings] == ["detector.dark_offset"]
    assert {LIGHT, FAR, f"{FAR}_std"} <= set(findings[0].channels)
    behind = next(p for p in findings[0].parameters if p.name == "behind")
    assert behind.low <= BIN_M * ((BINS - 1) / 2.0 - 7.0) <= behind.high
