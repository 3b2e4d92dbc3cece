"""The page that describes the guard names every key there is, with its default."""

import re
from pathlib import Path

import pytest

from arl_fixtures.bench.guard_settings import Condition, GuardSettings

PAGE = (Path(__file__).parents[2] / "docs" / "guard.md").read_text(encoding="utf-8")
ROWS = {key: row for row in PAGE.splitlines() if row.startswith("|") for key in re.findall(r"`([a-z_]+)`", row)}


@pytest.mark.parametrize("key", [*GuardSettings.model_fields, *Condition.model_fields])
def test_every_key_has_its_place_in_a_table(key):
    assert key in ROWS, f"docs/guard.md does not explain '{key}'"


WITH_DEFAULT = [key for key, field in GuardSettings.model_fields.items() if field.default is not None]


@pytest.mark.parametrize("key", WITH_DEFAULT)
def test_the_table_tells_the_default(key):
    default = GuardSettings.model_fields[key].default
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{key}` |"))
    said = row.rstrip(" |").split("|")[-1].strip()
    if isinstance(default, bool):
        assert said == str(default).lower()
    elif isinstance(default, (int, float)):
        assert float(said) == default
    else:
        assert key == "conditions"


def test_every_watched_thing_is_explained():
    watched = Condition.model_fields["watch"].annotation.__args__
    assert [name for name in watched if f"`{name}`" not in PAGE] == []
