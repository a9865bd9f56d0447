"""All checks of published tables in one call; checks of rows, columns, repeated numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from fractions import Fraction
from itertools import combinations, permutations

from airzoo_bench.audit.counts import (
    check_counts,
    check_precision,
    decimal_text,
    define_precision,
    resolve_queries,
)
from airzoo_bench.audit.findings import Audit, Finding, Grade, Outcome
from airzoo_bench.audit.sums import check_averages, check_gains
from airzoo_bench.core.errors import counted, first_of
from airzoo_bench.tables.printed import Family, Score, Span
from airzoo_bench.tables.published import PrintedValue, Published, grouped

__all__ = ["audit"]

Cells = Sequence[PrintedValue]

_LOWER = (Family.ACCURACY, Family.COMPLETENESS, Family.CHAMFER, Family.MEDIAN, Family.ERROR)
# What is within a distance is within a larger one.
_GROWING = (Family.HITS, Family.PRECISION, Family.RECALL, Family.F1, Family.CURVE)
_LENGTHS = ("mm", "cm", "m", "km")
_FEWEST_SCORES = 3  # a whole row of fewer says nothing: two scores may agree by chance
_MOST_NAMES = 10
_ZERO = Fraction(0)


def audit(
    published: Published, counts: Mapping[str, int] | None = None, variant: str | None = None
) -> Audit:
    """Check published tables by arithmetic, with the queries of scenes and the AP that is meant."""
    published = replace(published, cells=_settled(published.cells))
    within_rows = [check(published) for check in (_check_ranges, _check_order, _check_f1)]
    doubtful = {
        finding.cell.row
        for outcome in within_rows
        for finding in outcome.findings
        if finding.grade is Grade.IMPOSSIBLE
    }
    # Recalls alone tell whether AP@K is mean precision, so that nothing is proved by itself; that
    # then tells more of the numbers of queries.
    by_recalls, _ = resolve_queries(published, counts or {}, (), doubtful)
    precise = define_precision(published, by_recalls, variant, doubtful)
    queries, conclusions = resolve_queries(published, counts or {}, precise, doubtful)
    counted_shares = check_counts(published, queries)
    averages = check_averages(published, queries, precise)
    off = {id(finding.cell) for finding in averages.findings}
    ranges, order, f1 = within_rows
    outcomes = (
        ranges,
        replace(counted_shares, conclusions=(*conclusions, *counted_shares.conclusions)),
        check_precision(published, queries, precise, variant),
        order,
        f1,
        averages,
        _check_agreement(published, off),
        _check_misplaced_rows(published, off),
        check_gains(published),
        _check_bold(published),
    )
    unknown = dict.fromkeys(
        cell.score.name
        for cell in published.cells
        if cell.score.family is Family.OTHER and cell.score.higher_is_better is None
    )
    note = "scores that are not known, checked only for averages, gains and agreement: "
    notes = (note + first_of(unknown),) if unknown else ()
    findings = [finding for outcome in outcomes for finding in outcome.findings]
    common = tuple(_overview(published, findings))
    return Audit(published.source, len(published.cells), outcomes, notes, common)


def _settled(cells: Cells) -> tuple[PrintedValue, ...]:
    """Settle by the whole file whether recalls are of clouds, and accuracy a distance."""
    of_clouds = {
        (cell.table, *cell.group, cell.score.thresholds)
        for cell in cells
        if cell.score.family in (Family.F1, Family.PRECISION) and cell.score.thresholds
    }
    settled = []
    for cell in cells:
        score, cloud = cell.score, _of_cloud(cell.score)
        if cloud and (cell.table, *cell.group, cloud.thresholds) in of_clouds:
            score = cloud
        elif score.family in (Family.ACCURACY, Family.COMPLETENESS) and cell.unit not in _LENGTHS:
            # In percent more is better; without a unit it may be anything.
            better = True if cell.unit.casefold() in ("%", "percent") else None
            score = replace(score, family=Family.OTHER, higher_is_better=better)
        settled.append(replace(cell, score=score))
    return tuple(settled)


def _of_cloud(score: Score) -> Score | None:
    """Return recall or precision at K as a point cloud's within K; None for other scores."""
    if score.family is Family.AVERAGE_PRECISION and score.variant == "precision":
        return Score(score.name, Family.PRECISION, ((Fraction(score.cutoff), ""),))
    if score.family is Family.HITS:
        return Score(score.name, Family.RECALL, score.thresholds)
    return None


def _check_ranges(published: Published) -> Outcome:
    """Find shares outside 0 to 100 % and distances below zero."""
    known = [c for c in published.cells if c.score.is_share or c.score.family in _LOWER]
    findings = []
    for cell in known:
        number, family = cell.number, cell.score.family
        if cell.score.is_share and not 0 <= number.value <= cell.full:
            why = f"{number.text} lies outside 0 to {cell.full}, so it is no share of anything"
            findings.append(Finding(Grade.IMPOSSIBLE, "range", cell, why))
        elif not cell.score.is_share and number.value < 0:
            why = f"{number.text} is below 0, and no {family.value} is"
            findings.append(Finding(Grade.IMPOSSIBLE, "range", cell, why))
    what = "values, whether shares lie within 0 to 100 % and distances are not negative"
    unknown = len(published.cells) - len(known)
    left = f"{counted(unknown, 'value')} of scores that are not known" if unknown else ""
    return Outcome("range", len(known), what, left, tuple(findings))


def _pairs(published: Published) -> Iterator[tuple[PrintedValue, PrintedValue]]:
    """Yield all pairs of each row, either way round."""
    for row in published.by(lambda cell: cell.row).values():
        yield from permutations(row, 2)


def _of_pairs(
    check: str,
    what: str,
    none: str,
    pairs: Sequence[tuple[PrintedValue, PrintedValue]],
    findings: Iterable[Finding | None],
) -> Outcome:
    cells = tuple(cell for pair in pairs for cell in pair)
    found = tuple(filter(None, findings))
    return Outcome(check, len(pairs), what, "" if pairs else none, found, cells=cells)


def _check_order(published: Published) -> Outcome:
    """Find recalls at a smaller threshold that exceed those at a larger one."""
    pairs = [pair for pair in _pairs(published) if _at_most(*(cell.score for cell in pair))]
    what = "pairs such as R@1 and R@5 of one row, whether the stricter one is not larger"
    none = "no row has one kind of recall at two thresholds"
    return _of_pairs("order", what, none, pairs, (_disordered(*pair) for pair in pairs))


def _at_most(first: Score, second: Score) -> bool:
    """Whether all that counts for the first score counts for the second, by their thresholds."""
    if (first.family, first.stem) != (second.family, second.stem) or first.family not in _GROWING:
        return False
    one, two = first.thresholds, second.thresholds
    if one == two or [unit for _, unit in one] != [unit for _, unit in two]:
        return False
    return all(small <= large for (small, _), (large, _) in zip(one, two, strict=True))


def _disordered(first: PrintedValue, second: PrintedValue) -> Finding | None:
    if first.number.decimals == second.number.decimals and first.full == second.full:
        # Rounding alike never turns an order round.
        exceeds = first.number.value > second.number.value
    else:
        exceeds = first.share.low > second.share.high
    small, large = first.score.name, second.score.name
    why = (
        f"{small} = {first.number.text} > {large} = {second.number.text}, but whatever counts for "
        f"{small} counts for {large} too, so {large} cannot be smaller"
    )
    return Finding(Grade.IMPOSSIBLE, "order", first, why) if exceeds else None


def _rows_with(published: Published, *needed: Family) -> list[list[PrintedValue]]:
    """Return the values of several families in one row, with one threshold."""
    rows = published.by(lambda cell: (*cell.row, cell.score.thresholds))
    by_family = [{cell.score.family: cell for cell in row} for row in rows.values()]
    return [[row[family] for family in needed] for row in by_family if set(needed) <= row.keys()]


def _check_f1(published: Published) -> Outcome:
    """Find F1 that the precision and recall of its row do not give."""
    rows = _rows_with(published, Family.F1, Family.PRECISION, Family.RECALL)
    what = "F1 against precision and recall next to them"
    left = "" if rows else "no row has precision, recall and F1"
    found = tuple(finding for row in rows if (finding := _judge_f1(*row)))
    cells = tuple(cell for row in rows for cell in row)
    return Outcome("F1", len(rows), what, left, found, cells=cells)


def f1_of(precision: Fraction, recall: Fraction) -> Fraction:
    """Return the harmonic mean, 0 where both are 0; it grows with either."""
    total = precision + recall
    return 2 * precision * recall / total if total else _ZERO


def _judge_f1(cell: PrintedValue, precision: PrintedValue, recall: PrintedValue) -> Finding | None:
    lows = [max(_ZERO, one.share.low) for one in (precision, recall)]
    highs = [max(_ZERO, one.share.high) for one in (precision, recall)]
    # A mean F1 over scenes is at least P + R - 1 of the means.
    low = max(_ZERO, sum(lows, _ZERO) - 1) if cell.is_summary else f1_of(*lows)
    possible, digits = Span(low, f1_of(*highs)), cell.number.decimals
    if cell.share.meets(possible):
        return None
    p, r = precision.number.text, recall.number.text
    if cell.is_summary:
        ends = (decimal_text(end * cell.full, digits) for end in (possible.low, possible.high))
        why = (
            f"with mean precision {p} and mean recall {r} a mean F1 lies between P + R - 1 and the "
            f"F1 of the means, which is {' to '.join(ends)}; printed is {cell.number.text}"
        )
    else:
        middle = f1_of(precision.number.value / precision.full, recall.number.value / recall.full)
        exact = decimal_text(middle * cell.full, digits)
        why = f"F1 = 2 x {p} x {r} / ({p} + {r}) = {exact}, printed is {cell.number.text}"
    # Where all three digits were cut off, or two were rounded before.
    slack = sum((c.number.half / c.full for c in (cell, precision, recall)), _ZERO)
    if cell.share.widened(slack).meets(possible):
        return Finding(Grade.ROUNDING, "F1", cell, why + ": off by the last digit")
    return Finding(Grade.IMPOSSIBLE, "F1", cell, why)


def _scene(cell: PrintedValue) -> str:
    return "overall" if cell.is_summary and not cell.is_pooled else cell.scene


def _repeated(published: Published) -> list[tuple[PrintedValue, PrintedValue]]:
    """Return one number in two tables each."""
    groups = published.by(lambda c: (*c.group, _scene(c), c.method, c.score.name))
    pairs = [pair for cells in groups.values() for pair in combinations(cells, 2)]
    return [(first, second) for first, second in pairs if first.table != second.table]


def _apart(first: PrintedValue, second: PrintedValue) -> Fraction:
    """Return how far two numbers are apart, in last digits of the coarser one."""
    step = 2 * max(first.number.half, second.number.half)
    return abs(first.number.value - second.number.value) / step


def _check_agreement(published: Published, reported: AbstractSet[int]) -> Outcome:
    """Find numbers that two tables print differently, where the one with fewer rounds no other."""
    pairs, findings, known = _repeated(published), [], 0
    for first, second in pairs:
        alike = first.number.decimals == second.number.decimals
        differ = first.number.value != second.number.value
        if not (differ if alike else not first.number.span.meets(second.number.span)):
            continue
        if reported & {id(first), id(second)}:
            known += 1
            continue
        grade = Grade.ROUNDING if _apart(first, second) <= 1 else Grade.INCONSISTENT
        why = (
            f"the same number is printed {first.number.text} here and {second.number.text} in "
            f"{second.table or 'another place'}, line {second.line}"
        )
        findings.append(Finding(grade, "agreement", first, why))
    said = f"{known} differ, each found by the check average" if known else ""
    what = "pairs of one number in two tables, whether both say the same"
    outcome = _of_pairs("agreement", what, "nothing is printed in two tables", pairs, findings)
    return replace(outcome, said=said)


def _overview(published: Published, findings: Iterable[Finding]) -> Iterator[str]:
    """Name two tables with several different numbers, and count the findings of that."""
    grave = [finding for finding in findings if finding.grade is Grade.INCONSISTENT]
    tables = grouped(_repeated(published), lambda pair: (pair[0].table, pair[1].table))
    for (one, other), pairs in tables.items():
        apart = [pair for pair in pairs if _apart(*pair) > 1]
        cells = {id(cell) for pair in apart for cell in pair}
        rows = {cell.row for pair in apart for cell in pair}
        of_this = sum(
            id(f.cell) in cells
            if f.check in ("average", "agreement")
            else f.check == "row" and f.cell.row in rows
            for f in grave
        )
        if len(apart) > 1 and of_this > 1:
            yield (
                f"{len(apart)} of the {len(pairs)} numbers that both {one or 'one table'} and "
                f"{other or 'another'} print differ by more than the last digit: {of_this} of the "
                "inconsistencies are this one fact"
            )


def _check_misplaced_rows(published: Published, reported: AbstractSet[int]) -> Outcome:
    """Find rows that another table prints, number for number, under another method's name."""
    rows = published.by(lambda cell: cell.row)
    compared = [
        row
        for row in rows.values()
        if len(row) >= _FEWEST_SCORES and any(cell.number.value for cell in row)
    ]

    def content(row: Cells) -> tuple[object, ...]:
        values = frozenset((cell.score.name, cell.number.value) for cell in row)
        return row[0].group, _scene(row[0]), values

    findings = []
    for alike in grouped(compared, content).values():
        for row, other in permutations(alike, 2):
            cell, there = row[0], other[0]
            own = rows.get((there.table, *cell.group, there.scene, cell.method), [])
            printed = {c.score.name: c.number.value for c in own}
            another = any(printed.get(c.score.name, c.number.value) != c.number.value for c in row)
            is_known = bool(reported & set(map(id, other))) and not reported & set(map(id, row))
            if cell.table == there.table or cell.method == there.method or not another or is_known:
                continue
            values = ", ".join(f"{cell.score.name} {cell.number.text}" for cell in row)
            why = (
                f"all {len(row)} numbers of this row ({values}) are those of {there.method} in "
                f"{there.table}, {there.scene}, so it may stand under the wrong name"
            )
            findings.append(Finding(Grade.INCONSISTENT, "row", cell, why))
    several = len({row[0].table for row in compared}) > 1
    left = "" if several else "nothing is printed in two tables"
    what = "rows, whether another table prints one under another method's name"
    cells = tuple(cell for row in compared for cell in row) if several else ()
    tested = len(compared) if several else 0
    return Outcome("row", tested, what, left, tuple(findings), cells=cells)


def _check_bold(published: Published) -> Outcome:
    """Find bold values that are not the best of their column, and best ones that are not bold."""
    what = "columns, whether the best is bold and nothing else"
    if not published.has_bold:
        return Outcome("bold", 0, what, "the file does not say what is bold")
    columns = published.by(lambda c: (c.table, *c.group, c.scene, c.score.name)).values()
    races = [c for c in columns if c[0].score.higher_is_better is not None and len(c) > 1]
    plain = [column for column in races if not any(cell.bold for cell in column)]
    judged = [column for column in races if any(cell.bold for cell in column)]
    left = []
    if plain:
        places = list(dict.fromkeys(f"{c[0].score.name} of {c[0].place}" for c in plain))
        shown = ", ".join(places[:3]) + (" ..." if len(places) > 3 else "")
        left.append(f"{counted(len(plain), 'column')} in which nothing is bold ({shown})")
    if len(races) < len(columns):
        others = counted(len(columns) - len(races), "column")
        left.append(f"{others} of one method or an unknown score")
    findings = tuple(finding for column in judged for finding in _judge_column(column))
    cells = tuple(cell for column in judged for cell in column)
    return Outcome("bold", len(judged), what, " and ".join(left), findings, cells=cells)


def _judge_column(column: Cells) -> Iterator[Finding]:
    higher = column[0].score.higher_is_better
    best = (max if higher else min)(column, key=lambda cell: cell.number.value).number
    leaders = [cell for cell in column if cell.number.value == best.value]
    bold_leaders = [cell for cell in leaders if cell.bold]
    for cell in column:
        text, leads = cell.number.text, cell.number.value == best.value
        if cell.bold == leads:
            continue
        grade = Grade.ROUNDING if leads and bold_leaders else Grade.INCONSISTENT
        if not leads:
            better = "higher" if higher else "lower"
            why = f"{text} is bold, but {_names(leaders)} has {best.text}, and {better} is better"
        elif bold_leaders:
            why = f"{text} is not bold, but the same number of {_names(bold_leaders)} is"
        else:
            bold = _names([cell for cell in column if cell.bold])
            why = f"{text} is the best of {len(column)} methods, but {bold} is bold"
        yield Finding(grade, "bold", cell, why)


def _names(cells: Cells) -> str:
    """Name methods, the first few where all of a long table are alike."""
    more = [f"{len(cells) - _MOST_NAMES} more"] if len(cells) > _MOST_NAMES else []
    return " and ".join([*(cell.method for cell in cells[:_MOST_NAMES]), *more])
