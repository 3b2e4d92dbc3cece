"""Candidates for a law: bits of a converter that are off, everywhere or under a condition."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

from arl_fixtures.reconcile.converter_bits import weights_of
from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_basis import (
    KNOTS,
    PRICE_ONE,
    PRICE_PRODUCT,
    PRICE_TWO,
    PRICE_ZERO,
    Basis,
    curve_axis,
    curves_of,
    price_of,
)
from arl_fixtures.reconcile.law_candidates import shared_price, varied
from arl_fixtures.reconcile.law_work import Candidate, Work
from arl_fixtures.reconcile.pilot import Looker

MOST_BITS = 3
"""Pairs of a converter's bits that may be off under a condition."""


def of_bits(work: Work, looker: Looker, signal: Axis | None) -> Iterator[Basis]:
    """Errors of a converter's bits, of one and of two, as many codes to bright and dark."""
    channel = work.data.channel.name
    if f"sim_{channel}" not in work.features:
        return
    weights, scatter = weights_of(looker.problem.view, channel)
    amount = (signal,) if signal else ()
    bits = [
        (Axis(column=f"sim_{channel}", kind="bit", at=float(weight), edges=scatter), *amount) for weight in weights
    ]
    yield from (Basis(axes=axes, price=PRICE_ONE + 1.0) for axes in bits)
    yield from (Basis(waves=two, price=PRICE_TWO + 2.0) for two in itertools.combinations(bits, 2))


def likely_bits(bits: Sequence[Candidate]) -> list[Candidate]:
    """Bits to look for under a condition: all single ones, which elsewhere may be right, and the likeliest pairs."""
    pairs = sorted((m for m in bits if m.basis.waves), key=lambda m: -m.gain)
    return [*(m for m in bits if not m.basis.waves), *pairs[:MOST_BITS]]


def where_bits(
    work: Work, bits: Sequence[Candidate], names: Sequence[str], simple: dict[str, list[Candidate]]
) -> Iterator[Basis]:
    """Errors of bits that come with a temperature or a supply, or in a part of the image: one of many converters."""
    for basis in (item.basis for item in bits):
        for name in (n for n in names if n not in basis.columns):
            price = basis.price + price_of((name,)) + PRICE_PRODUCT + shared_price(work, (name,))
            for where in (item.basis.axes[0] for item in varied(simple.get(name, []))):
                waves = tuple((*product, where) for product in basis.waves)
                axes = basis.axes if waves else (*basis.axes, where)
                yield replace(basis, axes=axes, waves=waves, price=price)
                if not waves and basis.axes[1:]:  # a bad contact reads high or low, whatever the code has there
                    yield replace(basis, axes=(), waves=(axes, axes[1:]), price=price + PRICE_ZERO)
            curve = curve_axis(name, work.features[name], KNOTS)
            if curve and not basis.waves:
                for of_curve in curves_of(curve, price + 1.0):
                    yield replace(of_curve, axes=(*of_curve.axes, *basis.axes))
