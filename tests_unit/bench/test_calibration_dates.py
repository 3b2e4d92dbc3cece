"""The day up to which an instrument's calibration counts, as a bench file may say it."""

from __future__ import annotations

import pytest

from arl_fixtures.bench.config import BUILT_IN, load_bench
from arl_fixtures.errors import ConfigError


def bench_with(tmp_path, due: str):
    text = (BUILT_IN / "emulated.yaml").read_text().replace("../duts/", f"{BUILT_IN.parent}/duts/")
    path = tmp_path / "bench.yaml"
    path.write_text(text.replace("stage: {driver: tmcl,", f"stage: {{driver: tmcl, calibration_due: {due},"))
    return load_bench(str(path))


@pytest.mark.parametrize("due", ["2027-03-01", "'2027-03-01'"])
def test_a_day_is_a_day_with_and_without_quotes(tmp_path, due):
    assert bench_with(tmp_path, due).calibrations["stage.calibration_due"] == "2027-03-01"


@pytest.mark.parametrize("due", ["2027-02-31", "'2027-02-31'", "20270301", "soon", "2027-03-01 12:00:00", "'2027-3'"])
def test_what_is_no_day_is_refused_rather_than_never_expired(tmp_path, due):
    with pytest.raises(ConfigError, match=r"bench\.yaml"):
        bench_with(tmp_path, due)
