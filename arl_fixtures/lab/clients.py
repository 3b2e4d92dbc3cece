"""Who is connected to a lab, what each waits for, and what the lab asks of the world that it serves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Literal, Protocol

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.links import VirtualDatagramPort, VirtualNetwork, VirtualStreamPort
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.errors import LocalProtocolError
from arl_fixtures.lab.framing import Peer

Role = Literal["driver", "follower", "onlooker"]
ROLES: Final[tuple[Role, ...]] = ("driver", "follower", "onlooker")
NEVER: Final = math.inf


class World(Protocol):
    """What the lab serves; `arl_fixtures.bench.build.Emulated` is one."""

    clock: VirtualClock
    plant: Plant
    network: VirtualNetwork

    def port(self, kind: Any) -> VirtualStreamPort:  # noqa: ANN401 - a Literal of device roles
        """A new port to one of the control lines."""

    def enter_step(self, step: CycleStep) -> None:
        """A temperature step begins: what ages by the cycle count hears of it."""


@dataclass(slots=True)
class Waiting:
    """A request that is answered later.

    `finish` answers it if it can be answered at the present bench time and says whether it did.
    """

    finish: Callable[[], bool]
    wake_s: float


@dataclass(slots=True)
class Client:
    """One connected process."""

    number: int
    peer: Peer
    pid: int
    name: str = ""
    role: Role = "follower"
    runs_since_s: float = 0.0
    asked: Any = None
    waiting: Waiting | None = None
    lent_to: int = 0
    lines: dict[str, VirtualStreamPort] = field(default_factory=dict)
    networks: dict[int, VirtualDatagramPort] = field(default_factory=dict)

    @property
    def runs(self) -> bool:
        """Whether it computes, and so holds the clock."""
        return self.waiting is None and not self.lent_to and self.role != "onlooker"

    @property
    def jumps(self) -> bool:
        """Whether time may jump for its sake."""
        return self.role == "driver"


def role_of(text: str) -> Role:
    """The role of that name.

    Raises:
        LocalProtocolError: there is none.
    """
    for role in ROLES:
        if role == text:
            return role
    raise LocalProtocolError(f"lab: unknown role '{text}'; known are {', '.join(ROLES)}")
