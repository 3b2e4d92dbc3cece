"""Seeded noise as a function of (seed, stream, index): the same bytes whoever looks, and however often."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

_MASK: Final = (1 << 64) - 1
_GOLDEN: Final = 0x9E3779B97F4A7C15
_UNIT: Final = 1.0 / (1 << 53)


def hash64(seed: int, stream: int, index: int) -> int:
    """Mix three integers to 64 bits (SplitMix64, Steele, Lea and Flood 2014)."""
    return _splitmix(_stream_state(seed, stream) ^ (index & _MASK))


@lru_cache(maxsize=64)
def _stream_state(seed: int, stream: int) -> int:
    """What all numbers of a stream begin with."""
    return _splitmix(_splitmix((seed * _GOLDEN) & _MASK) ^ (stream & _MASK))


def uniform(seed: int, stream: int, index: int) -> float:
    """Number in [0, 1)."""
    return (hash64(seed, stream, index) >> 11) * _UNIT


def gauss(seed: int, stream: int, index: int) -> float:
    """Standard normal number (Box and Muller 1958)."""
    first = hash64(seed, stream, 2 * index)
    second = hash64(seed, stream, 2 * index + 1)
    radius = math.sqrt(-2.0 * math.log(((first >> 11) + 1) * _UNIT))
    return radius * math.cos(2.0 * math.pi * (second >> 11) * _UNIT)


def noise_bytes(seed: int, stream: int, index: int, count: int) -> bytes:
    """`count` bytes of nonsense."""
    words = (hash64(seed, stream, (index << 16) + k) for k in range(-(-count // 8)))
    return b"".join(word.to_bytes(8, "big") for word in words)[:count]


def _splitmix(state: int) -> int:
    state = (state + _GOLDEN) & _MASK
    state = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    state = ((state ^ (state >> 27)) * 0x94D049BB133111EB) & _MASK
    return state ^ (state >> 31)
