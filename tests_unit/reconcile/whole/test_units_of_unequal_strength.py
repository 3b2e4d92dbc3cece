"""Two devices of one kind that do not age alike: one cause, in a strength of its own in each."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile
from tests_unit.reconcile.whole.test_seldom_names import grid

LIGHT = "intensity_counts"
UNITS = {"HFL-1": 1.0, "HFL-2": 0.5}


def campaign(cycles, units, seed=5, *, hurt=1.0):
    """Lasers of four hundred emitters with hazards of their own that die one by one; steps scatter by 0.4 %."""
    rng = np.random.default_rng(seed)
    cycle, step, stop, pixel = grid(np.asarray(cycles), np.arange(6), np.arange(3), np.arange(10))
    light = 900.0 * np.array([0.2, 0.5, 0.8])[stop] * (1.0 - 0.01 * (pixel - 4.5) ** 2)
    noise = np.sqrt(light + 30.0)
    parts = []
    for name, pace in units.items():
        hazard = np.random.default_rng(11).gamma(4.0, 0.25, 400)
        age = cycle + step / 6.0
        alive = np.mean(np.exp(-0.011 * hurt * pace * hazard[None, :] * age[:, None]), axis=1)
        shared = 0.004 * rng.normal(size=(max(cycles) + 1, 6))[cycle, step] * light
        parts.append(
            {
                "dut": np.full(cycle.size, name), "cycle": cycle, "step": step, "time_s": 1200.0 * step + 30.0 * stop,
                "set_temperature_c": np.array([40.0, 10.0, -20.0, -20.0, 10.0, 40.0])[step],
                "stage_angle_deg": 5.0 * stop, "pixel_u": pixel, "n_frames": np.full(cycle.size, 10.0),
                f"sim_{LIGHT}": light, f"sim_{LIGHT}_std": noise, f"sim_{LIGHT}_repeat_std": 0.004 * light,
                LIGHT: light * alive + shared + rng.normal(0.0, noise / np.sqrt(10.0)), "alive": alive,
            }
        )  # fmt: skip
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def written(path, columns, *without):
    pq.write_table(pa.table({n: v for n, v in columns.items() if n not in ("alive", *without)}), path)
    return path


def test_two_lasers_that_do_not_age_alike_have_one_name_and_each_its_own_fading(tmp_path):
    (found,) = reconcile(written(tmp_path / "t.parquet", campaign(range(1, 8), UNITS)), tmp_path / "out").findings
    assert "laser.power_decay" in {found.effect, *found.equivalent_to}
    told = {p.name: p for p in found.parameters}
    ratio = told["strength_HFL-2"].value / told["strength_HFL-1"].value
    assert ratio == pytest.approx(0.5, abs=0.1)
    assert "HFL-1 1." in found.statement
    assert "HFL-2 0." in found.statement

    for units, least in ((UNITS, 0.98), ({"HFL-3": 0.75}, 0.95)):  # an unseen device fades as they do on average
        later = campaign([9, 10], units, seed=6)
        new = written(tmp_path / "new.parquet", later, LIGHT)
        predict(tmp_path / "out", new, tmp_path / "said.parquet")
        said = pq.read_table(tmp_path / "said.parquet")[f"corrected_{LIGHT}"].to_numpy()
        sim = later[f"sim_{LIGHT}"]
        off, before = said / sim - later["alive"], 1.0 - later["alive"]
        assert 1.0 - np.sum(off**2) / np.sum(before**2) > least


def test_lasers_that_age_alike_have_no_strengths_of_their_own(tmp_path):
    alike = campaign(range(1, 8), dict.fromkeys(UNITS, 0.8))
    (found,) = reconcile(written(tmp_path / "t.parquet", alike), tmp_path / "out").findings
    assert not [p for p in found.parameters if p.name.startswith("strength_")]
