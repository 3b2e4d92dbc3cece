"""The Python examples of docs/bag.md and docs/journal.md run as they stand."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import journal_samples as sample
import numpy as np
import pytest

from arl_fixtures.journal.entries import ENTRY, JournalModel
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.writer import StepBagWriter

DOCS = Path(__file__).parents[2] / "docs"


def examples(page: str) -> list[str]:
    found = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text("utf-8"), re.DOTALL)
    assert found
    return found


def write_bag(folder: Path) -> None:
    metadata = StepMetadata(
        campaign="docs",
        cycle=3,
        step=7,
        step_id=folder.name,
        attempt=1,
        set_temperature_c=25.0,
        ramp=1,
        started_utc_ns=0,
        duts=("SN-1",),
        software_version="0",
        bench_sha256="",
        profile_sha256="",
        limits_sha256="",
    )
    with StepBagWriter(folder, metadata) as bag:
        bag.block(
            AngleBlock(
                dut="SN-1",
                angle_index=0,
                stage_angle_deg=0.9,
                time_ns=np.arange(2),
                intensity_counts=np.zeros((2, 2, 4, 6), dtype=np.uint16),
                distance_m=np.ones((2, 2, 4, 6), dtype=np.float32),
                row_valid=np.ones((2, 4), dtype=np.bool_),
            )
        )


@pytest.mark.parametrize(
    ("example", "printed"),
    list(
        zip(
            examples("bag.md"),
            ["25.0 SN-1 0.9 (2, 4, 6)", "", "/dut_SN_1/row_valid sensor_msgs/msg/Image"],
            strict=True,
        )
    ),
)
def test_examples_of_the_bag_page(
    example: str, printed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(tmp_path / "c0003-07-up+25C")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(example, names)
    assert printed in capsys.readouterr().out
    if not printed:
        np.testing.assert_array_equal(names["metres"], np.ones((4, 6)))


@pytest.mark.parametrize(
    ("example", "printed"), list(zip(examples("journal.md"), ["1 FAIL 2", "0.012 m 0.001"], strict=True))
)
def test_examples_of_the_journal_page(
    example: str,
    printed: str,
    make_journal: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(make_journal(*sample.attempt(0, 1, "FAIL"), *sample.attempt(0, 2, "PASS")).parent)
    exec(example, {})
    assert printed in capsys.readouterr().out


def test_every_entry_and_key_is_on_the_page() -> None:
    page = (DOCS / "journal.md").read_text("utf-8")
    for name, definition in ENTRY.json_schema()["$defs"].items():
        model = next((each for each in JournalModel.__subclasses__() if each.__name__ == name), None)
        assert model is not None, name
        for key in definition["properties"]:
            assert (
                f"`{key}`" in page
                or key in {"bench_name", "profile_name", "limits_name"}
                or key.endswith(("_sha256", "coverage", "guard_factor", "rule", "lower", "upper", "severity"))
            ), f"{name}.{key}"
