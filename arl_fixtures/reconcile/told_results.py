"""What a forked process found, as bytes: numbers, arrays, and what this package makes of them; nothing that runs.

An object that both processes hold is told by its address, which a fork keeps. Of other objects only plain values,
containers, arrays of numbers, and the records and enumerations of this package that are loaded already can be told.
"""

from __future__ import annotations

import enum
import json
import sys
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_OURS = __name__.split(".")[0] + "."
_LENGTH = 8


def told_as(found: object, held: Iterable[int]) -> bytes:
    """Bytes that `told_from` makes the same of.

    Args:
        found: what is told.
        held: addresses of objects that both sides hold.

    Raises:
        TypeError: it holds something that cannot be told.
    """
    arrays: list[NDArray[Any]] = []
    text = json.dumps(_told(found, set(held), arrays)).encode()
    parts = [text]
    for array in arrays:
        parts += [json.dumps([array.dtype.str, array.shape]).encode(), array.tobytes()]
    return b"".join(len(part).to_bytes(_LENGTH, "little") + part for part in parts)


def told_from(data: bytes, held: dict[int, object]) -> Any:  # noqa: ANN401 - whatever was told
    """What was told.

    Args:
        data: of `told_as`; held: the objects that both sides hold, by address.
    """
    parts, at = [], 0
    while at < len(data):
        size = int.from_bytes(data[at : at + _LENGTH], "little")
        parts.append(data[at + _LENGTH : at + _LENGTH + size])
        at += _LENGTH + size
    arrays = []
    for head, body in zip(parts[1::2], parts[2::2], strict=True):
        kind, shape = json.loads(head)
        arrays.append(np.frombuffer(body, dtype=np.dtype(kind)).reshape(shape).copy())
    return _made(json.loads(parts[0]), held, arrays)


def _told(one: object, held: set[int], arrays: list[NDArray[Any]]) -> object:
    if id(one) in held:
        return {"held": id(one)}
    if isinstance(one, enum.Enum):
        return {"enum": _name_of(one), "value": one.name}
    if one is None or isinstance(one, bool | int | float | str):
        return one
    if isinstance(one, np.generic):
        return one.item()
    if isinstance(one, np.ndarray) and one.dtype.kind in "biuf":
        arrays.append(np.ascontiguousarray(one).reshape(one.shape))
        return {"array": len(arrays) - 1}
    if is_dataclass(one):
        return {"made": _name_of(one), "of": {f.name: _told(getattr(one, f.name), held, arrays) for f in fields(one)}}
    if isinstance(one, tuple) and hasattr(one, "_fields"):
        return {"made": _name_of(one), "of": {n: _told(getattr(one, n), held, arrays) for n in one._fields}}
    if isinstance(one, list | tuple):
        return {type(one).__name__: [_told(each, held, arrays) for each in one]}
    if isinstance(one, dict):
        return {"dict": [[_told(key, held, arrays), _told(value, held, arrays)] for key, value in one.items()]}
    raise TypeError(f"{type(one).__name__} cannot be told to another process")


def _made(told: Any, held: dict[int, object], arrays: list[NDArray[Any]]) -> Any:  # noqa: ANN401 - whatever was told
    if not isinstance(told, dict):
        return told
    match told:
        case {"held": address}:
            return held[address]
        case {"enum": name, "value": value}:
            return _kind(name)[value]
        case {"array": index}:
            return arrays[index]
        case {"made": name, "of": parts}:
            return _kind(name)(**{part: _made(value, held, arrays) for part, value in parts.items()})
        case {"list": items}:
            return [_made(item, held, arrays) for item in items]
        case {"tuple": items}:
            return tuple(_made(item, held, arrays) for item in items)
        case {"dict": items}:
            return {_made(key, held, arrays): _made(value, held, arrays) for key, value in items}
    raise TypeError(f"nothing is told by {sorted(told)}")


def _name_of(one: object) -> list[str]:
    kind = type(one)
    if not kind.__module__.startswith(_OURS) or "." in kind.__qualname__:
        raise TypeError(f"{kind.__qualname__} is none of this package's records")
    return [kind.__module__, kind.__qualname__]


def _kind(name: list[str]) -> Any:  # noqa: ANN401 - a class of this package
    if not name[0].startswith(_OURS):
        raise TypeError(f"{'.'.join(name)} is none of this package's records")
    return vars(sys.modules[name[0]])[name[1]]
