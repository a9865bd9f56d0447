"""Averages: over scenes or over queries, of exact or of rounded values, and which do not agree."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction

from airzoo_bench.audit.averages import Averaged, example_text, has_common_weights, shown_mean
from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.audit.queries import Key, Queries, key_of
from airzoo_bench.core.plurals import agreeing, counted
from airzoo_bench.tables.printed.cells import PrintedValue, Published, grouped
from airzoo_bench.tables.printed.numbers import Interval, counted_share, decimal_text, mean_interval
from airzoo_bench.tables.printed.scores import Family

__all__ = ["check_averages"]

_CHECK = "average"
# Averages of a paper's table, before it can be told that they are over other scenes.
_FEWEST = 4
_WHAT = "averages against the scenes they are of"
Scenes = Mapping[tuple[str, ...], Mapping[str, Mapping[str, PrintedValue]]]


def check_averages(
    published: Published, queries: Mapping[Key, Queries], variants: Mapping[Key, str]
) -> Outcome:
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

    def exact(cell: PrintedValue) -> Interval:
        return _exact(cell, queries, variants)

    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    summaries = [cell for cell in published.cells if cell.is_summary]
    same = grouped(summaries, _identity)
    compared: list[PrintedValue] = []
    tested = loose = 0
    for place, cells in grouped(summaries, lambda c: (c.table, *c.group, c.scene)).items():
        made = [_averaged(cell, scenes, queries, exact) for cell in cells]
        known = [average for average in made if average is not None]
        if not known or _are_of_others(known):
            continue
        conclusions.append(Conclusion(_CHECK, ", ".join(filter(None, place)), _conclusion(known)))
        pooled = False
        for kind in _kinds(known):
            # What one kind shows to be averaged over queries, no other need be over scenes.
            pooled = _is_pooled(kind) or (pooled and not kind[0].is_weighed)
            free = len(kind) if pooled and not kind[0].is_weighed else 0
            tested, loose = tested + len(kind) - free, loose + free
            compared += [cell for a in kind for cell in (a.cell, *a.scenes)]
            judged = (_judge(a, same[_identity(a.cell)], pooled=pooled) for a in kind)
            findings.extend(finding for finding in judged if finding)
    left = _left(len(summaries), tested, loose)
    return Outcome(
        _CHECK, tested, _WHAT, left, tuple(findings), tuple(conclusions), tuple(compared)
    )


def _left(summaries: int, tested: int, loose: int) -> str:
    if not summaries:
        return "nothing is printed for several scenes"
    parts = [
        f"{number} {why}"
        for number, why in (
            (
                loose,
                "may be over all queries, whose numbers are not known (--counts), so that only "
                "lying between the scenes' values was checked",
            ),
            (summaries - tested - loose, "whose scenes are not all, or not at all, in the file"),
        )
        if number
    ]
    return "; ".join(parts)


def _scenes(published: Published) -> Scenes:
    """Return the scenes' cells: by benchmark, track and score, then scene, then method."""
    scenes: dict[tuple[str, ...], dict[str, dict[str, PrintedValue]]] = {}
    for cell in published.cells:
        if not cell.is_summary:
            by_scene = scenes.setdefault((*cell.group, cell.measure), {})
            # Of a cell that is printed twice the first counts; another check compares them.
            by_scene.setdefault(cell.scene, {}).setdefault(cell.method, cell)
    return scenes


def _averaged(
    cell: PrintedValue,
    scenes: Scenes,
    queries: Mapping[Key, Queries],
    exact: Callable[[PrintedValue], Interval],
) -> Averaged | None:
    by_scene = scenes.get((*cell.group, cell.measure), {})
    parts = [by_method[cell.method] for by_method in by_scene.values() if cell.method in by_method]
    if len(parts) < 2 or len(parts) < len(by_scene) or any(part.partial for part in parts):
        return None
    values = [exact(part) for part in parts]
    counts = [queries[key_of(part)].number for part in parts if key_of(part) in queries]
    is_of_queries = cell.score.family in (Family.HITS, Family.AVERAGE_PRECISION)
    is_weighed = is_of_queries and len(counts) == len(parts)
    # Whatever the weights, a mean or a median of all lies between those of the parts.
    between = Interval(min(v.low for v in values), max(v.high for v in values))
    return Averaged(
        cell,
        tuple(parts),
        mean_interval(values),
        mean_interval(values, counts) if is_weighed else between,
        sum((part.number.value for part in parts), Fraction(0)) / len(parts),
        is_weighed,
    )


def _exact(
    cell: PrintedValue, queries: Mapping[Key, Queries], variants: Mapping[Key, str]
) -> Interval:
    """Return where the true value lies: at a count, where it is one and counts are known."""
    known = queries.get(key_of(cell))
    if known is not None and cell.score.family is Family.HITS:
        return counted_share(cell.number, known.number, cell.full)
    variant = variants.get((*cell.group, cell.measure))
    if known is not None and variant == "precision":
        return counted_share(cell.number, known.number * cell.score.cutoff, cell.full)
    return cell.number.interval


def _are_of_others(known: Sequence[Averaged]) -> bool:
    """Whether a paper's averages are over more scenes than it prints: hardly one is theirs."""
    fitting = sum(a.fits_scenes or a.fits_rounded or a.fits_queries for a in known)
    return bool(known[0].cell.domain) and len(known) >= _FEWEST and 4 * fitting < len(known)


def _is_pooled(known: Sequence[Averaged]) -> bool:
    """Whether averages of one place and kind are rather over all queries than over scenes.

    Where that cannot be computed, they are so unless most are means over scenes and no weights of
    the scenes explain all of them.
    """
    if known[0].cell.is_pooled:
        return True
    over_scenes = sum(average.fits_scenes for average in known)
    if known[0].is_weighed:
        return sum(average.fits_queries for average in known) > over_scenes
    if known[0].is_median:
        # A median of all queries is no mean of medians by any weights.
        return 3 * over_scenes < 2 * len(known)
    return 2 * over_scenes <= len(known) or (over_scenes < len(known) and has_common_weights(known))


def _kinds(known: Sequence[Averaged]) -> list[list[Averaged]]:
    """Group averages that are judged together: by what is known of their weights, medians last."""
    kinds: dict[tuple[bool, bool], list[Averaged]] = {}
    for average in sorted(known, key=lambda a: (not a.is_weighed, a.is_median)):
        kinds.setdefault((average.is_weighed, average.is_median), []).append(average)
    return list(kinds.values())


def _conclusion(known: Sequence[Averaged]) -> str:
    exact = sum(average.fits_scenes for average in known)
    rounded = sum(average.fits_rounded and not average.fits_scenes for average in known)
    weighed = [average for average in known if average.is_weighed]
    medians = [average for average in known if average.is_median]
    are = agreeing(exact, "is an unweighted mean", "are unweighted means")
    text = f"of {counted(len(known), 'average')}, {exact} {are} over scenes"
    if medians:
        fitting = sum(average.fits_scenes for average in medians)
        text += f" (of {counted(len(medians), 'median')} {fitting})"
    if rounded:
        text += f", {rounded} more {agreeing(rounded, 'is', 'are')} so of the rounded values only"
    if weighed:
        pooled = sum(average.fits_queries for average in weighed)
        are = agreeing(pooled, "is a mean", "are means")
        text += f"; {pooled} of {len(weighed)} {are} over all queries"
    return text + example_text(weighed)


def _judge(average: Averaged, same: Sequence[PrintedValue], *, pooled: bool) -> Finding | None:
    cell, number = average.cell, average.cell.number
    mean = average.over_queries if pooled else average.over_scenes
    if number.interval.meets(mean):
        return None
    shown, rounded = shown_mean(mean, number), decimal_text(mean.low, number.decimals)
    of = counted(len(average.scenes), "scene")
    if pooled and not average.is_weighed:
        why = f"no average of {of} whose values lie between {shown.replace(' to ', ' and ')}"
    else:
        kind = f"mean over all queries of {of}" if pooled else f"mean of {of}"
        why = f"the {kind} is {shown}, which rounds to {rounded}"
    why += f"; printed here is {number.text}"
    why += "".join(f", in {c.table} {c.number.text}" for c in _elsewhere(cell, same))
    if not pooled and average.fits_rounded:
        twice = decimal_text(average.of_rounded, number.decimals + 2)
        why += f"; the scenes' values as printed have the mean {twice}, so it was rounded twice"
        return Finding(Grade.ROUNDING, _CHECK, cell, why)
    if number.interval.widened(2 * number.half).meets(mean):
        return Finding(Grade.ROUNDING, _CHECK, cell, why + ": off by the last digit")
    return Finding(Grade.INCONSISTENT, _CHECK, cell, why)


def _identity(cell: PrintedValue) -> tuple[object, ...]:
    return cell.group, cell.method, cell.measure


def _elsewhere(cell: PrintedValue, same: Sequence[PrintedValue]) -> list[PrintedValue]:
    """Return the same average where another table prints it differently."""
    value = cell.number.value
    return [other for other in same if other.table != cell.table and other.number.value != value]
