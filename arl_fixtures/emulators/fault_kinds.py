"""The kinds of fault an emulated bench knows, and what each does: the documentation that is also the check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Final


class FaultKind(StrEnum):
    """Every fault an emulated bench can have; `FAULT_KINDS` below says what each does."""

    SILENCE = "silence"
    LATE_REPLY = "late_reply"
    GARBAGE = "garbage"
    WRONG_CHECKSUM = "wrong_checksum"
    TRUNCATED_REPLY = "truncated_reply"
    MERGED_REPLIES = "merged_replies"
    DISCONNECT = "disconnect"
    RESET = "reset"
    BROWN_OUT = "brown_out"
    STUCK_VALUE = "stuck_value"
    DRIFT = "drift"
    OPEN_THERMOCOUPLE = "open_thermocouple"
    WRONG_CHANNEL_ORDER = "wrong_channel_order"
    SETPOINT_IGNORED = "setpoint_ignored"
    CHILLER_ALARM = "chiller_alarm"
    LOW_LEVEL = "low_level"
    PUMP_STOP = "pump_stop"
    STAGE_STALL = "stage_stall"
    MISSED_STEPS = "missed_steps"
    LIMIT_SWITCH = "limit_switch"
    RELAY_WELDED = "relay_welded"
    DUT_SILENT = "dut_silent"
    FROZEN_FRAME = "frozen_frame"
    LOST_ROWS = "lost_rows"
    DUPLICATED_ROWS = "duplicated_rows"
    REORDERED_ROWS = "reordered_rows"
    CORRUPTED_ROWS = "corrupted_rows"
    CLOCK_JUMP = "clock_jump"


@dataclass(frozen=True, slots=True, kw_only=True)
class KindInfo:
    """What a kind of fault does.

    Attributes:
        devices: roles it applies to (a device's name without its number).
        effect: what the device does, one sentence.
        value: what `Fault.value` means, empty where it has no meaning.
        default: value where the fault gives none.
    """

    devices: frozenset[str]
    effect: str
    value: str = ""
    default: float = 0.0


_STREAM: Final = frozenset({"chiller", "thermometer", "stage", "relays"})
_BINARY_CHECKED: Final = frozenset({"thermometer", "stage", "relays"})
_DUT: Final = frozenset({"dut"})

FAULT_KINDS: Final[Mapping[FaultKind, KindInfo]] = MappingProxyType(
    {
        FaultKind.SILENCE: KindInfo(
            devices=_STREAM,
            effect="Does not answer.",
            value="0: requests do not arrive; 1: requests are carried out, only the answer is lost",
        ),
        FaultKind.LATE_REPLY: KindInfo(
            devices=_STREAM, effect="Answers later; the order of answers is kept.", value="delay, s", default=2.0
        ),
        FaultKind.GARBAGE: KindInfo(
            devices=_STREAM,
            effect="Sends random bytes.",
            value="0: in place of the answer; n: n bytes before the answer",
        ),
        FaultKind.WRONG_CHECKSUM: KindInfo(
            devices=_BINARY_CHECKED, effect="Sends the last byte before the terminator with its lowest bit flipped."
        ),
        FaultKind.TRUNCATED_REPLY: KindInfo(
            devices=_STREAM, effect="Sends only the first bytes of each answer.", value="bytes sent", default=3.0
        ),
        FaultKind.MERGED_REPLIES: KindInfo(
            devices=_STREAM, effect="Holds an answer back and sends it in one piece with the next one."
        ),
        FaultKind.DISCONNECT: KindInfo(devices=_STREAM, effect="The line is cut."),
        FaultKind.RESET: KindInfo(
            devices=_STREAM | _DUT, effect="Restarts once and loses what it does not store; deaf while it starts."
        ),
        FaultKind.BROWN_OUT: KindInfo(
            devices=_STREAM | _DUT | {"bench"}, effect="Supply too low: deaf and without state for the duration."
        ),
        FaultKind.STUCK_VALUE: KindInfo(
            devices=frozenset({"thermometer", "chiller"}),
            effect="Keeps reporting what it measured when the fault began (`channel`, or all; chiller: bath).",
        ),
        FaultKind.DRIFT: KindInfo(
            devices=frozenset({"thermometer", "chiller"}),
            effect="The reported value drifts away (`channel`, or all; chiller: bath).",
            value="rate, K/h",
            default=10.0,
        ),
        FaultKind.OPEN_THERMOCOUPLE: KindInfo(
            devices=frozenset({"thermometer"}), effect="The wire of `channel` (or all) is open."
        ),
        FaultKind.WRONG_CHANNEL_ORDER: KindInfo(
            devices=frozenset({"thermometer"}),
            effect="The sensors are plugged one channel further, the last connected one into the first channel.",
            value="channels further",
            default=1.0,
        ),
        FaultKind.SETPOINT_IGNORED: KindInfo(
            devices=frozenset({"chiller"}),
            effect="A new set-point has no effect.",
            value="0: acknowledged but not followed; 1: the write answers with the old set-point",
        ),
        FaultKind.CHILLER_ALARM: KindInfo(
            devices=frozenset({"chiller"}),
            effect="Error bit and error code; temperature control stops.",
            value="error code (negative)",
            default=-4.0,
        ),
        FaultKind.LOW_LEVEL: KindInfo(
            devices=frozenset({"chiller"}),
            effect="The fill level falls to `value`; low warns, very low stops the pump with an error.",
            value="level, percent",
            default=4.0,
        ),
        FaultKind.PUMP_STOP: KindInfo(
            devices=frozenset({"chiller"}),
            effect="The pump stands still without an error code: no flow, no pressure.",
        ),
        FaultKind.STAGE_STALL: KindInfo(devices=frozenset({"stage"}), effect="The axis does not move any more."),
        FaultKind.MISSED_STEPS: KindInfo(
            devices=frozenset({"stage"}),
            effect="Each move falls short of its target while the step counter says otherwise.",
            value="shortfall, degrees",
            default=0.5,
        ),
        FaultKind.LIMIT_SWITCH: KindInfo(
            devices=frozenset({"stage"}),
            effect="A limit switch reads as pressed.",
            value="1: right, -1: left",
            default=1.0,
        ),
        FaultKind.RELAY_WELDED: KindInfo(
            devices=frozenset({"relays"}),
            effect="The contact of `channel` (1…8, or all) stays closed if it is; the read-back does not tell.",
        ),
        FaultKind.DUT_SILENT: KindInfo(devices=_DUT, effect="Sends nothing."),
        FaultKind.FROZEN_FRAME: KindInfo(devices=_DUT, effect="Sends the same frame again and again."),
        FaultKind.LOST_ROWS: KindInfo(devices=_DUT, effect="Rows are missing.", value="share of rows", default=0.05),
        FaultKind.DUPLICATED_ROWS: KindInfo(
            devices=_DUT, effect="Rows come twice.", value="share of rows", default=0.05
        ),
        FaultKind.REORDERED_ROWS: KindInfo(
            devices=_DUT, effect="Rows change places.", value="share of rows", default=0.05
        ),
        FaultKind.CORRUPTED_ROWS: KindInfo(
            devices=_DUT, effect="Rows carry wrong bytes.", value="share of rows", default=0.05
        ),
        FaultKind.CLOCK_JUMP: KindInfo(
            devices=frozenset({"bench", "dut"}),
            effect="`bench`: the host's wall clock is set; `dut`: its time stamps jump.",
            value="jump, s",
            default=3600.0,
        ),
    }
)
