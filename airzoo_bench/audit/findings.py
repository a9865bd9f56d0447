"""Findings: what is wrong, how sure that is, and the arithmetic."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from airzoo_bench.audit.published import Printed
from airzoo_bench.tables.model import Cell, Column, Row, Table

__all__ = ["Audit", "Conclusion", "Finding", "Grade", "audit_table"]


class Grade(StrEnum):
    """How sure it is that a printed number is wrong.

    `IMPOSSIBLE` follows from the number itself, the others of its row, and what was given (counts,
    a definition). `INCONSISTENT` is a contradiction between printed numbers, or to what was
    concluded from others: one of the two is wrong. `ROUNDING` is off by the last digit.
    """

    IMPOSSIBLE = "impossible"
    INCONSISTENT = "inconsistent"
    ROUNDING = "rounding"


@dataclass(frozen=True)
class Finding:
    """A cell that something is wrong with.

    Attributes
    ----------
    grade : Grade
    check : str
        Which check found it.
    cell : Printed
    why : str
        The arithmetic, in words and numbers.
    """

    grade: Grade
    check: str
    cell: Printed
    why: str


@dataclass(frozen=True)
class Conclusion:
    """What the numbers say where nothing is wrong: a count, a definition, a way to average."""

    check: str
    place: str
    text: str


@dataclass(frozen=True)
class Audit:
    """All that was found.

    Attributes
    ----------
    source : str
        What was audited.
    cells : int
        How many values.
    findings : tuple of Finding
        The gravest first, then in the order of the file.
    conclusions : tuple of Conclusion
    notes : tuple of str
        What could not be checked, and why.
    """

    source: str
    cells: int
    findings: tuple[Finding, ...]
    conclusions: tuple[Conclusion, ...]
    notes: tuple[str, ...]

    def count(self, grade: Grade) -> int:
        """Return the number of findings of one grade."""
        return sum(finding.grade is grade for finding in self.findings)

    @property
    def failed(self) -> bool:
        """Whether something is impossible or inconsistent."""
        return any(finding.grade is not Grade.ROUNDING for finding in self.findings)


def audit_table(audit: Audit) -> Table:
    """Lay out an audit: a row a finding; conclusions are notes."""
    tables = any(finding.cell.table for finding in audit.findings)
    heads = ["Grade", "Check", *(["Table"] if tables else []), "Scene", "Method", "Score"]
    columns = tuple(Column(title) for title in [*heads, "Printed", "Why"])
    rows = [_finding_row(finding, tables) for finding in audit.findings]
    counts = ", ".join(f"{audit.count(grade)} {grade.value}" for grade in Grade)
    title = f"{audit.source}: {counts}, in {audit.cells} values"
    return Table(title, columns, tuple(rows), (*map(_note, audit.conclusions), *audit.notes))


def _finding_row(finding: Finding, tables: bool) -> Row:
    cell = finding.cell
    texts = [
        finding.grade.value,
        finding.check,
        *([cell.table] if tables else []),
        cell.place,
        cell.method,
        cell.score.name,
        cell.number.text,
        finding.why,
    ]
    return Row(tuple(Cell(text) for text in texts))


def _note(conclusion: Conclusion) -> str:
    place = f" of {conclusion.place}" if conclusion.place else ""
    return f"concluded, {conclusion.check}{place}: {conclusion.text}"
