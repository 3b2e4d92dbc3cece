"""`diagnosis.json` as the schema says."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from arl_fixtures.reconcile.diagnosis import Diagnosis, Finding


def as_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """Plain structure of a diagnosis; numbers that are not finite become 0."""
    return {
        "schema": "arl-diagnosis/1",
        "table": {
            "sha256": diagnosis.sha256, "rows": diagnosis.rows, "channels": diagnosis.channels,
            "not_used": diagnosis.notes,
        },
        "verdict": diagnosis.verdict,
        "false_alarm_probability": _number(diagnosis.false_alarm_probability),
        "findings": [_finding(f) for f in diagnosis.findings],
        "fit": {
            name: {
                "chi2_before": _number(f.before), "chi2_after": _number(f.after),
                "unexplained_fraction": _number(f.unexplained),
            }
            for name, f in diagnosis.fit.items()
        },
        "cannot_see": diagnosis.invisible,
    }  # fmt: skip


def _finding(f: Finding) -> dict[str, Any]:
    law: dict[str, Any] = {"expression": f.expression}
    if f.source:
        law["source"] = f.source
    law["parameters"] = [
        {"name": p.name, "value": _number(p.value), "unit": p.unit, "ci95": [_number(p.low), _number(p.high)]}
        for p in f.parameters
    ]
    made: dict[str, Any] = {
        "effect": f.effect, "equivalent_to": f.equivalent_to, "statement": f.statement, "channels": f.channels,
        "where": {k: [_plain(x) for x in v] for k, v in f.where.items()}, "drivers": f.drivers, "law": law,
        "held_out": {
            "blocks": f.held_out.blocks, "chi2_before": _number(f.held_out.before),
            "chi2_after": _number(f.held_out.after), "explained_fraction": _number(f.held_out.explained),
            "log_likelihood_gain": _number(f.held_out.gain),
        },
        "alternatives": [
            {
                "effect": a.effect, "held_out_gain": _number(a.gain),
                "verdict": "indistinguishable" if a.indistinguishable else "rejected", "reason": a.reason,
            }
            for a in f.alternatives
        ],
    }  # fmt: skip
    if f.next_experiment:
        made["next_experiment"] = f.next_experiment
    return made


def _plain(x: str | float) -> str | float:
    return x if isinstance(x, str) else _number(x)


def _number(x: float) -> float:
    return float(x) if math.isfinite(x) else 0.0


def write_json(path: Path, diagnosis: Diagnosis) -> None:
    """Write `diagnosis.json`."""
    path.write_text(json.dumps(as_json(diagnosis), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
