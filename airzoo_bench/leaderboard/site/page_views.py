"""What the tables of pages show: rows and cells made of the board's JSON files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from airzoo_bench.leaderboard.site.drawings import (
    Point,
    Scale,
    interval_picture,
    rank_picture,
    scale_of,
)
from airzoo_bench.leaderboard.site.strangers import plain_name, safe_url, shown
from airzoo_bench.tables.model import show_number

__all__ = [
    "UNITS",
    "CellView",
    "ColumnView",
    "Notes",
    "RowView",
    "cell_view",
    "column_views",
    "number",
    "numbers_text",
    "pipeline_of",
    "rank_text",
    "row_view",
    "scale_of_scores",
    "score_at",
]

UNITS = {"share": "%", "m": "m", "deg": "°"}
KINDS = {"reported": "reported, not re-scored", "sealed": "sealed", "floor": "no method"}
_DECIMALS = 2

Json = Mapping[str, Any]


class Notes:
    """The notes of a page, numbered as they are first met; the same text is one note."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}

    def mark(self, text: str) -> dict[str, Any]:
        """Return a note's number and text."""
        number = self._numbers.setdefault(text, len(self._numbers) + 1)
        return {"number": number, "text": text}

    def all(self) -> list[dict[str, Any]]:
        """Return all notes in the order of their numbers."""
        return [{"number": number, "text": text} for text, number in self._numbers.items()]


@dataclass(frozen=True)
class ColumnView:
    """A column of numbers: how it is called, and which way it is first sorted."""

    title: str
    unit: str = ""
    first: str = "descending"
    sorted: str = ""
    href: str = ""


@dataclass(frozen=True)
class CellView:
    """A number as it is shown, and what it is sorted by."""

    text: str = ""
    sort: str = ""
    interval: str = ""
    lead: bool = False
    notes: Sequence[Json] = ()
    picture: str = ""


@dataclass(frozen=True)
class RowView:
    """A row: its method, its cells, and what filters ask."""

    id: str
    href: str
    name: str
    team: str
    kind: str
    tag: str
    cells: Sequence[CellView]
    rank: str = ""
    place: int = 0
    rank_picture: str = ""
    picture: str = ""
    pipeline: str = ""
    training: Sequence[str] | None = None
    date: str = ""
    code: str | None = None
    paper: str | None = None
    cost: CellView = CellView()
    hardware: str = ""
    comparable: bool = False
    notes: Sequence[Json] = ()

    @property
    def training_text(self) -> str:
        """What the method says that it was trained on."""
        if self.training is None:
            return "not stated"
        return ", ".join(self.training) or "none"


def number(value: Any) -> float | None:
    """Return a number of the API: infinite ones are texts there, and null is none."""
    return None if value is None else float(value)


def numbers_text(unit: str, *values: Any) -> list[str]:
    """Return numbers as tables show them: shares in percent; what is none is empty."""
    scale = 100.0 if unit == "share" else 1.0
    found = [number(value) for value in values]
    return ["" if v is None else show_number(scale * v, _DECIMALS) for v in found]


def score_at(column: Json, part: Json, row: int) -> dict[str, Any]:
    """Return a row's score of a scene or a group, in the shape of a row's own scores."""
    value, low, high = (
        part[key][row] if row < len(part.get(key, ())) else None for key in ("value", "low", "high")
    )
    text, *limits = numbers_text(column["unit"], value, low, high)
    interval = f"{limits[0]} to {limits[1]}" if all(limits) else ""
    return {"value": value, "text": text, "low": low, "high": high, "interval": interval}


def cell_view(score: Json | None, *, lead: bool = False, notes: Sequence[Json] = ()) -> CellView:
    """Return a score as a cell; none where the row has no such score."""
    if score is None or score["value"] is None:
        return CellView(notes=notes)
    sort = f"{number(score['value']):.9g}"
    return CellView(score["text"], sort, score["interval"], lead, notes)


def column_views(columns: Sequence[Json], lead: str = "") -> list[ColumnView]:
    """Return the columns of scores; the one whose key is `lead` is what rows stand by."""
    return [
        ColumnView(
            title=shown(column["title"]),
            unit=f"{UNITS[column['unit']]} {'↑' if column['higher_is_better'] else '↓'}",
            first=_best_first(column),
            sorted=_best_first(column) if column["key"] == lead else "",
        )
        for column in columns
    ]


def _best_first(column: Json) -> str:
    return "descending" if column["higher_is_better"] else "ascending"


def rank_text(rank: Sequence[int] | None) -> str:
    """Write a rank range, such as 2–4, or 1 where it is certain."""
    if rank is None:
        return ""
    low, high = rank
    return str(low) if low == high else f"{low}–{high}"


def pipeline_of(row: Json) -> str:
    """Return the class of a method's pipeline in words; empty where it is not stated."""
    if row["stages"] is None:
        return ""
    return ", ".join([shown(row["stages"]), *(f"uses {shown(what)}" for what in row["uses"])])


def row_view(
    row: Json,
    cells: Sequence[CellView],
    *,
    up: str = "",
    place: int = 0,
    ranks: Sequence[int] | None = None,
    count: int = 0,
    lead: Json | None = None,
    scale: Scale | None = None,
    comparable: bool = False,
    notes: Sequence[Json] = (),
) -> RowView:
    """Return a row with what all tables show of a method."""
    training = row["training_data"]
    return RowView(
        id=plain_name(row["id"]),
        href=f"{up}methods/{plain_name(row['id'])}.html",
        name=shown(row["method"]),
        team=shown(row["team"]) if row["team"] else "",
        kind=row["kind"],
        tag=KINDS.get(row["kind"], ""),
        cells=cells,
        rank=rank_text(ranks),
        place=place,
        rank_picture=rank_picture(ranks[0], ranks[1], count) if ranks else "",
        picture=_picture(lead, scale),
        pipeline=pipeline_of(row),
        training=None if training is None else [shown(name) for name in training],
        date=row["date"] or "",
        code=safe_url(row["code"]),
        paper=safe_url(row["paper"]),
        cost=_cost(row["seconds_per_query"]),
        hardware=shown(row["hardware"]) if row["hardware"] else "",
        comparable=comparable,
        notes=notes,
    )


def _cost(seconds: float | None) -> CellView:
    return CellView() if seconds is None else CellView(f"{seconds:.3g}", f"{seconds:.9g}")


def _picture(score: Json | None, scale: Scale | None) -> str:
    if score is None or scale is None:
        return ""
    value, low, high = (number(score[key]) for key in ("value", "low", "high"))
    if value is None or not math.isfinite(value):
        return ""
    return interval_picture(Point(value, low, high), scale)


def scale_of_scores(scores: Sequence[Json | None]) -> Scale | None:
    """Return the scale that holds all values and intervals of a column."""
    return scale_of(number(s[key]) for s in scores if s for key in ("value", "low", "high"))
