"""All checks of published tables in one call; checks of rows, columns, repeated numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from fractions import Fraction
from itertools import chain, combinations, permutations

from airzoo_bench.audit.counts import check_counts, define_precision, resolve_queries
from airzoo_bench.audit.findings import Audit, Finding, Grade, Outcome
from airzoo_bench.audit.sums import check_averages, check_gains
from airzoo_bench.audit.values import LOWER, Family, Score, Span, Value, decimal_text, read_values
from airzoo_bench.core.errors import counted, first_of
from airzoo_bench.tables.published import Published, grouped

Values = Sequence[Value]
Pair = tuple[Value, Value]

# What is within a distance is within a larger one.
_GROWING = (Family.HITS, Family.PRECISION, Family.RECALL, Family.F1, Family.CURVE)
_FEWEST = 3  # a whole row of fewer says nothing: two scores may agree by chance
_MOST_NAMES = 10
_ZERO = Fraction(0)


def audit(published: Published, counts: Mapping[str, int] | None = None) -> Audit:
    """Check published tables by arithmetic, with the numbers of queries of scenes where given."""
    values = read_values(published)
    within_rows = [check(values) for check in (_check_ranges, _check_order, _check_f1)]
    doubtful = {
        finding.cell.row
        for outcome in within_rows
        for finding in outcome.findings
        if finding.grade is Grade.IMPOSSIBLE
    }
    # Recalls alone tell whether AP@K is mean precision, which then tells more of the queries.
    by_recalls, _ = resolve_queries(values, counts or {}, doubtful)
    precise, _ = define_precision(values, by_recalls, doubtful)
    queries, conclusions = resolve_queries(values, counts or {}, doubtful, precise)
    precise, precisions = define_precision(values, queries, doubtful)
    averages = check_averages(values, queries, precise)
    off = {finding.cell for finding in averages.findings}
    ranges, order, f1 = within_rows
    outcomes = (
        ranges,
        check_counts(values, queries, conclusions),
        precisions,
        order,
        f1,
        averages,
        _check_agreement(values, off),
        _check_misplaced_rows(values, off),
        check_gains(values),
        _check_bold(values, has_bold=published.has_bold),
    )
    unknown = dict.fromkeys(
        value.metric
        for value in values
        if value.score.family is Family.OTHER and value.score.higher_is_better is None
    )
    note = "scores that are not known, checked only for averages, gains and agreement: "
    notes = (note + first_of(unknown),) if unknown else ()
    return Audit(published.path.name, len(values), outcomes, notes)


def _check_ranges(values: Values) -> Outcome:
    """Find shares outside 0 to 100 % and distances below zero."""
    known = [v for v in values if v.score.is_share or v.score.family in LOWER]
    findings = []
    for value in known:
        number, why = value.number, ""
        if value.score.is_share and not 0 <= number.value <= value.full:
            why = f"{number.text} lies outside 0 to {value.full}, so it is no share of anything"
        elif not value.score.is_share and number.value < 0:
            why = f"{number.text} is below 0, and no {value.score.family.value} is"
        findings += [Finding(Grade.IMPOSSIBLE, "range", value, why)] if why else []
    what = "values, whether shares lie within 0 to 100 % and distances are not negative"
    unknown = len(values) - len(known)
    left = f"{counted(unknown, 'value')} of scores that are not known" if unknown else ""
    return Outcome("range", len(known), what, left, tuple(findings))


def _pairs_outcome(
    check: str, what: str, none: str, pairs: Sequence[Pair], findings: Iterable[Finding | None]
) -> Outcome:
    cells = tuple(chain.from_iterable(pairs))
    left = "" if pairs else none
    return Outcome(check, len(pairs), what, left, tuple(filter(None, findings)), cells=cells)


def _check_order(values: Values) -> Outcome:
    """Find recalls at a smaller threshold that exceed those at a larger one."""
    rows = grouped(values, lambda value: value.row).values()
    pairs = [
        (one, other)
        for row in rows
        for one, other in permutations(row, 2)
        if _is_stricter(one.score, other.score)
    ]
    what = "pairs such as R@1 and R@5 of one row, whether the stricter one is not larger"
    none = "no row has one kind of recall at two thresholds"
    return _pairs_outcome("order", what, none, pairs, (_disordered(*pair) for pair in pairs))


def _is_stricter(first: Score, second: Score) -> bool:
    """Whether all that counts for the first score counts for the second, by their thresholds."""
    if (first.family, first.stem) != (second.family, second.stem) or first.family not in _GROWING:
        return False
    one, two = first.thresholds, second.thresholds
    if one == two or [unit for _, unit in one] != [unit for _, unit in two]:
        return False
    return all(small <= large for (small, _), (large, _) in zip(one, two, strict=True))


def _disordered(first: Value, second: Value) -> Finding | None:
    if first.number.decimals == second.number.decimals and first.full == second.full:
        # Rounding alike never turns an order round.
        exceeds = first.number.value > second.number.value
    else:
        exceeds = first.share.low > second.share.high
    small, large = first.metric, second.metric
    why = (
        f"{small} = {first.number.text} > {large} = {second.number.text}, but whatever counts for "
        f"{small} counts for {large} too, so {large} cannot be smaller"
    )
    return Finding(Grade.IMPOSSIBLE, "order", first, why) if exceeds else None


def _check_f1(values: Values) -> Outcome:
    """Find F1 that the precision and recall of its row do not give."""
    needed = (Family.F1, Family.PRECISION, Family.RECALL)
    rows = grouped(values, lambda value: (*value.row, value.score.thresholds)).values()
    by_family = [{value.score.family: value for value in row} for row in rows]
    complete = [[row[f] for f in needed] for row in by_family if set(needed) <= row.keys()]
    found = tuple(finding for row in complete if (finding := _judge_f1(*row)))
    what = "F1 against precision and recall next to them"
    left = "" if complete else "no row has precision, recall and F1"
    cells = tuple(cell for row in complete for cell in row)
    return Outcome("F1", len(complete), what, left, found, cells=cells)


def _f1_of(precision: Fraction, recall: Fraction) -> Fraction:
    """Return the harmonic mean, 0 where both are 0; it grows with either."""
    total = precision + recall
    return 2 * precision * recall / total if total else _ZERO


def _judge_f1(cell: Value, precision: Value, recall: Value) -> Finding | None:
    lows = [max(_ZERO, one.share.low) for one in (precision, recall)]
    highs = [max(_ZERO, one.share.high) for one in (precision, recall)]
    # A mean F1 over scenes is at least P + R - 1 of the means.
    low = max(_ZERO, sum(lows, _ZERO) - 1) if cell.is_summary else _f1_of(*lows)
    possible = Span(low, _f1_of(*highs))
    if cell.share.meets(possible):
        return None
    p, r, printed = precision.number.text, recall.number.text, cell.number.text
    ends = [decimal_text(x * cell.full, cell.number.decimals) for x in (low, possible.high)]
    why = (
        f"with mean precision {p} and mean recall {r} a mean F1 lies between P + R - 1 and the "
        f"F1 of the means, which is {' to '.join(ends)}; printed is {printed}"
    )
    if not cell.is_summary:
        middle = _f1_of(precision.number.value / precision.full, recall.number.value / recall.full)
        exact = decimal_text(middle * cell.full, cell.number.decimals)
        why = f"F1 = 2 x {p} x {r} / ({p} + {r}) = {exact}, printed is {printed}"
    # Where all three digits were cut off, or two were rounded before.
    slack = sum((c.number.half / c.full for c in (cell, precision, recall)), _ZERO)
    if cell.share.widened(slack).meets(possible):
        return Finding(Grade.ROUNDING, "F1", cell, why + ": off by the last digit")
    return Finding(Grade.IMPOSSIBLE, "F1", cell, why)


def _scene(cell: Value) -> str:
    return "overall" if cell.is_summary and not cell.is_pooled else cell.scene


def _check_agreement(values: Values, off: AbstractSet[Value]) -> Outcome:
    """Find numbers that two tables print differently, where the one with fewer rounds no other."""
    groups = grouped(values, lambda v: (*v.group, _scene(v), v.method, v.metric)).values()
    pairs = [
        (first, second)
        for cells in groups
        for first, second in combinations(cells, 2)
        if first.table != second.table
    ]
    what = "pairs of one number in two tables, whether both say the same"
    # Of averages that are off, the difference has been found.
    found = (_differing(*pair) for pair in pairs if off.isdisjoint(pair))
    return _pairs_outcome("agreement", what, "nothing is printed in two tables", pairs, found)


def _differing(first: Value, second: Value) -> Finding | None:
    if first.number.decimals == second.number.decimals:
        same = first.number.value == second.number.value
    else:
        same = first.span.meets(second.span)
    # In last digits of the coarser one.
    apart = abs(first.number.value - second.number.value)
    apart /= 2 * max(first.number.half, second.number.half)
    why = (
        f"the same number is printed {first.number.text} here and {second.number.text} in "
        f"{second.table or 'another place'}, line {second.line}"
    )
    grade = Grade.ROUNDING if apart <= 1 else Grade.INCONSISTENT
    return None if same else Finding(grade, "agreement", first, why)


def _check_misplaced_rows(values: Values, off: AbstractSet[Value]) -> Outcome:
    """Find rows that another table prints, number for number, under another method's name."""
    rows = grouped(values, lambda value: value.row)
    compared = [r for r in rows.values() if len(r) >= _FEWEST and any(c.number.value for c in r)]
    if len({row[0].table for row in compared}) < 2:
        compared = []

    def content(row: Values) -> tuple[object, ...]:
        numbers = frozenset((cell.metric, cell.number.value) for cell in row)
        return row[0].group, _scene(row[0]), numbers

    findings = []
    for alike in grouped(compared, content).values():
        for row, other in permutations(alike, 2):
            cell, there = row[0], other[0]
            own = rows.get((there.table, *cell.group, there.scene, cell.method), [])
            printed = {c.metric: c.number.value for c in own}
            has_another = any(printed.get(c.metric, c.number.value) != c.number.value for c in row)
            # Of two such rows, the one whose averages are off is in the wrong place.
            is_right = off.isdisjoint(row) and not off.isdisjoint(other)
            apart = cell.table != there.table and cell.method != there.method
            if apart and has_another and not is_right:
                numbers = ", ".join(f"{cell.metric} {cell.number.text}" for cell in row)
                why = (
                    f"all {len(row)} numbers of this row ({numbers}) are those of {there.method} "
                    f"in {there.table}, {there.scene}, so it may have the wrong name"
                )
                findings.append(Finding(Grade.INCONSISTENT, "row", cell, why))
    left = "" if compared else "nothing is printed in two tables"
    what = "rows, whether another table prints one under another method's name"
    cells = tuple(chain.from_iterable(compared))
    return Outcome("row", len(compared), what, left, tuple(findings), cells=cells)


def _check_bold(values: Values, *, has_bold: bool) -> Outcome:
    """Find bold values that are not the best of their column, and best ones that are not bold."""
    what = "columns, whether the best is bold and nothing else"
    columns = grouped(values, lambda v: (v.table, *v.group, v.scene, v.metric)).values()
    races = [c for c in columns if c[0].score.higher_is_better is not None and len(c) > 1]
    judged = [column for column in races if any(cell.bold for cell in column)]
    rest = len(columns) - len(judged)
    left = f"{counted(rest, 'column')} without bold, of one method or an unknown score"
    if not has_bold:
        left = "the file does not say what is bold"
    findings = tuple(finding for column in judged for finding in _judge_column(column))
    cells = tuple(cell for column in judged for cell in column)
    return Outcome("bold", len(judged), what, left if rest else "", findings, cells=cells)


def _judge_column(column: Values) -> Iterator[Finding]:
    higher = column[0].score.higher_is_better
    best = (max if higher else min)(column, key=lambda cell: cell.number.value).number
    leaders = [cell for cell in column if cell.number.value == best.value]
    bold = [cell for cell in leaders if cell.bold]
    for cell in column:
        text, leads = cell.number.text, cell in leaders
        if cell.bold == leads:
            continue
        if not leads:
            better = "higher" if higher else "lower"
            why = f"{text} is bold, but {_names(leaders)} has {best.text}, and {better} is better"
        elif bold:
            why = f"{text} is not bold, but the same number of {_names(bold)} is"
        else:
            others = _names([cell for cell in column if cell.bold])
            why = f"{text} is the best of {len(column)} methods, but {others} is bold"
        yield Finding(Grade.ROUNDING if leads and bold else Grade.INCONSISTENT, "bold", cell, why)


def _names(cells: Values) -> str:
    more = [f"{len(cells) - _MOST_NAMES} more"] if len(cells) > _MOST_NAMES else []
    return " and ".join([*(cell.method for cell in cells[:_MOST_NAMES]), *more])
