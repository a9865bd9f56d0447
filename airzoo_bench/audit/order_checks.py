"""What holds within a row: ranges, recalls that grow with their threshold, medians and recalls."""

from __future__ import annotations

from fractions import Fraction
from itertools import permutations

from airzoo_bench.audit.findings import Finding, Grade
from airzoo_bench.audit.published import Printed, Published
from airzoo_bench.audit.scores import Family, at_most

__all__ = ["check_medians", "check_order", "check_ranges"]

_DISTANCES = (
    Family.ACCURACY,
    Family.COMPLETENESS,
    Family.CHAMFER,
    Family.MEDIAN,
    Family.ERROR,
)
_HALF = Fraction(1, 2)


def check_ranges(published: Published) -> list[Finding]:
    """Find shares outside 0 to 100 % and distances below zero."""
    findings = []
    for cell in published.cells:
        if cell.score.is_share and not 0 <= cell.number.value <= cell.full:
            why = f"{cell.number.text} is no share: it lies outside 0 to {cell.full}"
            findings.append(Finding(Grade.IMPOSSIBLE, "range", cell, why))
        elif cell.score.family in _DISTANCES and cell.number.value < 0:
            why = f"{cell.number.text}: no {cell.score.family.value} is below 0"
            findings.append(Finding(Grade.IMPOSSIBLE, "range", cell, why))
    return findings


def check_order(published: Published) -> list[Finding]:
    """Find recalls at a smaller threshold that exceed those at a larger one."""
    findings = []
    for row in published.by(_row).values():
        for first, second in permutations(row, 2):
            if at_most(first.score, second.score) and _exceeds(first, second):
                why = (
                    f"{first.score.name} = {first.number.text} > {second.score.name} = "
                    f"{second.number.text}, but every hit of the former is one of the latter"
                )
                findings.append(Finding(Grade.IMPOSSIBLE, "order", first, why))
    return findings


def _row(cell: Printed) -> tuple[str, ...]:
    return cell.table, *cell.group, cell.scene, cell.method


def _exceeds(first: Printed, second: Printed) -> bool:
    if first.number.decimals == second.number.decimals and first.full == second.full:
        # Rounding alike never turns an order round.
        return first.number.value > second.number.value
    return first.share.low > second.share.high


def check_medians(published: Published) -> list[Finding]:
    """Find medians on the wrong side of a threshold within which more, or less, than half lie.

    Only in scenes: an average of medians is no median.
    """
    findings = []
    for row in published.by(_row).values():
        medians = [c for c in row if c.score.family is Family.MEDIAN and not c.is_summary]
        for median in medians:
            for recall in row:
                why = _contradiction(median, recall)
                if why:
                    findings.append(Finding(Grade.IMPOSSIBLE, "median", median, why))
    return findings


def _contradiction(median: Printed, recall: Printed) -> str | None:
    thresholds = recall.score.thresholds
    if recall.score.family is not Family.HITS or len(thresholds) != 1:
        return None
    threshold, unit = thresholds[0]
    if not unit or unit != median.unit:
        return None
    errors = median.number.interval
    recalled = f"{recall.score.name} = {recall.number.text}"
    if recall.share.low > _HALF and errors.low > threshold:
        return f"{recalled}: more than half of the errors lie below it, so the median does too"
    if recall.share.high < _HALF and errors.high < threshold:
        return f"{recalled}: less than half of the errors lie below it, so the median does not"
    return None
