"""Small pictures made of numbers: ranks, intervals, a score over versions and over time."""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup, escape

__all__ = ["Point", "Scale", "history", "interval", "rank_bar", "timeline"]

_RANK_WIDTH, _INTERVAL_WIDTH, _HEIGHT, _EDGE = 64, 112, 12, 4
_STEP, _TALL = 84, 120  # of a history: the width of a version, the height
_WIDE, _LOW, _LEFT = 720, 190, 46  # of a timeline


@dataclass(frozen=True)
class Scale:
    """The meaning of an axis's ends."""

    low: float
    high: float

    @classmethod
    def of(cls, values: Iterable[Any]) -> Scale | None:
        """Return the scale that holds all finite values; None where there are no two."""
        finite = [float(value) for value in values if value is not None]
        finite = [value for value in finite if math.isfinite(value)]
        return cls(min(finite), max(finite)) if finite and min(finite) < max(finite) else None

    def at(self, value: float, first: float, last: float) -> float:
        """Return a value's place between two places, clipped at the ends."""
        share = (value - self.low) / (self.high - self.low)
        return first + min(max(share, 0.0), 1.0) * (last - first)


@dataclass(frozen=True)
class Point:
    """A finite value and its interval."""

    value: float
    low: float | None
    high: float | None

    @classmethod
    def of(cls, score: Mapping[str, Any]) -> Point | None:
        """Take the point of a score of board.json."""
        value = score.get("value")
        if value is None or not math.isfinite(float(value)):
            return None
        limits = (score.get(name) for name in ("low", "high"))
        return cls(float(value), *(None if one is None else float(one) for one in limits))


def rank_bar(ranks: Sequence[int], count: int) -> Markup:
    """Draw a rank range as a bar on the line of all ranks."""
    scale, last = Scale(1, max(count, 2)), _RANK_WIDTH - _EDGE
    first, end = (scale.at(rank, _EDGE, last) for rank in ranks)
    axis = _line("rule", _EDGE, last, 6)
    return _svg(_RANK_WIDTH, _HEIGHT, axis + _line("span", first - 2, end + 2, 6))


def interval(point: Point, scale: Scale) -> Markup:
    """Draw a value as a dot and its interval as a line, on the scale of a column."""
    last, drawn = _INTERVAL_WIDTH - _EDGE, _line("rule", _EDGE, _INTERVAL_WIDTH - _EDGE, 6)
    if point.low is not None and point.high is not None:
        low, high = (scale.at(value, _EDGE, last) for value in (point.low, point.high))
        drawn += _line("whisker", low, high, 6)
    x = scale.at(point.value, _EDGE, last)
    return _svg(
        _INTERVAL_WIDTH, _HEIGHT, drawn + f'<circle class="dot" cx="{_px(x)}" cy="6" r="3"/>'
    )


def history(points: Sequence[tuple[str, float]], write: Callable[[float], str]) -> Markup:
    """Draw the values of versions from left to right, joined by a line."""
    scale = Scale.of(value for _, value in points) or Scale(0, 1)
    places = [
        (_STEP * (n + 0.5), scale.at(value, _TALL - 34, 28))
        for n, (_, value) in enumerate(points)
        if math.isfinite(value)
    ]
    line = " ".join(f"{_px(x)},{_px(y)}" for x, y in places)
    drawn = f'<polyline class="path" points="{line}"/>'
    drawn += "".join(f'<circle class="dot" cx="{_px(x)}" cy="{_px(y)}" r="3"/>' for x, y in places)
    for n, (label, value) in enumerate(points):
        x = _STEP * (n + 0.5)
        drawn += _words(x, 14, write(value), "middle") + _words(x, _TALL - 6, label, "middle")
    return _svg(_STEP * len(points), _TALL, drawn)


def timeline(
    entries: Sequence[tuple[str, float, str]],
    *,
    higher_is_better: bool,
    write: Callable[[float], str],
) -> Markup:
    """Draw three or more scores by their dates, which ascend, and the best so far."""
    known = [one for one in entries if math.isfinite(one[1])]
    days = [datetime.date.fromisoformat(date).toordinal() for date, _, _ in known]
    across = Scale.of(days)
    up = Scale.of(value for _, value, _ in known)
    if len(known) < 3 or across is None or up is None:
        return Markup("")
    bottom, right = _LOW - 26, _WIDE - 12
    drawn, best = "", math.nan
    steps: list[tuple[float, float]] = []
    for value in (up.low, up.high):
        y = up.at(value, bottom, 14)
        drawn += _line("rule", _LEFT, right, y) + _words(_LEFT - 6, y + 4, write(value), "end")
    for day, (date, value, name) in zip(days, known, strict=True):
        x, y = across.at(day, _LEFT + 8, right - 8), up.at(value, bottom, 14)
        if not steps or (value > best if higher_is_better else value < best):
            steps += [(x, steps[-1][1] if steps else y), (x, y)]
            best = value
        title = f"<title>{escape(name)}, {write(value)}, {date}</title>"
        drawn += f'<circle class="dot" cx="{_px(x)}" cy="{_px(y)}" r="3.5">{title}</circle>'
    steps.append((right, steps[-1][1]))
    line = " ".join(f"{_px(x)},{_px(y)}" for x, y in steps)
    drawn = f'<polyline class="path" points="{line}"/>' + drawn
    drawn += _words(_LEFT, _LOW - 6, known[0][0], "start") + _words(
        right, _LOW - 6, known[-1][0], "end"
    )
    return _svg(_WIDE, _LOW, drawn)


def _svg(width: float, height: float, drawn: str) -> Markup:
    size = f'width="{_px(width)}" height="{_px(height)}" viewBox="0 0 {_px(width)} {_px(height)}"'
    return Markup(f'<svg {size} aria-hidden="true" focusable="false">{drawn}</svg>')


def _line(kind: str, first: float, last: float, y: float) -> str:
    ends = f'x1="{_px(first)}" x2="{_px(last)}" y1="{_px(y)}" y2="{_px(y)}"'
    return f'<line class="{kind}" {ends}/>'


def _words(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{_px(x)}" y="{_px(y)}" text-anchor="{anchor}">{escape(text)}</text>'


def _px(value: float) -> str:
    """Write a length to a tenth of a pixel, the same on every machine."""
    return f"{value:.1f}".removesuffix(".0")
