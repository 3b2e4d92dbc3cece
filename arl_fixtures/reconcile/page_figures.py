"""Pictures of the diagnosis page as inline SVG: drawn by hand so that names from outside are only ever text.

Sizes are in the units of a view box about as wide as a phone's column, so that text keeps its size there and on a
desktop. Numbers are written with fixed digits: the same data give the same bytes.
"""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.page_data import NULL_Z, Axis, Profile

WIDTH = 360.0
LEFT, RIGHT, TOP, BOTTOM = 46.0, 16.0, 8.0, 34.0
HEIGHT = 210.0
BEFORE, AFTER, BAND = "#d55e00", "#0072b2", "#d9d9d9"
"""Okabe-Ito vermillion and blue: told apart with any colour vision, and by dashes and marks in black and white."""
_COLD, _MIDDLE, _WARM, _NO_ROWS = (33, 84, 148), (250, 250, 250), (178, 45, 20), (205, 205, 205)


@dataclass(frozen=True, slots=True)
class Scale:
    """Data to view box, linear or logarithmic."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, value: float) -> float:
        """Position of a value."""
        low, high = (np.log(self.low), np.log(self.high)) if self.log else (self.low, self.high)
        x = np.log(max(value, 1e-300)) if self.log else value
        return float(self.start + (x - low) / (high - low) * (self.end - self.start))


def ticks(low: float, high: float, *, most: int = 6, log: bool = False) -> list[float]:
    """Round values within a range: steps of 1, 2 or 5; on a logarithmic axis decades, with 2 and 5 where few."""
    if log:
        found: list[float] = []
        for factors in ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0)):
            decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
            found = [f * 10.0**k for k in decades for f in factors if low <= f * 10.0**k <= high]
            if len(found) >= 3:
                break
        return found if len(found) <= most + 2 else found[:: int(np.ceil(len(found) / most))]
    raw = (high - low) / max(most - 1, 1)
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(f * power for f in (1.0, 2.0, 5.0, 10.0) if f * power >= raw * 0.999)
    first = int(np.ceil(low / step - 1e-9))
    return [k * step for k in range(first, int(np.floor(high / step + 1e-9)) + 1)]


def number(value: float) -> str:
    """A tick's label: three digits, with a true minus sign, powers of ten only where they are needed."""
    if abs(value) <= 1e-12:
        return "0"
    text = f"{value:.0f}" if 999.5 <= abs(value) < 1e5 else f"{value:.3g}"
    return text.replace("e+0", "e").replace("-", "−")


def shortened(text: str, most: int) -> str:
    """Text cut in its middle to at most so many characters."""
    text = " ".join(text.split())
    return text if len(text) <= most else f"{text[: most - most // 2 - 1]}…{text[-(most // 2) :]}"


def _text(x: float, y: float, text: str, *, anchor: str = "middle", most: int = 60) -> Markup:
    whole = Markup("<title>{}</title>").format(text) if len(text) > most else Markup()
    return Markup('<text x="{:.1f}" y="{:.1f}" text-anchor="{}">{}{}</text>').format(
        x, y, anchor, shortened(text, most), whole
    )


def _line(points: Sequence[tuple[float, float]], style: str) -> Markup:
    return Markup('<polyline class="{}" points="{}"/>').format(style, " ".join(f"{x:.1f},{y:.1f}" for x, y in points))


def _frame(label: str, body: Sequence[Markup], *, height: float = HEIGHT, wide: float = WIDTH) -> Markup:
    return Markup('<svg viewBox="0 0 {:.0f} {:.0f}" role="img" aria-label="{}">{}</svg>').format(
        wide, height, label, Markup("").join(body)
    )


def _y_axis(y: Scale) -> list[Markup]:
    made: list[Markup] = []
    for value in ticks(y.low, y.high, most=7):
        made.append(_line([(LEFT, y(value)), (WIDTH - RIGHT, y(value))], "zero" if value == 0 else "grid"))
        made.append(_text(LEFT - 5, y(value) + 3.5, number(value), anchor="end"))
    return made


def _y_scale(profile: Profile, factor: float) -> Scale:
    """Range of the means; the null band widens it by no more than their own size."""
    values = np.concatenate([profile.before, profile.after]) * factor
    values = values[np.isfinite(values)]
    band = NULL_Z * profile.error[np.isfinite(profile.error)] * factor
    reach = float(np.abs(values).max()) if len(values) else 0.0
    room = min(float(np.median(band)) * 1.3 if len(band) else 0.0, max(3.0 * reach, 1e-12))
    low, high = min(float(values.min(initial=0.0)), -room), max(float(values.max(initial=0.0)), room)
    pad = 0.06 * max(high - low, 1e-12)
    return Scale(low - pad, high + pad, HEIGHT - BOTTOM, TOP)


def curve(axis: Axis, profile: Profile, *, factor: float, label: str) -> Markup:
    """Mean mismatch over a numeric column, before and after, on its null band.

    Args:
        axis: numeric bins.
        profile: of these bins.
        factor: shown unit over the profile's.
        label: column with its unit.
    """
    good = np.flatnonzero(np.isfinite(profile.before) & np.isfinite(profile.after))
    at = axis.at[good]
    if len(at) == 0:
        return Markup("")
    log = axis.log
    span = float(at.max() - at.min()) or max(abs(float(at[0])), 1.0)
    low, high = (at.min() / 1.1, at.max() * 1.1) if log else (at.min() - 0.03 * span, at.max() + 0.03 * span)
    x = Scale(float(low), float(high), LEFT, WIDTH - RIGHT, log)
    y = _y_scale(profile, factor)
    band = np.clip(NULL_Z * profile.error[good] * factor, 0.0, 1e12)
    edge = [(x(a), max(y(b), TOP)) for a, b in zip(at, band, strict=True)]
    edge += [(x(a), min(y(-b), HEIGHT - BOTTOM)) for a, b in zip(at[::-1], band[::-1], strict=True)]
    body = [Markup('<polygon class="band" points="{}"/>').format(" ".join(f"{a:.1f},{b:.1f}" for a, b in edge))]
    body += _y_axis(y)
    for value in ticks(x.low, x.high, log=log):
        body.append(_line([(x(value), HEIGHT - BOTTOM), (x(value), HEIGHT - BOTTOM + 4)], "tick"))
        body.append(_text(x(value), HEIGHT - BOTTOM + 14, number(value)))
    for values, style in _lines(profile):
        points = [(x(a), y(b)) for a, b in zip(at, values[good] * factor, strict=True)]
        if style == "before" and len(at) <= 40:
            body += [
                _line([(px, min(y(b - e), HEIGHT - BOTTOM)), (px, max(y(b + e), TOP))], "error")
                for (px, _), b, e in zip(points, values[good] * factor, profile.error[good] * factor, strict=True)
                if y(b - e) - y(b + e) < HEIGHT
            ]
        body.append(_line(points, style))
        body += [_mark(px, py, style) for px, py in points] if len(at) <= 70 else []
    body.append(_text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 5, label, most=52))
    return _frame(label, body)


def _lines(profile: Profile) -> list[tuple[FloatArray, str]]:
    """What to draw: one line only where the findings change nothing."""
    if np.array_equal(profile.before, profile.after, equal_nan=True):
        return [(profile.before, "before")]
    return [(profile.before, "before"), (profile.after, "after")]


def _mark(x: float, y: float, style: str) -> Markup:
    if style == "before":
        return _box(x - 2.2, y - 2.2, 4.4, 4.4, "before mark")
    return Markup('<circle class="after mark" cx="{:.1f}" cy="{:.1f}" r="2.2"/>').format(x, y)


def categories(axis: Axis, profile: Profile, *, factor: float, label: str) -> Markup:
    """Mean mismatch of each category: one line each, its null band behind it."""
    order = np.argsort(-np.abs(np.nan_to_num(profile.before)), kind="stable")[:12]
    order = np.sort(order)
    height = TOP + 20.0 * len(order) + BOTTOM
    y = _y_scale(profile, factor)
    left = 118.0
    x = Scale(y.low, y.high, left, WIDTH - RIGHT)
    body: list[Markup] = []
    for value in ticks(x.low, x.high, most=5):
        body.append(_line([(x(value), TOP), (x(value), height - BOTTOM)], "zero" if value == 0 else "grid"))
        body.append(_text(x(value), height - BOTTOM + 14, number(value)))
    for place, k in enumerate(order):
        middle = TOP + 20.0 * place + 10.0
        band = NULL_Z * float(profile.error[k]) * factor
        if np.isfinite(band):
            start, end = max(x(-band), left), min(x(band), WIDTH - RIGHT)
            body.append(_box(start, middle - 7, end - start, 14.0, "band"))
        for values, style in _lines(profile):
            if np.isfinite(values[k]):
                body.append(_mark(x(float(values[k]) * factor), middle, style))
        body.append(_text(left - 6, middle + 3.5, axis.names[k], anchor="end", most=18))
    body.append(_text((left + WIDTH - RIGHT) / 2, height - 5, label, most=40))
    return _frame(label, body, height=height)


def bars(before: float, after: float, floor: float) -> Markup:
    """Mean square mismatch before and after, and the floor that repeated frames leave."""
    height, left = 92.0, 62.0
    x = Scale(0.0, max(before, after, floor, 1e-9) * 1.22, left, WIDTH - RIGHT)
    body: list[Markup] = []
    for place, (name, value, style) in enumerate(
        (("before", before, "before"), ("after", after, "after"), ("floor", floor, "floor"))
    ):
        top = 6.0 + 28.0 * place
        body.append(_box(left, top, max(x(value) - left, 1.0), 20.0, f"{style} bar"))
        body.append(_text(left - 6, top + 14, name, anchor="end"))
        body.append(_text(x(value) + 5, top + 14, number(value), anchor="start"))
    return _frame("mean square mismatch on held-out blocks", body, height=height)


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """A map of mismatch in standard errors.

    Attributes:
        z: mean mismatch over its standard error, shape (rows, columns), row 0 on top, NaN where no row lies.
        across, down: what the axes are.
        left, right, top, bottom: values at the edges; ignored where names are given.
        at_across, at_down: labels of some columns and rows of cells, instead of a linear axis.
        u, v: places of single cells that do not fill the map (`z` is then one row of them); else empty.
    """

    z: FloatArray
    across: str
    down: str
    left: float = 0.0
    right: float = 1.0
    top: float = 0.0
    bottom: float = 1.0
    at_across: tuple[str, ...] = ()
    at_down: tuple[str, ...] = ()
    u: FloatArray = field(default_factory=lambda: np.zeros(0))
    v: FloatArray = field(default_factory=lambda: np.zeros(0))


def heat_map(shown: Field, limit: float) -> Markup:
    """A field in colour: white within the null band, blue where the measurement is lower, red where it is higher."""
    rows, columns = shown.z.shape
    left = LEFT if not shown.at_down else float(np.clip(6.0 * max(map(len, shown.at_down)) + 10.0, LEFT, 110.0))
    wide = WIDTH - left - RIGHT
    aspect = 0.62 if shown.at_across else (shown.bottom - shown.top) / (shown.right - shown.left)
    high = float(np.clip(wide * aspect, 60.0, 300.0))
    height = TOP + high + BOTTOM + 13.0
    body = [_points(shown, limit, wide, high)] if len(shown.u) else [_image(shown.z, limit, left, TOP, wide, high)]
    body.append(_box(left, TOP, wide, high, "edge"))
    across: list[tuple[float, str]] = []
    down: list[tuple[float, str]] = []
    if shown.at_across:
        across = [(left + wide * (k + 0.5) / columns, shown.at_across[k]) for k in _some(len(shown.at_across), 6)]
        down = [(TOP + high * (k + 0.5) / rows, shown.at_down[k]) for k in _some(len(shown.at_down), 7)]
    else:
        x, y = Scale(shown.left, shown.right, left, left + wide), Scale(shown.top, shown.bottom, TOP, TOP + high)
        across = [(x(t), number(t)) for t in ticks(shown.left, shown.right)]
        down = [(y(t), number(t)) for t in ticks(shown.top, shown.bottom, most=4 if high < 120 else 6)]
    body += [_text(place, TOP + high + 14, text, most=9) for place, text in across]
    body += [_text(left - 4, place + 3.5, text, anchor="end", most=17) for place, text in down]
    body.append(_text(WIDTH / 2, height - 18, f"across: {shown.across}", most=58))
    body.append(_text(WIDTH / 2, height - 5, f"down: {shown.down}", most=58))
    return _frame(f"map over {shown.across} and {shown.down}", body, height=height)


def _box(x: float, y: float, wide: float, high: float, style: str) -> Markup:
    return Markup('<rect class="{}" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>').format(
        style, x, y, wide, high
    )


def _image(z: FloatArray, limit: float, x: float, y: float, wide: float, high: float) -> Markup:
    return Markup(
        '<image x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}" preserveAspectRatio="none" '
        'style="image-rendering:pixelated" href="data:image/png;base64,{}"/>'
    ).format(x, y, wide, high, _png(colours(z, limit)))


def _points(shown: Field, limit: float, wide: float, high: float) -> Markup:
    """Single pixels as squares at their places, those beyond the null band on top."""
    x = Scale(shown.left, shown.right, LEFT, LEFT + wide)
    y = Scale(shown.top, shown.bottom, TOP, TOP + high)
    size = float(np.clip(np.sqrt(0.35 * wide * high / len(shown.u)), 2.5, 8.0))
    z = shown.z[0]
    shades = colours(shown.z, limit)[0]
    return Markup("").join(
        Markup('<rect class="cell" x="{:.1f}" y="{:.1f}" width="{s}" height="{s}" fill="#{}"/>').format(
            x(float(shown.u[k])) - size / 2, y(float(shown.v[k])) - size / 2, bytes(shades[k]).hex(), s=f"{size:.1f}"
        )
        for k in np.argsort(np.nan_to_num(np.abs(z)), kind="stable")
    )


def _some(count: int, most: int) -> list[int]:
    step = max(int(np.ceil(count / most)), 1)
    return list(range(0, count, step))


def colour_bar(limit: float) -> Markup:
    """Legend of the maps."""
    wide, high = 300.0, 12.0
    strip = np.linspace(-limit, limit, 121)[None, :]
    x = Scale(-limit, limit, 30.0, 30.0 + wide)
    body = [_image(strip, limit, 30.0, 4.0, wide, high), _box(30.0, 4.0, wide, high, "edge")]
    marks = [-limit, -limit / 2, 0.0, limit / 2, limit]
    body += [_text(x(t), 30, number(round(t, 1))) for t in marks]
    return _frame("colour scale in standard errors", body, height=34)


def colours(z: FloatArray, limit: float) -> NDArray[np.uint8]:
    """Colours of values in standard errors, shape (rows, columns, 3): a square-root ramp beyond the null band."""
    size = np.clip((np.abs(np.nan_to_num(z)) - NULL_Z) / max(limit - NULL_Z, 1e-9), 0.0, 1.0)
    ramp = np.sqrt(size)[..., None]
    end = np.where((np.nan_to_num(z) > 0)[..., None], np.array(_WARM), np.array(_COLD))
    mixed = np.array(_MIDDLE) + ramp * (end - np.array(_MIDDLE))
    mixed = np.where(np.isfinite(z)[..., None], mixed, np.array(_NO_ROWS))
    return np.asarray(np.round(mixed), dtype=np.uint8)


def _png(image: NDArray[np.uint8]) -> str:
    """A colour image as PNG in base64 (ISO/IEC 15948: signature, header, one data chunk, end)."""
    rows, columns, _ = image.shape
    raw = b"".join(b"\0" + image[k].tobytes() for k in range(rows))

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    file = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(raw, 9)) + chunk(b"IEND", b"")
    return base64.b64encode(file).decode("ascii")
