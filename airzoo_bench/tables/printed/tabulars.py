"""Where the tables of a LaTeX source stand, and the labels of the floats around them."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field

from airzoo_bench.tables.printed.latex_source import OPTION, group_end

__all__ = ["TABULARS", "Tabular", "behind_arguments", "has_tabulars", "tabulars_of"]

TABULARS = (
    r"tabular[*xy]?|xltabular|longtable|longtabu|tabu|supertabular|NiceTabular\*?|tblr|longtblr"
    r"|array"
)
_BEGIN = re.compile(rf"\\begin\{{(?:{TABULARS})\}}")
_FLOATS = (
    r"table\*?|wraptable|sidewaystable\*?|subtable|subfigure|figure\*?|minipage|threeparttable"
    r"|longtable|document"
)
_EDGE = re.compile(rf"\\(?:(begin|end)\{{(?:({TABULARS})|({_FLOATS}))\}}|label\{{([^{{}}]*)\}})")
_NAMED = (None, "subtable", "subfigure")
_OPTION = re.compile(OPTION)


@dataclass(frozen=True)
class Tabular:
    """Where the rows of one table begin and end in the text, and its label (empty without)."""

    start: int
    end: int
    label: str


@dataclass
class _Float:
    """What surrounds tables and gives them labels."""

    labels: list[str] = field(default_factory=list)
    places: list[tuple[int, int]] = field(default_factory=list)


def has_tabulars(text: str) -> bool:
    """Whether a text holds the environment of a table."""
    return bool(_BEGIN.search(text))


def tabulars_of(text: str) -> list[Tabular]:
    """Find the outermost tables of a source; all of it, where there is no environment.

    A table is called by the label of the float around it, with its number there where several
    share one.
    """
    if not has_tabulars(text):
        return [Tabular(0, len(text), "")]
    named = sorted(pair for found in _floats(text) for pair in _named(found))
    seen = Counter(label for _, label in named)
    return [
        # Labels that stand in a source twice name nothing.
        Tabular(behind_arguments(text, start, end), end, label if seen[label] == 1 else "")
        for (start, end), label in named
    ]


def _floats(text: str) -> list[_Float]:
    """Walk once through a source; the first of what it returns is no float."""
    walk = _Walk()
    for edge in _EDGE.finditer(text):
        begins = edge[1] == "begin"
        if edge[4] is not None:
            walk.inside[-1].labels.append(edge[4])
        elif begins:
            walk.begin(edge)
        else:
            walk.end(edge)
    walk.close(len(text))
    walk.floats[0].labels.clear()
    return walk.floats


class _Walk:
    """Which floats are open, and how deep a place is in tables."""

    def __init__(self) -> None:
        self.floats = [_Float()]
        self.inside = [self.floats[0]]
        self.depth = self.start = 0

    def begin(self, edge: re.Match[str]) -> None:
        """Open a float, a table, or both, as a longtable is."""
        if _is_float(edge):
            self.floats.append(_Float())
            self.inside.append(self.floats[-1])
        if edge[2]:
            self.start = edge.start() if self.depth == 0 else self.start
            self.depth += 1

    def end(self, edge: re.Match[str]) -> None:
        """Close what was opened last."""
        if edge[2] and self.depth:
            self.depth -= 1
            if self.depth == 0:
                self.inside[-1].places.append((self.start, edge.start()))
        if _is_float(edge):
            self.close(edge.start())
            closed = self.inside.pop() if len(self.inside) > 1 else self.inside[0]
            if edge[3] not in _NAMED:
                _hand_up(closed, self.inside[-1])

    def close(self, at: int) -> None:
        """End a table that never ends where the float around it does."""
        if self.depth:
            self.inside[-1].places.append((self.start, at))
            self.depth = 0


def _is_float(edge: re.Match[str]) -> bool:
    return bool(edge[3]) or edge[2] == "longtable"


def _hand_up(closed: _Float, around: _Float) -> None:
    """Leave to what surrounds a box, such as a minipage, the tables that it has no label for."""
    if closed is not around and not closed.labels:
        around.places += closed.places
        closed.places = []


def _named(found: _Float) -> list[tuple[tuple[int, int], str]]:
    places, labels = sorted(found.places), found.labels
    if len(labels) == len(places):
        return list(zip(places, labels, strict=True))
    if labels and len(places) == 1:
        return [(places[0], labels[0])]
    if not labels:
        return [(place, "") for place in places]
    return [(place, f"{labels[0]} ({number})") for number, place in enumerate(places, 1)]


def behind_arguments(text: str, start: int, end: int) -> int:
    """Return the place behind the column types of the table between two places."""
    found = _BEGIN.match(text, start)
    if found is None:  # pragma: no cover - a place is where such a match begins
        return start
    at = found.end()
    name = found[0][len(r"\begin{") : -1]
    for _ in range(2 if name[-1] in "*xy" or name == "xltabular" else 1):
        option = _OPTION.match(text, at, end)
        at = group_end(text, option.end() if option else at, end)
    return at
