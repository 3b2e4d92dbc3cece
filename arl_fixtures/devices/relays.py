"""Conrad 8-relay board on a serial line, with read-back of every change.

After a reset, as interference can cause, the board has forgotten its address and opened all relays. The driver
notices (a frame that nobody takes comes back), numbers the chain again and reports what is: it never closes a
relay that nobody asked it to close.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final, final

from pydantic import Field, field_validator

from arl_fixtures.devices.exchange import Exchange, ExchangeSettings, Question
from arl_fixtures.devices.interfaces import Identity
from arl_fixtures.devices.port import Clock, StreamPort
from arl_fixtures.errors import DeviceError, LocalProtocolError, RemoteProtocolError
from arl_fixtures.protocols import conrad
from arl_fixtures.protocols.conrad import Command, ConradWire, Frame

DEFAULT_LOADS: Final[Mapping[str, int]] = MappingProxyType(
    {"dut_1": 1, "dut_2": 2, "dut_3": 3, "laser_1": 4, "laser_2": 5, "laser_3": 6}
)
"""K1…K3 supply the DUTs, K4…K6 enable their lasers."""


class ConradSettings(ConradWire):
    """Patience with a relay board, and what its relays switch; times on the bench clock."""

    timeout_s: float = Field(default=0.5, gt=0, description="boards are given up to about 100 ms by other drivers")
    retries: int = Field(default=2, ge=0, description="a board under reset is deaf for up to 1 s")
    quiet_s: float = Field(default=3.0, ge=0, description="no answer is later than this")
    loads: dict[str, int] = Field(default_factory=lambda: dict(DEFAULT_LOADS), description="load to relay, from 1")

    @field_validator("loads")
    @classmethod
    def _relays_exist_once(cls, loads: dict[str, int]) -> dict[str, int]:
        for load, relay in loads.items():
            if not 1 <= relay <= conrad.RELAYS:
                raise ValueError(f"load '{load}' is on relay {relay}; expected 1 to {conrad.RELAYS}")
        if len(set(loads.values())) != len(loads):
            raise ValueError("two loads are on one relay")
        return loads


@final
class ConradRelays:
    """Driver for the first board of a chain.

    Args:
        port: the line.
        clock: the bench clock.
        settings: address, loads and patience.
    """

    def __init__(self, port: StreamPort, clock: Clock, settings: ConradSettings | None = None) -> None:
        self._settings = settings = settings or ConradSettings()
        patience = ExchangeSettings(timeout_s=settings.timeout_s, retries=settings.retries, quiet_s=settings.quiet_s)
        self._exchange = Exchange("relays", port, clock, patience, fences=self._fences)
        self._loads = dict(sorted(settings.loads.items(), key=lambda item: item[1]))
        self._version: int | None = None
        self._setups = 0

    @property
    def resets_seen(self) -> int:
        """How often the board was found without its address after it had been set up."""
        return max(self._setups - 1, 0)

    def loads(self) -> Sequence[str]:
        """Names of the loads in relay order."""
        return tuple(self._loads)

    def identify(self) -> Identity:
        """Firmware as the board told it at set-up."""
        if self._version is None:
            self._set_up()
        return Identity(name="Conrad 8-relay board", firmware=str(self._version))

    def set(self, load: str | int, on: bool) -> None:
        """Switch one relay, by load or number from 1, and verify it by read-back (two exchanges).

        Raises:
            DeviceError: the board does not hold what it was told.
        """
        self._switch(conrad.mask(self._relay(load)), on, str(load))

    def states(self) -> dict[str, bool]:
        """What the board holds for every load; not what its contacts do."""
        port = self.port_state()
        return {load: bool(port & conrad.mask(relay)) for load, relay in self._loads.items()}

    def port_state(self) -> int:
        """What the board holds, bit 0 = K1."""
        return self._do(Command.GET_PORT, 0).data

    def all_off(self, loads: Iterable[str | int] | None = None) -> None:
        """Switch these loads off, every load if none are named, and verify it (two exchanges)."""
        relays = [self._relay(load) for load in (self._loads if loads is None else loads)]
        self._switch(sum({conrad.mask(relay) for relay in relays}), False, "all loads")

    def close(self) -> None:
        """Release the line; the relays stay as they are."""
        self._exchange.close()

    def _relay(self, load: str | int) -> int:
        if isinstance(load, int):
            return load
        if load not in self._loads:
            known = ", ".join(self._loads)
            raise LocalProtocolError(f"{self._exchange.place}: no load '{load}'; known are {known}")
        return self._loads[load]

    def _switch(self, mask: int, on: bool, what: str) -> None:
        if not mask:
            return
        self._do(Command.SET_SINGLE if on else Command.DEL_SINGLE, mask)
        held = self.port_state()
        if held & mask != (mask if on else 0):
            raise DeviceError(
                f"{self._exchange.place}: {what} not switched {'on' if on else 'off'}: "
                f"the board holds {held:08b} (K8…K1), asked for mask {mask:08b}"
            )

    def _do(self, command: Command, data: int) -> Frame:
        if self._version is None:
            self._set_up()
        answer = self._exchange.ask(self._question(command, data))
        if answer.command == command:
            # nobody took it: the board lost its address
            self._set_up()
            answer = self._exchange.ask(self._question(command, data))
            if answer.command == command:
                raise DeviceError(f"{self._exchange.place}: no board with address {self._settings.address}")
        return answer

    def _set_up(self) -> None:
        address = self._settings.address
        frame = Frame(Command.SETUP, address, 0)
        boards = self._exchange.ask(
            Question(
                "set-up",
                Command.SETUP,
                conrad.encode(frame),
                lambda received: conrad.find_setup_end(received, address),
            )
        )
        if not boards:
            raise DeviceError(f"{self._exchange.place}: no relay board in the chain")
        self._version = boards[0].data
        self._setups += 1

    def _question(self, command: Command, data: int) -> Question[Frame]:
        address = self._settings.address

        def find(received: bytes) -> Frame | None:
            answer = conrad.find_reply(received, command, address)
            if answer is None and conrad.find_error(received, address) is not None:
                raise RemoteProtocolError(f"{self._exchange.place}: '{command.name}' arrived broken at the board")
            return answer

        what = command.name.lower().replace("_", " ")
        return Question(what, command, conrad.encode(Frame(command, address, data)), find)

    def _fences(self) -> Iterator[Question[object]]:
        # an answer to NOP looks like a complaint, so it is no fence
        yield self._question(Command.GET_OPTION, 0)
        yield self._question(Command.GET_PORT, 0)
