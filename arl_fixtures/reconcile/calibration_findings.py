"""What is off by calibration alone: a constant of each unit, or a gain and a zero of each, which nothing drives."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arl_fixtures.reconcile.calibrated_units import fitted_lines
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.diagnosis import Finding, ParameterValue
from arl_fixtures.reconcile.held_out import held_out_of
from arl_fixtures.reconcile.model_file import unit_keys

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision

AGAIN = "Calibrate once more, then repeat: a constant is either calibration or set-up."


def constant_finding(decision: Decision, d: ChannelData) -> Finding:
    """A channel that is off by a constant gain or offset of each unit, which no effect explains."""
    state = decision.problem.view.fresh_state()
    values, widths = d.constants(d.residual(state)), 1.96 * d.constant_errors
    unit = "1" if d.scale.min() != 1.0 or d.scale.max() != 1.0 else d.channel.unit
    word = "gain" if unit == "1" else "offset"
    parameters = [
        ParameterValue(name=f"{word}_{k + 1}", value=float(v), unit=unit, low=float(v - w), high=float(v + w))
        for k, (v, w) in enumerate(zip(values, widths, strict=True))
    ]
    held = held_out_of(
        [d], state, state, decision.problem.groups.block_name, 0.5 * float(np.sum((values / widths) ** 2))
    )
    name = d.channel.name
    columns = list(decision.problem.groups.unit_columns)
    each = f" of each {', '.join(columns)}" if columns else ""
    return Finding(
        effect="unknown", channels=[name], where={}, drivers=columns,
        expression=f"{name} *= 1 + gain{each}" if word == "gain" else f"{name} += offset{each}", source="",
        parameters=parameters, held_out=held, strength=held.gain,
        statement=f"{name} is off by a constant {word}{each}; nothing that was recorded drives it.",
        next_experiment=AGAIN,
    )  # fmt: skip


def line_finding(decision: Decision, d: ChannelData) -> Finding:
    """A channel that is off by a gain and a zero of each unit, with which the simulation was compared."""
    problem, name = decision.problem, d.channel.name
    view, columns = problem.view, problem.groups.unit_columns
    lines = decision.search.lines[name]
    code, keys = unit_keys(view, columns)
    gain, zero = np.array([lines.get(key, (0.0, 0.0)) for key in keys])[code].T
    now = view.fresh_state()
    before = {**now, name: (now[name] - zero) / (1.0 + gain)}
    found = fitted_lines(problem, d)
    widths = 1.96 * found.errors if found is not None else np.full((d.units, 2), np.inf)
    parameters = []
    for unit in range(d.units):
        own = lines[keys[code[d.use[np.flatnonzero(d.unit == unit)[0]]]]]
        for k, (word, kind) in enumerate((("gain", "1"), ("zero", d.channel.unit))):
            low, high = own[k] - widths[unit, k], own[k] + widths[unit, k]
            parameters.append(
                ParameterValue(name=f"{word}_{unit + 1}", value=own[k], unit=kind, low=float(low), high=float(high))
            )
    left = [0.5 * float(np.sum((d.root_weight * d.residual(state)) ** 2)) for state in (before, now)]
    each = f"of each {', '.join(columns)}"
    return Finding(
        effect="unknown", channels=[name], where={}, drivers=list(columns),
        expression=f"{name} = (1 + gain) * {name} + zero, {each}", source="", parameters=parameters,
        held_out=held_out_of([d], before, now, problem.groups.block_name, left[0] - left[1]),
        strength=max(left[0] - left[1], 0.0), next_experiment=AGAIN,
        statement=f"{name} is off by a gain and a zero {each}; nothing that was recorded drives them.",
    )  # fmt: skip
