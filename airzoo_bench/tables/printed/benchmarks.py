"""Which tables of a file are of one benchmark: those whose numbers show it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

from airzoo_bench.tables.printed.cells import PrintedValue, grouped
from airzoo_bench.tables.printed.numbers import mean_interval
from airzoo_bench.tables.printed.scores import Family

__all__ = ["with_benchmarks"]

Key = tuple[str, str, str]

_OVERALL = "overall"
# So many different numbers must agree, and so large a part of those that both tables print: of
# unlike tables hardly one does, since two decimals agree by chance in one of thousands.
_FEWEST = 3
_PART = Fraction(1, 4)
_ROTATION = re.compile(r"rot|angular|orient|deg|°")


@dataclass
class _Domain:
    """Tables that are of one benchmark; the first gives them its name."""

    name: str
    scenes: frozenset[str]
    numbers: dict[Key, list[PrintedValue]] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    kinds: dict[tuple[str, str], str] = field(default_factory=dict)
    by_method: dict[tuple[str, str], list[PrintedValue]] = field(default_factory=dict)


def with_benchmarks(
    cells: Sequence[PrintedValue], *, is_markup: bool
) -> tuple[tuple[PrintedValue, ...], list[str]]:
    """Say of each number which others are of its benchmark, where the file does not.

    Tables whose scenes differ are of different ones. Of others, tables of LaTeX and Markdown are of
    one where enough of what both print agrees, number for number, or as averages over scenes that
    one prints. So no average is compared with scenes that it is not of.

    Parameters
    ----------
    cells : sequence of PrintedValue
        Of all tables of a file.
    is_markup : bool
        LaTeX or Markdown. What somebody typed into one CSV is of one benchmark, as long as its
        tables do not differ in their scenes.

    Returns
    -------
    cells : tuple of PrintedValue
        With their domains, and with names of methods and scores as the first table has them.
    notes : list of str
        Which tables were taken together.
    """
    tables = grouped(cells, lambda cell: cell.table)
    if len(tables) < 2 or any(cell.benchmark for cell in cells if not cell.may_average):
        return tuple(cells), []
    if not is_markup and len(set(map(_scenes, tables.values())) - {frozenset()}) < 2:
        return tuple(cells), []
    named, notes = _methods(cells) if is_markup else (list(cells), [])
    tables = grouped(named, lambda cell: cell.table)
    # Those with scenes first, so that averages in other tables find theirs.
    domains: list[_Domain] = []
    found: dict[str, _Domain] = {}
    for table in sorted(tables, key=lambda table: not _scenes(tables[table])):
        found[table] = _joined(table, tables[table], domains)
    notes += _told(found)
    return tuple(_with_domain(cell, found[cell.table]) for cell in named), notes


def _scenes(cells: Iterable[PrintedValue]) -> frozenset[str]:
    return frozenset(cell.scene for cell in cells if not cell.is_summary)


def _methods(cells: Sequence[PrintedValue]) -> tuple[list[PrintedValue], list[str]]:
    """Write one name in one way: ``A(Ours)`` as ``A (Ours)``, where the first is so."""
    first: dict[str, str] = {}
    other: dict[str, None] = {}
    made = []
    for cell in cells:
        name = first.setdefault("".join(cell.method.split()).casefold(), cell.method)
        if name != cell.method:
            other[f"{cell.method!r} as {name!r}"] = None
        made.append(replace(cell, method=name))
    shown = ", ".join(list(other)[:5]) + (" ..." if len(other) > 5 else "")
    return made, [f"names read as one: {shown}"] if other else []


def _loose(cell: PrintedValue) -> str:
    """Return what a score is, whatever a table calls it; its name, where that is not known."""
    score = cell.score
    if score.family is Family.HITS:
        stem = "" if not re.search("pose|translation|rotation", score.stem) else score.stem
        return f"{stem}@{score.thresholds}"
    if score.family is Family.MEDIAN:
        return "median rotation" if _ROTATION.search(score.name.casefold()) else "median"
    if score.family in (Family.OTHER, Family.ERROR, Family.CURVE):
        return score.name.casefold()
    return f"{score.family} {score.thresholds} {score.cutoff}"


def _loose_names(cells: Iterable[PrintedValue]) -> dict[str, str]:
    """Return a table's names of scores by what these are; its own name where two are alike."""
    names: dict[str, set[str]] = {}
    for cell in cells:
        names.setdefault(_loose(cell), set()).add(cell.score.name)
    alone = {loose: own for loose, own in names.items() if len(own) == 1}
    both = {f"named {name}": {name} for own in names.values() if len(own) > 1 for name in own}
    return {name: loose for loose, own in {**alone, **both}.items() for name in own}


def _keyed(cells: Iterable[PrintedValue], names: Mapping[str, str]) -> dict[Key, PrintedValue]:
    return {
        (c.method, names[c.score.name], _OVERALL if c.is_summary else c.scene): c for c in cells
    }


def _joined(table: str, cells: Sequence[PrintedValue], domains: list[_Domain]) -> _Domain:
    """Return the domain that a table's numbers agree with best, or a new one."""
    scenes, names = _scenes(cells), _loose_names(cells)
    own = _keyed(cells, names)
    merits = [
        (_agreement(own, domain), -index)
        for index, domain in enumerate(domains)
        if not scenes or scenes == domain.scenes
    ]
    best, index = max(merits, default=(0, 0))
    if not best:
        domain = _Domain(table, scenes)
        domains.append(domain)
    else:
        domain = domains[-index]
    for key, cell in own.items():
        domain.numbers.setdefault(key, []).append(cell)
        if key[2] != _OVERALL:
            domain.by_method.setdefault(key[:2], []).append(cell)
    for name, loose in names.items():
        domain.names.setdefault(loose, name)
        domain.kinds[table, name] = loose
    return domain


def _agreement(own: Mapping[Key, PrintedValue], domain: _Domain) -> int:
    """Return how many different numbers agree, 0 where these are too few."""
    common = agreeing = 0
    values: set[Fraction] = set()
    for key, cell in own.items():
        agrees = _agrees(key, cell, domain)
        common += agrees is not None
        agreeing += bool(agrees)
        if agrees and cell.number.decimals and cell.number.value:
            values.add(cell.number.value)
    return len(values) if len(values) >= _FEWEST and agreeing >= _PART * common else 0


def _agrees(key: Key, cell: PrintedValue, domain: _Domain) -> bool | None:
    """Whether a number is one of the domain's, or the mean of its scenes'; None if in neither."""
    printed = domain.numbers.get(key, [])
    if any(other.number.value == cell.number.value for other in printed):
        return True
    parts = domain.by_method.get(key[:2], []) if key[2] == _OVERALL else []
    if len(parts) < 2 or len({part.scene for part in parts}) < len(domain.scenes):
        return False if printed else None
    return cell.number.interval.meets(mean_interval(part.number.interval for part in parts))


def _told(found: Mapping[str, _Domain]) -> list[str]:
    together = grouped(found, lambda table: found[table].name)
    several = [sorted(tables) for tables in together.values() if len(tables) > 1]
    return [f"tables of one benchmark, by their numbers: {', '.join(t[:10])}" for t in several]


def _with_domain(cell: PrintedValue, domain: _Domain) -> PrintedValue:
    first = domain.names[domain.kinds[cell.table, cell.score.name]]
    return replace(cell, domain=domain.name, known_as=first if first != cell.score.name else "")
