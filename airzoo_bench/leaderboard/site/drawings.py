"""Small pictures in tables: rank ranges, intervals, the history of a score; all made of numbers."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

__all__ = ["Point", "Scale", "history_picture", "interval_picture", "rank_picture", "scale_of"]

_WIDTH, _HEIGHT, _EDGE = 80, 12, 4
_WIDER = 120  # of intervals, which are short beside their column's range
_STEP, _BOTTOM, _RISE = 76, 108, 92  # of a history: a version's width; where it stands


@dataclass(frozen=True)
class Scale:
    """What the left and the right edge of a column of pictures stand for."""

    low: float
    high: float

    def at(self, value: float, width: float = _WIDTH) -> float:
        """Return where a value stands, in pixels from the left, at an edge what is beyond."""
        size = self.high - self.low
        share = 0.5 if size <= 0 else (value - self.low) / size
        return _EDGE + min(max(share, 0.0), 1.0) * (width - 2 * _EDGE)


@dataclass(frozen=True)
class Point:
    """A value that a method had, and its interval where it has one."""

    value: float
    low: float | None
    high: float | None
    text: str = ""
    label: str = ""


def scale_of(values: Iterable[float | None]) -> Scale | None:
    """Return the scale that holds all finite values; None where there is none."""
    finite = [value for value in values if value is not None and math.isfinite(value)]
    return Scale(min(finite), max(finite)) if finite else None


def rank_picture(low: int, high: int, count: int) -> str:
    """Draw the ranks from `low` to `high` of `count` as a bar on the line of all ranks."""
    scale = Scale(1, max(count, 2))
    first, last = scale.at(low), scale.at(high)
    return _svg(
        _WIDTH,
        _HEIGHT,
        _line("axis", _EDGE, _WIDTH - _EDGE, 6) + _line("span", first - 2, last + 2, 6),
    )


def interval_picture(point: Point, scale: Scale) -> str:
    """Draw a value as a dot and its interval as a line on the scale of its column."""
    middle, drawn = _HEIGHT / 2, _line("axis", _EDGE, _WIDER - _EDGE, _HEIGHT / 2)
    if point.low is not None and point.high is not None:
        low, high = scale.at(point.low, _WIDER), scale.at(point.high, _WIDER)
        drawn += _line("whisker", low, high, middle)
    x = _px(scale.at(point.value, _WIDER))
    dot = f'<circle class="dot" cx="{x}" cy="{_px(middle)}" r="2.5"/>'
    return _svg(_WIDER, _HEIGHT, drawn + dot)


def history_picture(points: Sequence[Point]) -> str:
    """Draw values in the order they came, each a dot with its interval, joined by a line."""
    scale = scale_of(v for point in points for v in (point.value, point.low, point.high))
    if scale is None:
        return ""
    width, height = _STEP * len(points), 132
    finite = [(x, p) for x, p in enumerate(points) if math.isfinite(p.value)]

    def at(place: int, value: float) -> tuple[str, str]:
        down = _BOTTOM - (scale.at(value, _RISE) - _EDGE)
        return _px(_STEP * (place + 0.5)), _px(down)

    line = " ".join(",".join(at(place, point.value)) for place, point in finite)
    drawn = f'<polyline class="path" points="{line}"/>' if len(finite) > 1 else ""
    for place, point in finite:
        if point.low is not None and point.high is not None:
            (x, low), (_, high) = at(place, point.low), at(place, point.high)
            drawn += f'<line class="whisker" x1="{x}" x2="{x}" y1="{low}" y2="{high}"/>'
        x, y = at(place, point.value)
        drawn += f'<circle class="dot" cx="{x}" cy="{y}" r="3"/>'
    for place, point in enumerate(points):
        x = _px(_STEP * (place + 0.5))
        drawn += f'<text x="{x}" y="12" text-anchor="middle">{html.escape(point.text)}</text>'
        drawn += (
            f'<text x="{x}" y="{height - 4}" text-anchor="middle">{html.escape(point.label)}</text>'
        )
    return _svg(width, height, drawn)


def _svg(width: float, height: float, drawn: str) -> str:
    size = f'width="{_px(width)}" height="{_px(height)}" viewBox="0 0 {_px(width)} {_px(height)}"'
    return f'<svg {size} aria-hidden="true" focusable="false">{drawn}</svg>'


def _line(kind: str, first: float, last: float, y: float) -> str:
    ends = f'x1="{_px(first)}" x2="{_px(last)}" y1="{_px(y)}" y2="{_px(y)}"'
    return f'<line class="{kind}" {ends}/>'


def _px(value: float) -> str:
    """Write a length to a tenth of a pixel, the same on every machine."""
    return f"{value:.1f}".removesuffix(".0")
