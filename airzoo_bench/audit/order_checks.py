"""What holds within a row: ranges, recalls that grow with their threshold, medians and recalls."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction

from airzoo_bench.audit.findings import Finding, Grade, Outcome
from airzoo_bench.audit.queries import row_of
from airzoo_bench.core.errors import counted
from airzoo_bench.tables.printed_scores import Family, at_most
from airzoo_bench.tables.printed_values import PrintedValue, Published, grouped

__all__ = ["check_medians", "check_order", "check_ranges", "check_units"]

_DISTANCES = (
    Family.ACCURACY,
    Family.COMPLETENESS,
    Family.CHAMFER,
    Family.MEDIAN,
    Family.ERROR,
)
_HALF = Fraction(1, 2)
_MOST_NEAR = 50


def check_ranges(published: Published) -> Outcome:
    """Find shares outside 0 to 100 % and distances below zero."""
    known = [c for c in published.cells if c.score.is_share or c.score.family in _DISTANCES]
    findings = []
    for cell in known:
        if cell.score.is_share and not 0 <= cell.number.value <= cell.full:
            why = f"{cell.number.text} lies outside 0 to {cell.full}, so it is no share of anything"
            findings.append(Finding(Grade.IMPOSSIBLE, "range", cell, why))
        elif not cell.score.is_share and cell.number.value < 0:
            why = f"{cell.number.text} is below 0, and no {cell.score.family.value} is"
            findings.append(Finding(Grade.IMPOSSIBLE, "range", cell, why))
    what = "values, whether shares lie within 0 to 100 % and distances are not negative"
    unknown = len(published.cells) - len(known)
    left = f"{counted(unknown, 'value')} of scores that are not known" if unknown else ""
    return Outcome("range", len(known), what, left, tuple(findings))


def check_units(published: Published) -> Outcome:
    """Find rows of shares from 0 to 1 among rows of percent."""
    shares = [c for c in published.cells if c.score.is_share and c.full == 100]
    columns = grouped(shares, _column)
    findings: list[Finding] = []
    for row in grouped(shares, row_of).values():
        printed = [cell for cell in row if cell.number.value]
        if not printed or not all(0 < cell.number.value <= 1 for cell in printed):
            continue
        others = [_percent_in(cell, columns[_column(cell)]) for cell in printed]
        if all(others):
            findings.extend(
                _share_among_percent(*pair) for pair in zip(printed, others, strict=True)
            )
    rivals = [cell for cells in columns.values() if len(cells) > 1 for cell in cells]
    what = "shares, whether those of one score are all in percent or all from 0 to 1"
    left = "" if rivals else "no share is printed of two methods or scenes"
    return Outcome("units", len(rivals), what, left, tuple(findings))


def _column(cell: PrintedValue) -> tuple[str, ...]:
    return cell.table, *cell.group, cell.score.name


def _percent_in(cell: PrintedValue, column: Iterable[PrintedValue]) -> PrintedValue | None:
    """Return a number of the column that is percent for sure, printed with two decimals less."""
    fitting = (
        other
        for other in column
        if other.number.value > 1 and other.number.decimals <= cell.number.decimals - 2
    )
    return next(fitting, None)


def _share_among_percent(cell: PrintedValue, other: PrintedValue | None) -> Finding:
    contrast = f" next to {other.number.text} of {other.method}" if other else ""
    why = (
        f"{cell.number.text}{contrast} looks like a share from 0 to 1 among percent, and is read "
        f"as {cell.number.text} %; give such rows in percent, or the table with a column 'unit'"
    )
    return Finding(Grade.INCONSISTENT, "units", cell, why)


def check_order(published: Published) -> Outcome:
    """Find recalls at a smaller threshold that exceed those at a larger one."""
    pairs = [
        (first, second)
        for row in published.by(row_of).values()
        for first, second in _pairs(row)
        if at_most(first.score, second.score)
    ]
    findings = [_disordered(*pair) for pair in pairs if _exceeds(*pair)]
    what = "pairs such as R@1 and R@5 of one row, whether the stricter one is not larger"
    left = "" if pairs else "no row has one kind of recall at two thresholds"
    cells = tuple(cell for pair in pairs for cell in pair)
    return Outcome("order", len(pairs), what, left, tuple(findings), cells=cells)


def _pairs(row: Sequence[PrintedValue]) -> Iterator[tuple[PrintedValue, PrintedValue]]:
    """Yield all pairs of a row, either way round; of a very long one those that stand near."""
    for place, first in enumerate(row):
        for second in row[max(0, place - _MOST_NEAR) : place + _MOST_NEAR + 1]:
            if second is not first:
                yield first, second


def _disordered(first: PrintedValue, second: PrintedValue) -> Finding:
    small, large = first.score.name, second.score.name
    why = (
        f"{small} = {first.number.text} > {large} = {second.number.text}, but whatever counts for "
        f"{small} counts for {large} too, so {large} cannot be smaller"
    )
    return Finding(Grade.IMPOSSIBLE, "order", first, why)


def _exceeds(first: PrintedValue, second: PrintedValue) -> bool:
    if first.number.decimals == second.number.decimals and first.full == second.full:
        # Rounding alike never turns an order round.
        return first.number.value > second.number.value
    return first.share.low > second.share.high


def check_medians(published: Published) -> Outcome:
    """Find medians on the wrong side of a threshold within which more, or less, than half lie."""
    pairs = [
        (median, recall)
        for row in published.by(row_of).values()
        for median, recall in _pairs(row)
        if median.score.family is Family.MEDIAN and not median.is_summary
        if _is_within(recall, median.unit)
    ]
    findings = [finding for pair in pairs if (finding := _contradiction(*pair))]
    what = "medians next to shares of errors within a threshold, whether both can be"
    left = "" if pairs else "no row of a scene has a median and a recall within so many of its unit"
    cells = tuple(cell for pair in pairs for cell in pair)
    return Outcome("median", len(pairs), what, left, tuple(findings), cells=cells)


def _is_within(recall: PrintedValue, unit: str) -> bool:
    thresholds = recall.score.thresholds
    is_one = recall.score.family is Family.HITS and len(thresholds) == 1
    return is_one and bool(unit) and thresholds[0][1] == unit


def _contradiction(median: PrintedValue, recall: PrintedValue) -> Finding | None:
    threshold, unit = recall.score.thresholds[0]
    # One half more than rounding allows: digits may have been cut off.
    errors = median.number.interval.widened(median.number.half)
    share = recall.share.widened(recall.number.half / recall.full)
    limit = f"{float(threshold):g} {unit}"
    printed = f"printed is {median.number.text} {unit}"
    if share.low > _HALF and errors.low > threshold:
        why = (
            f"{recall.score.name} = {recall.number.text}: more than half of the errors lie below "
            f"{limit}, so the median does too; {printed}"
        )
        return Finding(Grade.IMPOSSIBLE, "median", median, why)
    if share.high < _HALF and errors.high < threshold:
        why = (
            f"{recall.score.name} = {recall.number.text}: fewer than half of the errors lie below "
            f"{limit}, so the median does not; {printed}. Both can be only where the median leaves "
            "out queries that failed"
        )
        return Finding(Grade.INCONSISTENT, "median", median, why)
    return None
