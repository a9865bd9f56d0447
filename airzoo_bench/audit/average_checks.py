"""Averages: over scenes or over queries, of exact or of rounded values, and which do not agree."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from airzoo_bench.audit.counts import counted_share
from airzoo_bench.audit.findings import Conclusion, Finding, Grade
from airzoo_bench.audit.published import Printed, Published, grouped
from airzoo_bench.audit.queries import Key, Queries, key_of
from airzoo_bench.audit.rounding import Interval, Rounded, decimal_text, mean_interval
from airzoo_bench.audit.scores import Family

__all__ = ["check_averages"]

_CHECK = "average"


@dataclass(frozen=True)
class _Averaged:
    """A printed average with the scenes' values it should be made of.

    Attributes
    ----------
    over_scenes : Interval
        Where the unweighted mean of the exact values lies.
    over_queries : Interval or None
        Where the mean over all queries lies; None where queries are not known, or it is no share.
    of_rounded : Fraction
        The unweighted mean of the values as printed.
    """

    cell: Printed
    scenes: tuple[Printed, ...]
    over_scenes: Interval
    over_queries: Interval | None
    of_rounded: Fraction

    def fits(self, mean: Interval | None) -> bool:
        return mean is not None and self.cell.number.interval.meets(mean)

    @property
    def fits_rounded(self) -> bool:
        return abs(self.cell.number.value - self.of_rounded) <= self.cell.number.half


def check_averages(
    published: Published, queries: Mapping[Key, Queries], variants: Mapping[Key, str]
) -> tuple[list[Finding], list[Conclusion]]:
    """Tell over what a table averages, and find the averages that the scenes do not give.

    Parameters
    ----------
    published : Published
    queries : mapping
        From `resolve_queries`.
    variants : mapping
        Which average precision it is: whole numbers of positives narrow the values.
    """
    scenes = _scenes(published)

    def exact(cell: Printed) -> Interval:
        return _exact(cell, queries, variants)

    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    summaries = [cell for cell in published.cells if cell.is_summary]
    same = grouped(summaries, _identity)
    for place, cells in grouped(summaries, lambda c: (c.table, *c.group, c.scene)).items():
        made = [_averaged(cell, scenes, queries, exact) for cell in cells]
        known = [average for average in made if average is not None]
        if not known:
            continue
        by_queries = _by_queries(known)
        conclusions.append(Conclusion(_CHECK, ", ".join(filter(None, place)), _conclusion(known)))
        judged = (
            _judge(average, same[_identity(average.cell)], by_queries=by_queries)
            for average in known
        )
        findings.extend(finding for finding in judged if finding)
    return findings, conclusions


def _scenes(published: Published) -> dict[tuple[str, ...], dict[str, dict[str, Printed]]]:
    """Return the scenes' cells: by benchmark, track and score, then scene, then method."""
    scenes: dict[tuple[str, ...], dict[str, dict[str, Printed]]] = {}
    for cell in published.cells:
        if not cell.is_summary:
            by_scene = scenes.setdefault((*cell.group, cell.score.name), {})
            # Of a cell that is printed twice the first counts; another check compares them.
            by_scene.setdefault(cell.scene, {}).setdefault(cell.method, cell)
    return scenes


def _averaged(
    cell: Printed,
    scenes: Mapping[tuple[str, ...], Mapping[str, Mapping[str, Printed]]],
    queries: Mapping[Key, Queries],
    exact: Callable[[Printed], Interval],
) -> _Averaged | None:
    by_scene = scenes.get((*cell.group, cell.score.name), {})
    parts = [by_method[cell.method] for by_method in by_scene.values() if cell.method in by_method]
    if len(parts) < 2 or len(parts) < len(by_scene):
        return None
    values = [exact(part) for part in parts]
    counts = [queries[key_of(part)].number for part in parts if key_of(part) in queries]
    weigh = cell.score.is_share and len(counts) == len(parts)
    return _Averaged(
        cell,
        tuple(parts),
        mean_interval(values),
        mean_interval(values, counts) if weigh else None,
        sum((part.number.value for part in parts), Fraction(0)) / len(parts),
    )


def _exact(cell: Printed, queries: Mapping[Key, Queries], variants: Mapping[Key, str]) -> Interval:
    """Return where the true value lies: at a count, where it is one and counts are known."""
    known = queries.get(key_of(cell))
    if known is not None and cell.score.family is Family.HITS:
        return counted_share(cell.number, known.number, cell.full)
    variant = variants.get((*cell.group, cell.score.name))
    if known is not None and variant == "precision":
        return counted_share(cell.number, known.number * cell.score.cutoff, cell.full)
    return cell.number.interval


def _by_queries(known: Sequence[_Averaged]) -> bool:
    over_scenes = sum(average.fits(average.over_scenes) for average in known)
    return sum(average.fits(average.over_queries) for average in known) > over_scenes


def _conclusion(known: Sequence[_Averaged]) -> str:
    exact = sum(average.fits(average.over_scenes) for average in known)
    rounded = sum(
        average.fits_rounded and not average.fits(average.over_scenes) for average in known
    )
    weighed = [average for average in known if average.over_queries is not None]
    pooled = sum(average.fits(average.over_queries) for average in weighed)
    text = f"of {len(known)} averages, {exact} are unweighted means over scenes"
    if rounded:
        text += f", {rounded} more are so of the rounded values only"
    if weighed:
        text += f"; {pooled} of {len(weighed)} are means over all queries"
    return text + _example(weighed)


def _example(weighed: Sequence[_Averaged]) -> str:
    """Show the average that tells the two ways apart most."""
    fitting = [average for average in weighed if average.fits(average.over_scenes)]
    if not fitting:
        return ""

    def ways(average: _Averaged) -> tuple[Interval, Interval]:
        return average.over_scenes, average.over_queries or average.over_scenes

    most = max(fitting, key=lambda average: abs(ways(average)[0].low - ways(average)[1].low))
    scenes, pooled = (_shown(way, most.cell.number) for way in ways(most))
    name = f"{most.cell.method}, {most.cell.score.name}"
    printed = most.cell.number.text
    return f" ({name}: {scenes} over scenes, {pooled} over queries, printed {printed})"


def _judge(average: _Averaged, same: Sequence[Printed], *, by_queries: bool) -> Finding | None:
    cell, number = average.cell, average.cell.number
    pooled = average.over_queries if by_queries else None
    mean = average.over_scenes if pooled is None else pooled
    if number.interval.meets(mean):
        return None
    weighed = "over " if pooled is None else "over all queries of "
    shown = _shown(mean, number)
    why = f"the mean {weighed}{len(average.scenes)} scenes is {shown}, printed {number.text}"
    why += "".join(f", in {c.table} {c.number.text}" for c in _elsewhere(cell, same))
    if pooled is None and average.fits_rounded:
        rounded = decimal_text(average.of_rounded, number.decimals + 2)
        why += f"; the values as printed have the mean {rounded}: rounded twice"
        return Finding(Grade.ROUNDING, _CHECK, cell, why)
    off = max(mean.low - number.value, number.value - mean.high)
    if off <= 3 * number.half:
        return Finding(Grade.ROUNDING, _CHECK, cell, why + ": off by the last digit")
    return Finding(Grade.INCONSISTENT, _CHECK, cell, why)


def _identity(cell: Printed) -> tuple[object, ...]:
    return cell.group, cell.method, cell.score.name


def _elsewhere(cell: Printed, same: Sequence[Printed]) -> list[Printed]:
    """Return the same average where another table prints it differently."""
    value = cell.number.value
    return [other for other in same if other.table != cell.table and other.number.value != value]


def _shown(mean: Interval, number: Rounded) -> str:
    """Write a mean with two digits more than printed, or as far as it is known."""
    low, high = (decimal_text(end, number.decimals + 2) for end in (mean.low, mean.high))
    return low if low == high else f"{low} to {high}"
