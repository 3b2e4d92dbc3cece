"""`docs/devices.md` and `docs/duts.md` name every setting of the devices as the code has it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from arl_fixtures.devices.chiller import HuberSettings
from arl_fixtures.devices.dut import HflSettings
from arl_fixtures.devices.relays import ConradSettings
from arl_fixtures.devices.stage import TmclSettings
from arl_fixtures.devices.thermometer import DconSettings
from arl_fixtures.emulators.chiller import ChillerEmulatorSettings
from arl_fixtures.emulators.dut import DutEmulatorSettings
from arl_fixtures.emulators.plant import PlantSettings
from arl_fixtures.emulators.relays import RelaysEmulatorSettings
from arl_fixtures.emulators.stage import StageEmulatorSettings
from arl_fixtures.emulators.thermometer import ThermometerEmulatorSettings
from arl_fixtures.twin.aging import AgingSettings
from arl_fixtures.twin.beam import BeamSettings
from arl_fixtures.twin.noise import NoiseSettings
from arl_fixtures.twin.operating import OperatingSettings
from arl_fixtures.twin.settings import DutSettings, Mount
from arl_fixtures.yaml_model import FileModel

DOCS = Path(__file__).parents[2] / "docs"
LINES = (
    HuberSettings, ChillerEmulatorSettings, DconSettings, ThermometerEmulatorSettings, TmclSettings,
    StageEmulatorSettings, ConradSettings, RelaysEmulatorSettings, PlantSettings,
)  # fmt: skip
DUTS = (
    HflSettings, DutEmulatorSettings, DutSettings, Mount, BeamSettings, NoiseSettings, OperatingSettings,
    AgingSettings,
)  # fmt: skip
MODELS = [("devices.md", model) for model in LINES] + [("duts.md", model) for model in DUTS]


def rows(model: type[FileModel]) -> list[str]:
    """One row of a table for each setting: name, default, meaning."""
    lines = []
    for name, field in model.model_fields.items():
        default = field.get_default(call_default_factory=True)
        written = {True: "true", False: "false", None: "null", math.inf: ".inf"}
        known = isinstance(default, bool) or default is None or default == math.inf
        text = written[default] if known else list(default) if isinstance(default, tuple) else default
        shown = "see below" if isinstance(default, (dict, FileModel)) else f"`{text}`"
        shown = "required" if field.is_required() else shown
        lines.append(f"| `{name}` | {shown} | {field.description} |")
    return lines


@pytest.mark.parametrize(("page_name", "model"), MODELS)
def test_every_setting_is_documented_as_it_is(page_name: str, model: type[FileModel]):
    page = (DOCS / page_name).read_text(encoding="utf-8")
    assert all(field.description for field in model.model_fields.values())
    assert [row for row in rows(model) if row not in page] == []
