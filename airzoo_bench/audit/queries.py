"""The number of queries of each scene: as given, and as the printed shares imply."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from airzoo_bench.audit.counts import Implied, count_text, implied_total, is_cut
from airzoo_bench.audit.counts import possible_counts as counts_of
from airzoo_bench.audit.findings import Conclusion, Finding, Grade
from airzoo_bench.audit.published import Printed, Published
from airzoo_bench.audit.scores import Family
from airzoo_bench.errors import ResultError, UsageError, first_of
from airzoo_bench.validation import nearest

__all__ = ["Key", "Queries", "check_counts", "key_of", "parse_counts", "resolve_queries"]

Key = tuple[str, str, str]

# So sure must a number of queries be that was not given.
_SURE = 0.99
_MOST_PLACES = 100
_CHECK = "counts"


@dataclass(frozen=True)
class Queries:
    """How many queries a scene has.

    Attributes
    ----------
    number : int
    is_given : bool
        By the user or in the file; else it was concluded from the values.
    """

    number: int
    is_given: bool


def key_of(cell: Printed) -> Key:
    """Return what has one number of queries: benchmark, track and scene."""
    return cell.benchmark, cell.track, cell.scene


def parse_counts(texts: Iterable[str]) -> dict[str, int]:
    """Read ``scene=n,...`` texts.

    Raises
    ------
    UsageError
        A text is no such thing, or names a scene twice.
    """
    counts: dict[str, int] = {}
    for part in (part.strip() for text in texts for part in text.split(",")):
        match = re.fullmatch(r"(.*\S)\s*=\s*([0-9]{1,9})", part)
        if not match or not int(match[2]):
            raise UsageError(
                f"{part[:80]!r} is no scene and number of queries",
                where="--counts",
                expected="such as 'City=161,Rural=190'",
            )
        if match[1] in counts:
            raise UsageError(f"scene {match[1]!r} twice", where="--counts")
        counts[match[1]] = int(match[2])
    return counts


def resolve_queries(
    published: Published, counts: Mapping[str, int], variants: Mapping[Key, str]
) -> tuple[dict[Key, Queries], list[Conclusion]]:
    """Return the number of queries of each scene that has shares of queries, where it is known.

    Parameters
    ----------
    published : Published
    counts : mapping of str to int
        By scene, or by ``benchmark/scene`` where scenes of several benchmarks share a name.
    variants : mapping
        Which average precision each benchmark, track and score is, where that is known: mean
        precision is a whole number of positives, which tells of the number of queries too.

    Raises
    ------
    UsageError
        A scene of `counts` does not occur.
    ResultError
        The file says different numbers for one scene.
    """
    groups = published.by(key_of)
    _check_names(groups, counts)
    averaged = _averaged(published)
    queries: dict[Key, Queries] = {}
    conclusions: list[Conclusion] = []
    for key, cells in groups.items():
        given = _given(cells, counts)
        implied = _implied([cell for cell in cells if not averaged(cell)], variants)
        if given is not None:
            queries[key] = Queries(given, True)
        elif implied and implied.probability >= _SURE:
            queries[key] = Queries(implied.total, False)
        if implied:
            conclusions.append(Conclusion(_CHECK, _place(key), _implied_text(implied, given)))
    return queries, conclusions


def _implied(cells: list[Printed], variants: Mapping[Key, str]) -> Implied | None:
    hits = [(c.number, c.full, 1) for c in cells if c.score.family is Family.HITS]
    precisions = [
        (c.number, c.full, c.score.cutoff)
        for c in cells
        if variants.get((*c.group, c.score.name)) == "precision" and c.score.cutoff <= _MOST_PLACES
    ]
    # Average precision alone would take its definition on trust.
    return implied_total([*hits, *precisions]) if hits else None


def _averaged(published: Published) -> _Averaged:
    return _Averaged(
        {
            (cell.group, cell.score.name)
            for cell in published.cells
            if not cell.is_summary and cell.score.is_share
        }
    )


@dataclass(frozen=True)
class _Averaged:
    """Tells averages over scenes, which are no shares of queries, from the only set there is."""

    with_scenes: set[tuple[tuple[str, str], str]]

    def __call__(self, cell: Printed) -> bool:
        return cell.is_summary and (cell.group, cell.score.name) in self.with_scenes


def _check_names(groups: Iterable[Key], counts: Mapping[str, int]) -> None:
    known = {name for benchmark, _, scene in groups for name in (scene, f"{benchmark}/{scene}")}
    for name in counts:
        if name not in known:
            raise UsageError(
                f"no scene {name!r}{nearest(name, sorted(known))}",
                where="--counts",
                expected=first_of(sorted({scene for _, _, scene in groups}), shown=20),
            )


def _given(cells: list[Printed], counts: Mapping[str, int]) -> int | None:
    first = cells[0]
    stated = {cell.queries: cell.line for cell in cells if cell.queries is not None}
    for name in (f"{first.benchmark}/{first.scene}", first.scene):
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


def _place(key: Key) -> str:
    return ", ".join(part for part in key if part)


def _implied_text(implied: Implied, given: int | None) -> str:
    values = f"{implied.fits} of {implied.values} different values"
    if implied.probability < _SURE:
        told = f"n is given as {given}" if given is not None else "n cannot be told"
        others = ", ".join(map(str, implied.as_good)) or "no other"
        return f"{told}; {implied.total} fits {values}, so do {others}"
    text = f"n = {implied.total} fits {values}"
    if implied.as_good:
        multiples = all(total % implied.total == 0 for total in implied.as_good)
        others = ", ".join(map(str, implied.as_good))
        text += ", as do multiples" if multiples else f", as do {others}"
    if given is None:
        return text
    if given == implied.total:
        return f"{text}; it is the n given"
    return f"{text}; the n given is {given}"


def check_counts(published: Published, queries: Mapping[Key, Queries]) -> list[Finding]:
    """Find shares of queries that are no whole number of queries."""
    averaged = _averaged(published)
    findings = []
    for cell in published.cells:
        known = queries.get(key_of(cell))
        if known is None or cell.score.family is not Family.HITS or averaged(cell):
            continue
        if not counts_of(cell.number, known.number, cell.full):
            findings.append(_no_count(cell, known))
    return findings


def _no_count(cell: Printed, known: Queries) -> Finding:
    near = count_text(cell.number, known.number, cell.full)
    unit = " %" if cell.full == 100 else ""
    origin = "" if known.is_given else ", which the other values imply"
    why = f"{cell.number.text}{unit} of {known.number} queries{origin}: {near}"
    if is_cut(cell.number, known.number, cell.full):
        why += " (cut off, not rounded)"
    grade = Grade.IMPOSSIBLE if known.is_given else Grade.INCONSISTENT
    return Finding(grade, _CHECK, cell, why)
