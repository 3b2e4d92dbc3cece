"""An answer by the table's own names and units, where columns were read under known ones (`synonyms`)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from arl_fixtures.reconcile.columns import Given
from arl_fixtures.reconcile.diagnosis import Diagnosis, Finding


def in_own_words(diagnosis: Diagnosis, given: Mapping[str, Given]) -> Diagnosis:
    """What was found by the table's own names and units; the diagnosis itself stays as it is."""
    if not given:
        return diagnosis
    return replace(
        diagnosis, findings=[_reworded(finding, given) for finding in diagnosis.findings],
        notes={_named(name, given): _said(why, given) for name, why in diagnosis.notes.items()},
        invisible={effect: _said(why, given) for effect, why in diagnosis.invisible.items()},
    )  # fmt: skip


def _reworded(finding: Finding, given: Mapping[str, Given]) -> Finding:
    return replace(
        finding, drivers=[_named(name, given) for name in finding.drivers],
        where={_named(name, given): _in_own_unit(name, ends, given) for name, ends in finding.where.items()},
        expression=_replaced(finding.expression, {name: g.formula() for name, g in given.items()}),
        statement=_said(finding.statement, given), next_experiment=_said(finding.next_experiment, given),
    )  # fmt: skip


def _in_own_unit(name: str, ends: list[str] | list[float], given: Mapping[str, Given]) -> list[str] | list[float]:
    numbers = [x for x in ends if not isinstance(x, str)]
    return [given[name].back(x) for x in numbers] if name in given and numbers else ends


def _named(name: str, given: Mapping[str, Given]) -> str:
    return given[name].name if name in given else name


def _said(text: str, given: Mapping[str, Given]) -> str:
    return _replaced(text, {name: g.name for name, g in given.items()})


def _replaced(text: str, words: Mapping[str, str]) -> str:
    pattern = r"(?<![\w~])(" + "|".join(map(re.escape, sorted(words, key=len, reverse=True))) + r")(?!\w)"
    return re.sub(pattern, lambda match: words[match.group(1)], text)
