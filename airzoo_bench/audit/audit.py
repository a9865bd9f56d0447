"""All checks of published tables in one call."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from airzoo_bench.audit.agreement_checks import check_agreement, check_misplaced_rows, overview
from airzoo_bench.audit.average_checks import check_averages
from airzoo_bench.audit.bold_checks import check_bold
from airzoo_bench.audit.count_checks import check_counts
from airzoo_bench.audit.findings import Audit, Grade
from airzoo_bench.audit.gain_checks import check_gains
from airzoo_bench.audit.order_checks import check_medians, check_order, check_ranges, check_units
from airzoo_bench.audit.precision_checks import check_average_precision, define_average_precision
from airzoo_bench.audit.queries import resolve_queries, row_of
from airzoo_bench.audit.reconstruction_checks import check_chamfer, check_f1
from airzoo_bench.core.errors import first_of
from airzoo_bench.tables.printed_scores import Family
from airzoo_bench.tables.printed_values import Published

__all__ = ["audit"]


def audit(
    published: Published, counts: Mapping[str, int] | None = None, variant: str | None = None
) -> Audit:
    """Check published tables by arithmetic."""
    # Numbers of queries from recalls alone tell which average precision it is, so that nothing is
    # proved by itself; that then tells more of the numbers of queries.
    within_rows = (
        check_ranges(published),
        check_order(published),
        check_medians(published),
        check_f1(published),
    )
    doubtful = {
        row_of(finding.cell)
        for outcome in within_rows
        for finding in outcome.findings
        if finding.grade is Grade.IMPOSSIBLE
    }
    by_recalls, _ = resolve_queries(published, counts or {}, {}, doubtful)
    definitions = define_average_precision(published, by_recalls, variant, doubtful)
    variants = {name: d.variant for name, d in definitions.items() if d.variant}
    queries, conclusions = resolve_queries(published, counts or {}, variants, doubtful)
    counted = check_counts(published, queries)
    averages = check_averages(published, queries, variants)
    off = {id(finding.cell) for finding in averages.findings}
    ranges, order, medians, f1 = within_rows
    outcomes = (
        ranges,
        check_units(published),
        replace(counted, conclusions=(*conclusions, *counted.conclusions)),
        *check_average_precision(published, queries, definitions, doubtful),
        order,
        medians,
        f1,
        check_chamfer(published),
        averages,
        check_agreement(published, off),
        check_misplaced_rows(published, off),
        check_gains(published),
        check_bold(published),
    )
    findings = [finding for outcome in outcomes for finding in outcome.findings]
    said = tuple(overview(published, findings))
    return Audit(published.source, len(published.cells), outcomes, tuple(_notes(published)), said)


def _notes(published: Published) -> list[str]:
    unknown = dict.fromkeys(
        cell.score.name
        for cell in published.cells
        if cell.score.family is Family.OTHER and cell.score.higher_is_better is None
    )
    what = "scores that are not known, checked only for averages, gains and agreement: "
    return [what + first_of(unknown)] if unknown else []
