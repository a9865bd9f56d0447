"""The number of queries of each scene: as given, and as the printed shares imply."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass

from airzoo_bench.audit.findings import Conclusion
from airzoo_bench.audit.implied import Implied, implied_total
from airzoo_bench.core.errors import ResultError, UsageError, agreeing, counted, first_of
from airzoo_bench.core.validation import nearest
from airzoo_bench.tables.printed_numbers import possible_counts
from airzoo_bench.tables.printed_scores import Family
from airzoo_bench.tables.printed_values import PrintedValue, Published

__all__ = [
    "Key",
    "Queries",
    "RowKey",
    "is_average",
    "key_of",
    "parse_counts",
    "resolve_queries",
    "row_of",
]

Key = tuple[str, str, str]
RowKey = tuple[str, ...]

# So sure must a number of queries be that was not given.
_SURE = 0.99
_MOST_PLACES = 100
_CHECK = "counts"


@dataclass(frozen=True)
class Queries:
    """How many queries a scene has.

    Attributes
    ----------
    is_given : bool
        By the user or in the file; else it was concluded from the values.
    """

    number: int
    is_given: bool


def key_of(cell: PrintedValue) -> Key:
    """Return what has one number of queries: benchmark, track and scene."""
    return *cell.group, cell.scene


def row_of(cell: PrintedValue) -> RowKey:
    """Return what tells a row: table, benchmark, track, scene and method."""
    return cell.table, *key_of(cell), cell.method


def parse_counts(texts: Iterable[str]) -> dict[str, int]:
    """Read ``scene=n,...`` texts."""
    counts: dict[str, int] = {}
    for part in (part.strip() for text in texts for part in text.split(",")):
        match = re.fullmatch(r"(.*\S)\s*=\s*([0-9]{1,9})", part)
        if not match or not int(match[2]):
            raise UsageError(
                f"{part[:80]!r} is no scene and number of queries",
                where="--counts",
                expected="such as 'City=161,Rural=190', or 'AirZoo-Real/City=161' where several "
                "benchmarks have a scene of that name",
            )
        if match[1] in counts:
            raise UsageError(f"scene {match[1]!r} twice", where="--counts")
        counts[match[1]] = int(match[2])
    return counts


def resolve_queries(
    published: Published,
    counts: Mapping[str, int],
    variants: Mapping[Key, str],
    doubtful: AbstractSet[RowKey] = frozenset(),
) -> tuple[dict[Key, Queries], list[Conclusion]]:
    """Return the number of queries of each scene that has shares of queries, where it is known."""
    groups = published.by(key_of)
    _check_names(groups, counts)
    averaged = is_average(published)
    queries: dict[Key, Queries] = {}
    conclusions: list[Conclusion] = []
    for key, cells in groups.items():
        given = _given(cells, counts)
        sound = [c for c in cells if not averaged(c) and row_of(c) not in doubtful]
        implied = _implied(sound, variants)
        if given is not None:
            queries[key] = Queries(given, True)
        elif implied and implied.probability >= _SURE:
            queries[key] = Queries(implied.total, False)
        if implied:
            text = _implied_text(implied, given, _fits(cells, averaged, given))
            conclusions.append(Conclusion(_CHECK, ", ".join(filter(None, key)), text))
    return queries, conclusions


def _implied(cells: list[PrintedValue], variants: Mapping[Key, str]) -> Implied | None:
    hits = [(c.number, c.full, 1) for c in cells if c.score.family is Family.HITS]
    precisions = [
        (c.number, c.full, c.score.cutoff)
        for c in cells
        if variants.get((*c.group, c.score.name)) == "precision" and c.score.cutoff <= _MOST_PLACES
    ]
    # Average precision alone would take its definition on trust.
    return implied_total([*hits, *precisions]) if hits else None


def _fits(
    cells: list[PrintedValue], averaged: Callable[[PrintedValue], bool], given: int | None
) -> int:
    """Count the different shares of queries that are counts out of the number given."""
    hits = {
        (cell.number.value, cell.number.decimals): cell
        for cell in cells
        if cell.score.family is Family.HITS and not averaged(cell)
    }
    telling = [cell for cell in hits.values() if 0 < cell.number.value < cell.full]
    return sum(bool(given and possible_counts(c.number, given, c.full)) for c in telling)


def is_average(published: Published) -> Callable[[PrintedValue], bool]:
    """Return what tells averages over scenes from the only set there is."""
    with_scenes = {
        (cell.group, cell.score.name)
        for cell in published.cells
        if not cell.is_summary and cell.score.is_share
    }
    return lambda cell: cell.is_summary and (cell.group, cell.score.name) in with_scenes


def _check_names(groups: Iterable[Key], counts: Mapping[str, int]) -> None:
    known = {scene for _, _, scene in groups}
    known |= {f"{benchmark}/{scene}" for benchmark, _, scene in groups if benchmark}
    for name in counts:
        if name not in known:
            raise UsageError(
                f"no scene {name!r}{nearest(name, sorted(known))}",
                where="--counts",
                expected=first_of(sorted({scene for _, _, scene in groups}), shown=20),
            )


def _given(cells: list[PrintedValue], counts: Mapping[str, int]) -> int | None:
    first = cells[0]
    stated = {cell.queries: cell.line for cell in cells if cell.queries is not None}
    for name in (f"{first.group[0]}/{first.scene}", first.scene):
        # The name with its benchmark is the more exact one.
        if name in counts:
            stated[counts[name]] = 0
            break
    if len(stated) > 1:
        shown = ", ".join(
            f"{n} ({f'line {line}' if line else '--counts'})" for n, line in stated.items()
        )
        raise ResultError(
            f"different numbers of queries for {first.place}: {shown}",
            expected="one number a scene",
        )
    return next(iter(stated), None)


def _implied_text(implied: Implied, given: int | None, fits_given: int) -> str:
    values = f"{implied.fits} of {implied.values} different values"
    if implied.probability < _SURE:
        told = f"n is given as {given}" if given is not None else "n cannot be told"
        others = ", ".join(map(str, implied.as_good)) or "no other"
        return f"{told}; n = {implied.total} fits {values}, so do {others}"
    text = f"n = {implied.total} fits {values}"
    if implied.as_good:
        multiples = all(total % implied.total == 0 for total in implied.as_good)
        others = "its multiples" if multiples else ", ".join(map(str, implied.as_good))
        text += f", as do {others}"
    if given is None:
        return text
    if given == implied.total:
        return f"{text}; it is the n given"
    text += f"; the n given is {given}, which fits {fits_given}"
    if given > implied.total and fits_given < implied.fits:
        left = given - implied.total
        text += f": {agreeing(left, 'was', 'were')} {counted(left, 'query')} left out?"
    return text
