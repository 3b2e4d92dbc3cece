"""A burst of datagrams as one piece of bytes.

    per datagram: length of payload (u32) | length of sender (u8) | arrival (f64, bench seconds) | sender | payload
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from arl_fixtures.devices.port import Datagram
from arl_fixtures.errors import RemoteProtocolError

_HEAD: Final = struct.Struct(">IBd")


def pack_datagrams(datagrams: Sequence[Datagram]) -> bytes:
    """Bytes of a burst; the order is kept."""
    parts = []
    for payload, sender, time_s in datagrams:
        name = sender.encode("ascii")
        parts += [_HEAD.pack(len(payload), len(name), time_s), name, payload]
    return b"".join(parts)


def unpack_datagrams(data: bytes) -> list[Datagram]:
    """Datagrams of a burst.

    Raises:
        RemoteProtocolError: the bytes end within a datagram.
    """
    datagrams, place = [], 0
    while place < len(data):
        try:
            size, name_size, time_s = _HEAD.unpack_from(data, place)
        except struct.error:
            raise RemoteProtocolError("lab: the burst ends within a datagram") from None
        place += _HEAD.size
        end = place + name_size + size
        if end > len(data):
            raise RemoteProtocolError("lab: the burst ends within a datagram")
        sender = data[place : place + name_size].decode("ascii", "replace")
        datagrams.append(Datagram(data[place + name_size : end], sender, time_s))
        place = end
    return datagrams
