"""The answer to a comparison: findings with their laws, and what stays unexplained (plain data of the schema)."""

from __future__ import annotations

from dataclasses import dataclass, field

from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.terms import Term


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterValue:
    """A fitted parameter with its 95 % interval."""

    name: str
    value: float
    unit: str
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Alternative:
    """Another effect in the place of a finding.

    Attributes:
        gain: held-out gain over that of the finding.
        indistinguishable: whether this table cannot tell them apart.
    """

    effect: str
    gain: float
    indistinguishable: bool
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Before and after on blocks that took no part in fitting (mean squares in standard errors)."""

    blocks: str
    before: float
    after: float
    explained: float
    gain: float


@dataclass(slots=True, kw_only=True)
class Finding:
    """One mismatch, named or unknown.

    Attributes:
        terms: the effect with its values; more than one where one cause shows in several channels; none of an
            unknown one.
        law: the empirical law of an unknown one.
        strength: log-likelihood it gains (order of the findings).
    """

    effect: str
    channels: list[str]
    where: dict[str, list[str] | list[float]]
    drivers: list[str]
    expression: str
    source: str
    parameters: list[ParameterValue]
    statement: str
    held_out: HeldOut
    alternatives: list[Alternative] = field(default_factory=list)
    equivalent_to: list[str] = field(default_factory=list)
    next_experiment: str = ""
    strength: float = 0.0
    terms: list[Term] = field(default_factory=list)
    law: Law | None = None

    @property
    def term(self) -> Term | None:
        """The first term: of the channel that tells most; None of an unknown one."""
        return self.terms[0] if self.terms else None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelFit:
    """How a channel agrees before and after all findings."""

    before: float
    after: float
    unexplained: float


@dataclass(slots=True, kw_only=True)
class Diagnosis:
    """Everything a comparison answers.

    Attributes:
        constants: channel to unit label to the fitted gain (relative) or offset, zero ones left out.
        notes: column to what could not be used.
        lines: channel to unit label to the gain less one and the zero with which the simulation was compared.
        invisible: effect id to why this table could not have shown it.
    """

    sha256: str
    rows: int
    channels: list[str]
    false_alarm_probability: float
    findings: list[Finding]
    fit: dict[str, ChannelFit]
    constants: dict[str, dict[str, float]]
    notes: dict[str, str]
    invisible: dict[str, str] = field(default_factory=dict)
    lines: dict[str, dict[str, tuple[float, float]]] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """`consistent` or `mismatch`."""
        return "mismatch" if self.findings else "consistent"
