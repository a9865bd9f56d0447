"""All checks of published tables in one call, checks of order and bold; findings to read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations
from typing import NamedTuple

from airzoo_bench.audit.averages import check_averages, check_gains
from airzoo_bench.audit.counts import (
    check_counts,
    define_precision,
    drop_averages,
    resolve_queries,
)
from airzoo_bench.audit.values import Finding, Grade, Outcome, Score, Value, group_by, read_values
from airzoo_bench.core.errors import counted
from airzoo_bench.tables.model import Cell, Column, Row, Table, plain
from airzoo_bench.tables.published import PrintedValue


class Audit(NamedTuple):
    """The findings on a number of values, the gravest first, and what was checked and concluded."""

    values: int
    findings: list[Finding]
    notes: list[str]

    @property
    def summary(self) -> str:
        """All in one line."""
        grades = [finding.grade for finding in self.findings]
        counts = ", ".join(f"{grades.count(grade)} {grade.value}" for grade in Grade)
        return f"{counts}, in {counted(self.values, 'value')}"

    @property
    def failed(self) -> bool:
        """Whether something is impossible or inconsistent."""
        return any(finding.grade is not Grade.ROUNDING for finding in self.findings)


def audit(printed: Sequence[PrintedValue], counts: Mapping[str, int] | None = None) -> Audit:
    """Check published tables by arithmetic, with the numbers of queries of scenes where given."""
    values = read_values(printed)
    order = _check_order(values)
    rows = {value.cell: value.row for value in values}
    doubtful = {rows[finding.cell] for finding in order.findings}
    # Recalls alone tell whether AP@K is mean precision, which then tells more of the queries.
    by_recalls, _ = resolve_queries(values, counts or {}, doubtful)
    precise, _ = define_precision(values, by_recalls, doubtful)
    queries, conclusions = resolve_queries(values, counts or {}, doubtful, precise)
    precise, definitions = define_precision(values, queries, doubtful)
    hits = drop_averages([value for value in values if value.score.kind == "hits"])
    shares = [v for v in values if v.score_key in precise and not v.cell.is_summary] + hits
    outcomes = (
        check_counts(shares, queries),
        order,
        check_averages(values, queries, precise),
        check_gains(values),
        _check_bold(values),
    )
    findings = [finding for outcome in outcomes for finding in outcome.findings]
    grades = list(Grade)
    findings.sort(key=lambda finding: (grades.index(finding.grade), finding.cell.line))
    notes = [f"{o.check}: {o.tested} checked, {len(o.findings)} found" for o in outcomes]
    return Audit(len(values), findings, [*notes, *conclusions, *definitions])


def _check_order(values: Sequence[Value]) -> Outcome:
    """Find recalls at a smaller threshold that exceed those at a larger one."""
    rows = group_by(values, lambda value: value.row).values()
    pairs = [
        (one, other)
        for row in rows
        for one, other in permutations(row, 2)
        if _is_stricter(one.score, other.score)
    ]
    found = (_judge_order(*pair) for pair in pairs)
    return Outcome("order", len(pairs), [*filter(None, found)])


def _is_stricter(first: Score, second: Score) -> bool:
    """Whether all that counts for the first score counts for the second, by their thresholds."""
    if (first.kind, first.stem) != (second.kind, second.stem) or first.kind == "ap":
        return False
    one, two = first.thresholds, second.thresholds
    if one == two or [unit for _, unit in one] != [unit for _, unit in two]:
        return False
    return all(small <= large for (small, _), (large, _) in zip(one, two, strict=True))


def _judge_order(first: Value, second: Value) -> Finding | None:
    # Rounding alike never turns an order round.
    slack = 0 if first.decimals == second.decimals else first.half + second.half
    if first.number / first.full - second.number / second.full <= slack / first.full:
        return None
    small, large = first.cell, second.cell
    why = (
        f"{small.metric} = {small.value} > {large.metric} = {large.value}, but whatever counts for "
        f"{small.metric} counts for {large.metric} too"
    )
    return Finding(Grade.IMPOSSIBLE, "order", small, why)


def _check_bold(values: Sequence[Value]) -> Outcome:
    """Find bold values that are not the best of their column, and best ones that are not bold."""
    columns = group_by(values, lambda value: value.column).values()
    judged = [c for c in columns if c[0].score.better is not None and len(c) > 1]
    judged = [column for column in judged if any(value.cell.bold for value in column)]
    found = [finding for column in judged for finding in _judge_column(column)]
    return Outcome("bold", len(judged), found)


def _judge_column(column: Sequence[Value]) -> Iterator[Finding]:
    higher = column[0].score.better
    best = (max if higher else min)(value.number for value in column)
    leaders = [value.cell for value in column if value.number == best]
    bold = [cell for cell in leaders if cell.bold]
    for cell in (value.cell for value in column):
        leads = cell in leaders
        if cell.bold == leads:
            continue
        names = " and ".join(one.method for one in leaders if one is not cell)
        if not leads:
            better = "higher" if higher else "lower"
            why = f"is bold, but {names} has {leaders[0].value}, and {better} is better"
        elif bold:
            why = f"is not bold, but the same number of {names} is"
        else:
            why = f"is the best of {len(column)} methods, and not bold"
        grade = Grade.ROUNDING if leads and bold else Grade.INCONSISTENT
        yield Finding(grade, "bold", cell, f"{cell.value} {why}")


def audit_table(audit: Audit, source: str) -> Table:
    """Lay out an audit: a row a finding; checks and conclusions are notes."""
    titles = ("Grade", "Check", "Table", "Scene", "Method", "Score", "Printed", "Why")
    rows = []
    for grade, check, cell, why in audit.findings:
        where = (cell.table, cell.place, cell.method, cell.metric)
        rows.append(Row(tuple(map(Cell, (grade.value, check, *where, str(cell.value), why)))))
    title = f"{source}: {audit.summary}"
    return Table(title, tuple(map(Column, titles)), tuple(rows), tuple(audit.notes))


def audit_text(audit: Audit, source: str) -> str:
    """Lay out an audit as text, a paragraph a finding."""
    lines = [f"{source}: {audit.summary}", ""]
    for grade, check, cell, why in audit.findings:
        where = ", ".join(filter(None, (cell.table, cell.place, cell.method)))
        lines += [f"{grade.value.upper()} [{check}] {where}, {cell.metric} {cell.value}"]
        lines += [why, ""]
    return "".join(f"{plain(line)}\n" for line in (*lines, *audit.notes))
