"""One cause that shows in several read-outs is one finding: a bad contact in every temperature above it.

An effect acts on one channel, as its operator says. What two channels tell of the same cause (the same effect, in the
same units, by the same columns but for the channels' own) is fitted in each of them, and told once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from arl_fixtures.reconcile.diagnosis import Finding, HeldOut, ParameterValue

HeldOutOf = Callable[[Sequence[Finding], list[str]], HeldOut]
"""Before and after without all of some findings, over channels."""


def join_readouts(findings: Sequence[Finding], held_out: HeldOutOf) -> list[Finding]:
    """Findings, those of one cause in several channels joined into the strongest of them."""
    joined: list[Finding] = []
    for finding in findings:
        place = next((k for k, other in enumerate(joined) if _is_same_cause(other, finding)), None)
        if place is None:
            joined.append(finding)
        else:
            first, second = sorted((joined[place], finding), key=lambda f: -f.strength)
            joined[place] = _both(first, second, held_out)
    return joined


def _is_same_cause(one: Finding, other: Finding) -> bool:
    """Whether two findings are the same effect in the same unit, by the same conditions, in different channels."""
    if one.term is None or other.term is None or one.effect != other.effect or one.term.fields or other.term.fields:
        return False
    return (
        one.term.unit == other.term.unit
        and not set(one.channels) & set(other.channels)
        and conditions(one) == conditions(other)
    )


def conditions(finding: Finding) -> set[str]:
    """Drivers other than the channels' own simulation."""
    return set(finding.drivers) - {f"sim_{name}" for name in finding.channels} - set(finding.channels)


def _both(first: Finding, second: Finding, held_out: HeldOutOf) -> Finding:
    """The stronger finding with what the weaker one says of its channel."""
    channels = [*first.channels, *second.channels]
    where = {name: bounds for name, bounds in first.where.items() if second.where.get(name) == bounds}
    return replace(
        first, channels=channels, where=where, terms=[*first.terms, *second.terms],
        drivers=list(dict.fromkeys((*first.drivers, *second.drivers))),
        expression="; ".join(dict.fromkeys((first.expression, second.expression))),
        parameters=[*_of_channel(first), *_of_channel(second)],
        statement=" ".join(dict.fromkeys((first.statement, second.statement))),
        equivalent_to=[name for name in first.equivalent_to if name in second.equivalent_to],
        strength=first.strength + second.strength, held_out=held_out((first, second), channels),
    )  # fmt: skip


def _of_channel(finding: Finding) -> list[ParameterValue]:
    """Parameters under names that say of which channel they are; those of joined findings say it already."""
    if len(finding.terms) > 1:
        return finding.parameters
    return [replace(p, name=f"{p.name}_{finding.channels[0]}") for p in finding.parameters]
