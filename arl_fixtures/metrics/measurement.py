"""One measured metric of one DUT, or why it could not be measured."""

from __future__ import annotations

from dataclasses import dataclass

from arl_fixtures.quantity import Quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """A metric's value for a DUT and a scope within the step.

    Attributes:
        metric: name as limits refer to it, e.g. ``distance_error``.
        dut: serial number.
        scope: what part of the data it is about: a stripe, a parameter, a signal; empty for the whole DUT.
        quantity: the value; None when it could not be measured.
        reason: why there is no quantity; a remark on the value otherwise.
        attempted: False when there was nothing to attempt (no reference recorded yet): NOT_RUN rather than INVALID.
        reference: identity of the reference a relative value refers to; empty for absolute values.

    Raises:
        ValueError: neither a quantity nor a reason.
    """

    metric: str
    dut: str
    scope: str = ""
    quantity: Quantity | None = None
    reason: str = ""
    attempted: bool = True
    reference: str = ""

    def __post_init__(self) -> None:
        if self.quantity is None and not self.reason:
            msg = f"measurement '{self.metric}' of {self.dut} has neither a quantity nor a reason"
            raise ValueError(msg)

    @property
    def name(self) -> str:
        """Metric and scope as one text, e.g. ``distance_error[stripe_50]``."""
        return f"{self.metric}[{self.scope}]" if self.scope else self.metric
