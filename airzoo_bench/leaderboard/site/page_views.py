"""What the tables of pages show: rows and cells made of the board's JSON files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

from airzoo_bench.leaderboard.site.drawings import (
    Point,
    Scale,
    interval_picture,
    rank_picture,
    scale_of,
)
from airzoo_bench.leaderboard.site.strangers import plain_name, printed, safe_url, shown
from airzoo_bench.tables.model import show_number

__all__ = [
    "UNITS",
    "CellView",
    "ColumnView",
    "Note",
    "Notes",
    "RowView",
    "cell_view",
    "column_cells",
    "column_views",
    "number",
    "numbers_text",
    "pipeline_of",
    "rank_text",
    "row_view",
    "scale_of_scores",
]

UNITS = {"share": "%", "m": "m", "deg": "°"}
KINDS = {"reported": "reported, not re-scored", "sealed": "sealed", "floor": "no method"}
_DECIMALS, _MOST_TRAINING = 2, 4

Json = Mapping[str, Any]


@dataclass(frozen=True)
class Note:
    """A note below a page's tables; where a template prints it, the link to it."""

    number: int
    text: str

    def __html__(self) -> str:
        """Return the element of the link, by which Jinja knows what is not to be escaped."""
        label = f"†{self.number}, note: {printed(shown(self.text))}"
        return f'<a class="mark" href="#note-{self.number}" aria-label="{label}">†{self.number}</a>'


class Notes:
    """The notes of a page, numbered as they are first met; the same text is one note."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}

    def mark(self, text: str) -> Note:
        """Return the note of a text."""
        return Note(self._numbers.setdefault(text, len(self._numbers) + 1), text)

    def all(self) -> list[Note]:
        """Return all notes in the order of their numbers."""
        return [Note(number, text) for text, number in self._numbers.items()]


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
    """A number as it is shown, and what it is sorted by.

    Templates print it as an element: a macro of theirs takes ten times as long, and most of a board
    is cells.
    """

    text: str = ""
    sort: str = ""
    interval: str = ""
    lead: bool = False
    notes: Sequence[Note] = ()
    picture: str = ""

    def __html__(self) -> str:
        """Return the element of the cell, by which Jinja knows what is not to be escaped."""
        return self._element

    @cached_property
    def _element(self) -> str:
        kind = "num lead-score" if self.lead else "num"
        text = printed(self.text) or '<span class="nothing">–</span>'
        low = f'<span class="low">{printed(self.interval)}</span>' if self.interval else ""
        marks = "".join(note.__html__() for note in self.notes)
        start = f'<td class="{kind}" data-v="{printed(self.sort)}">'
        return f"{start}{text}{self.picture}{marks}{low}</td>"


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
    notes: Sequence[Note] = ()

    @property
    def facts(self) -> str:
        """The attributes that filters read, as they stand in its element."""
        found = {"id": self.id, "name": self.name, "source": self.kind}
        found |= {"pipeline": self.pipeline} if self.pipeline else {}
        found |= {"training": " ".join(self.training)} if self.training is not None else {}
        found |= {"code": "yes"} if self.code else {}
        found |= {"date": self.date} if self.date else {}
        return _attributes(tuple(found.items()))

    @property
    def head(self) -> str:
        """The element of its method."""
        marks = "".join(note.__html__() for note in self.notes)
        return _head(self.href, self.name, marks, self.team, self.tag)

    @property
    def training_text(self) -> str:
        """What the method says that it was trained on; all of it stands on its own page."""
        if self.training is None:
            return "not stated"
        more = len(self.training) - _MOST_TRAINING
        listed = [*self.training[:_MOST_TRAINING], *([f"and {more} more"] if more > 0 else [])]
        return ", ".join(listed) or "none"


@lru_cache(maxsize=4096)  # a row stands on many pages
def _attributes(found: tuple[tuple[str, str], ...]) -> str:
    return " ".join(f'data-{name}="{printed(value)}"' for name, value in found)


@lru_cache(maxsize=4096)
def _head(href: str, name: str, marks: str, team: str, tag: str) -> str:
    shown_name = f"<bdi>{printed(name)}</bdi>"
    linked = f'<a href="{printed(href)}">{shown_name}</a>' if href else shown_name
    who = f'<span class="who"><bdi>{printed(team)}</bdi></span>' if team else ""
    words = ',</span> <span class="num">'.join(map(printed, tag.split(", ")))
    tagged = f'<span class="who"><span class="num">{words}</span> </span>' if tag else ""
    return f'<th scope="row" class="t stick">{linked}{marks}{who}{tagged}</th>'


def number(value: Any) -> float | None:
    """Return a number of the API: infinite ones are texts there, and null is none."""
    return None if value is None else float(value)


def numbers_text(unit: str, *values: Any) -> list[str]:
    """Return numbers as tables show them: shares in percent; what is none is empty."""
    scale = 100.0 if unit == "share" else 1.0
    found = [number(value) for value in values]
    return ["" if v is None else show_number(scale * v, _DECIMALS) for v in found]


def column_cells(column: Json, part: Json, count: int) -> list[CellView]:
    """Return a score of a scene or a group as cells, one for each of `count` rows."""
    given = (list(part.get(key, ())) for key in ("value", "low", "high"))
    padded = (numbers + [None] * (count - len(numbers)) for numbers in given)
    return [_column_cell(column["unit"], *numbers) for numbers in zip(*padded, strict=True)]


def _column_cell(unit: str, value: Any, low: Any, high: Any) -> CellView:
    if value is None:
        return CellView()
    text, *limits = numbers_text(unit, value, low, high)
    return CellView(text, f"{number(value):.9g}", " to ".join(limits) if all(limits) else "")


def cell_view(score: Json | None, *, lead: bool = False, notes: Sequence[Note] = ()) -> CellView:
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
    notes: Sequence[Note] = (),
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
