"""What a journal line can say. Plain texts and numbers: a journal outlives the code that wrote it.

Each model is one value of `type`. Non-finite numbers are the strings "NaN", "Infinity" and "-Infinity", so that each
line is valid JSON. Texts that came from devices are kept, made valid Unicode, and bounded.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter

SCHEMA: Final = "arl-journal/1"
_MAX_TEXT: Final = 10_000


def clean_text(text: object) -> object:
    """Valid Unicode of bounded length; lone surrogates become escapes."""
    if not isinstance(text, str):
        return text
    whole = text if text.isascii() else text.encode("utf-8", "backslashreplace").decode()
    return whole if len(whole) <= _MAX_TEXT else whole[:_MAX_TEXT] + "…"


Text = Annotated[str, BeforeValidator(clean_text)]
VerdictName = Literal["PASS", "CONDITIONAL", "NOT_RUN", "INVALID", "FAIL"]


class JournalModel(BaseModel):
    """Base: frozen, no unknown keys, NaN as text."""

    model_config = ConfigDict(extra="forbid", frozen=True, ser_json_inf_nan="strings")


class Dut(JournalModel):
    """A device under test.

    Attributes:
        serial: serial number.
        model: type name that limits may refer to.
    """

    serial: Text
    model: Text = ""


class Identity(JournalModel):
    """What a session may not change under way.

    Attributes:
        duts: in the order of the bench file.
        bench_name: name of the bench.
        bench_sha256: hash of the bench file.
        profile_name: name of the profile.
        profile_sha256: hash of the profile.
        limits_name: name of the limits.
        limits_sha256: hash of the limits; may change, judgements say so.
        software_version: version of this package; may change, too.
    """

    duts: tuple[Dut, ...]
    bench_name: Text = ""
    bench_sha256: str
    profile_name: Text = ""
    profile_sha256: str
    limits_name: Text = ""
    limits_sha256: str
    software_version: str


class SessionBegin(JournalModel):
    """First line of every journal.

    Attributes:
        schema_version: `arl-journal/1`.
        campaign: name of the campaign.
        cycles: cycle counts that this session is to run.
        plan: ids of all steps in order.
        identity: bench, profile, limits, DUTs, software.
        rejudged_from: file name of the journal whose measurements this one judges anew; empty for a session.
        environment: what else identifies bench and software (instruments with calibration dates, seed, platform).
    """

    type: Literal["session_begin"] = "session_begin"
    schema_version: Literal["arl-journal/1"] = SCHEMA
    campaign: Text
    cycles: tuple[int, ...]
    plan: tuple[str, ...]
    identity: Identity
    rejudged_from: Text = ""
    environment: dict[str, Text] = Field(default_factory=dict)


class SessionResume(JournalModel):
    """The session goes on after an interruption, in the same file."""

    type: Literal["session_resume"] = "session_resume"
    identity: Identity
    reason: Text = ""


class Repair(JournalModel):
    """A torn last line was cut off before the session went on.

    Attributes:
        discarded_bytes: length of what was cut off.
        discarded: its beginning, escaped.
    """

    type: Literal["repair"] = "repair"
    discarded_bytes: int
    discarded: Text


class SessionEnd(JournalModel):
    """The session ended by itself.

    Attributes:
        reason: `finished`, or what stopped it.
        verdict: worst of its cycles.
    """

    type: Literal["session_end"] = "session_end"
    reason: Text
    verdict: VerdictName


class CycleEnd(JournalModel):
    """All steps of a cycle are done; `decided_by` names step, DUT and metric of the worst verdict."""

    type: Literal["cycle_end"] = "cycle_end"
    cycle: int
    verdict: VerdictName
    decided_by: Text = ""


class StepBegin(JournalModel):
    """An attempt at a step begins; everything about it bears the same `step_id` and `attempt`."""

    type: Literal["step_begin"] = "step_begin"
    step_id: str
    attempt: int = Field(ge=1)
    cycle: int
    step_index: int
    set_temperature_c: float
    ramp: int


class Settle(JournalModel):
    """How settling ended."""

    type: Literal["settle"] = "settle"
    step_id: str
    attempt: int
    settled: bool
    duration_s: float
    overshoot_k: float = 0.0
    reason: Text = ""


class Contribution(JournalModel):
    """One named source of standard uncertainty, in the unit of its value."""

    name: Text
    u: float
    kind: Literal["A", "B"]
    dof: float


class Measurement(JournalModel):
    """One value of one DUT, or why there is none.

    Attributes:
        dut: serial number.
        metric: name as limits refer to it.
        scope: stripe, parameter, signal; empty for the whole DUT.
        value: in `unit`; None when it could not be measured.
        unit: empty for a ratio, or when there is no value.
        u: standard uncertainty in `unit`.
        dof: effective degrees of freedom.
        contributions: what `u` is made of.
        reason: why there is no value, or a remark.
        attempted: False when there was nothing to attempt.
        reference: identity of the reference of a relative value.
    """

    type: Literal["measurement"] = "measurement"
    step_id: str
    attempt: int
    dut: Text
    metric: str
    scope: Text = ""
    value: float | None
    unit: str = ""
    u: float | None = None
    dof: float | None = None
    contributions: tuple[Contribution, ...] = ()
    reason: Text = ""
    attempted: bool = True
    reference: Text = ""


class AppliedLimit(JournalModel):
    """The limit a value was held against, with its decision rule."""

    unit: str
    lower: float | None = None
    upper: float | None = None
    severity: str
    reason: Text
    rule: str
    coverage: float
    guard_factor: float


class Judgement(JournalModel):
    """The verdict on one measurement; `limit` is None where none applies and the value decides nothing."""

    type: Literal["judgement"] = "judgement"
    step_id: str
    attempt: int
    dut: Text
    metric: str
    scope: Text = ""
    limit: AppliedLimit | None
    verdict: VerdictName
    risk: float
    reason: Text = ""


class Bag(JournalModel):
    """A finished recording.

    Attributes:
        path: relative to the journal's folder, with forward slashes.
        sha256: content hash as `bag_sha256` computes it.
    """

    type: Literal["bag"] = "bag"
    step_id: str
    attempt: int
    path: str
    sha256: str
    size_bytes: int
    message_count: int


class StepEnd(JournalModel):
    """An attempt ended.

    Attributes:
        finished: False when it broke off and is to be repeated (device lost, safe stop).
        verdict: worst of its judgements that decide.
        reason: what decided, or what broke it.
        temperatures_c: mean over the sweep, by sensor.
    """

    type: Literal["step_end"] = "step_end"
    step_id: str
    attempt: int
    finished: bool
    verdict: VerdictName
    reason: Text = ""
    temperatures_c: dict[str, float] = Field(default_factory=dict)


class Recovery(JournalModel):
    """What was kept of a bag that a crash had cut."""

    type: Literal["recovery"] = "recovery"
    step_id: str
    attempt: int
    source: Text
    path: Text
    sha256: str
    message_count: int
    fault: Text


class Alarm(JournalModel):
    """A guarded condition tripped."""

    type: Literal["alarm"] = "alarm"
    source: Text
    condition: Text
    value: float | None = None
    unit: str = ""
    action: Text


class Fault(JournalModel):
    """A device did not do what it should, and what was done about it."""

    type: Literal["fault"] = "fault"
    device: Text
    message: Text
    action: Text


class SafeAction(JournalModel):
    """One step into the safe state, and whether read-back proved it."""

    name: Text
    verified: bool
    detail: Text = ""


class SafeStop(JournalModel):
    """The bench was brought into its safe state; the next session waits for an acknowledgement."""

    type: Literal["safe_stop"] = "safe_stop"
    cause: Text
    actions: tuple[SafeAction, ...] = ()


class Acknowledgement(JournalModel):
    """Someone took note of a safe stop."""

    type: Literal["acknowledgement"] = "acknowledgement"
    of_seq: int
    by: Text
    note: Text = ""


class Note(JournalModel):
    """Anything worth a line that nothing depends on."""

    type: Literal["note"] = "note"
    text: Text


Entry = Annotated[
    SessionBegin
    | SessionResume
    | Repair
    | SessionEnd
    | CycleEnd
    | StepBegin
    | Settle
    | Measurement
    | Judgement
    | Bag
    | StepEnd
    | Recovery
    | Alarm
    | Fault
    | SafeStop
    | Acknowledgement
    | Note,
    Field(discriminator="type"),
]

ENTRY: Final[TypeAdapter[Entry]] = TypeAdapter(Entry)
