"""Findings: what is wrong, how sure that is, and the arithmetic; and what was checked at all."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from airzoo_bench.core.plurals import counted
from airzoo_bench.tables.model import Cell, Column, Row, Table
from airzoo_bench.tables.printed.cells import PrintedValue

__all__ = ["Audit", "Conclusion", "Finding", "Grade", "Outcome", "audit_table"]


class Grade(StrEnum):
    """How sure it is that a printed number is wrong.

    `IMPOSSIBLE` follows from the number itself, the others of its row, and what was given (counts,
    a definition). `INCONSISTENT` is a contradiction between printed numbers, or to what was
    concluded from others: one of the two is wrong. `ROUNDING` is what a way of rounding explains:
    it would be none if each printed number involved might be off by nearly one of its last digit,
    as one that was cut off, rounded up or rounded twice is, instead of half of one.
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
    cell : PrintedValue
    why : str
        The arithmetic, in words and numbers.
    """

    grade: Grade
    check: str
    cell: PrintedValue
    why: str


@dataclass(frozen=True)
class Conclusion:
    """What the numbers say where nothing is wrong: a count, a definition, a way to average."""

    check: str
    place: str
    text: str


@dataclass(frozen=True)
class Outcome:
    """What one check did.

    Attributes
    ----------
    check : str
    tested : int
        How many things it held against arithmetic.
    what : str
        What these are: "shares of queries".
    left : str
        What could not be checked and why; empty where nothing was left.
    findings : tuple of Finding
    conclusions : tuple of Conclusion
    cells : tuple of PrintedValue
        The values that were held against others, or against what is known.
    said : str
        What is wrong but was found by another check, and so is no finding of this one.
    """

    check: str
    tested: int
    what: str
    left: str = ""
    findings: tuple[Finding, ...] = ()
    conclusions: tuple[Conclusion, ...] = ()
    cells: tuple[PrintedValue, ...] = ()
    said: str = ""

    @property
    def text(self) -> str:
        """Say what was checked, what came of it, and what was not checked."""
        if not self.tested:
            return f"not checked: {self.left}"
        found = f"{len(self.findings)} found" if self.findings else ""
        found = ", ".join(filter(None, (found, self.said))) or "all fine"
        left = f"; not checked: {self.left}" if self.left else ""
        return f"{self.tested} {self.what}: {found}{left}"


@dataclass(frozen=True)
class Audit:
    """All that was found.

    Attributes
    ----------
    source : str
        What was audited.
    cells : int
        How many values.
    outcomes : tuple of Outcome
        One for each check.
    notes : tuple of str
        What of the file was not used, or read otherwise than it stands there.
    overview : tuple of str
        What many findings have in common.
    """

    source: str
    cells: int
    outcomes: tuple[Outcome, ...]
    notes: tuple[str, ...]
    overview: tuple[str, ...] = ()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The gravest first, then by table and place, in the order of the file."""
        found = [finding for outcome in self.outcomes for finding in outcome.findings]
        lines: dict[tuple[str, str], int] = {}
        for finding in sorted(found, key=lambda f: f.cell.line):
            lines.setdefault((finding.cell.table, finding.cell.place), finding.cell.line)

        def order(finding: Finding) -> tuple[int, int, int]:
            cell = finding.cell
            grade = list(Grade).index(finding.grade)
            return grade, lines[cell.table, cell.place], cell.line

        return tuple(sorted(found, key=order))

    @property
    def conclusions(self) -> tuple[Conclusion, ...]:
        """What the numbers say where nothing is wrong, check by check."""
        return tuple(said for outcome in self.outcomes for said in outcome.conclusions)

    @property
    def summary(self) -> str:
        """All in one line."""
        counts = ", ".join(f"{self.count(grade)} {grade.value}" for grade in Grade)
        if self.checked == self.cells:
            return f"{self.source}: {counts}, in {counted(self.cells, 'value')}"
        told = f"only {self.checked} of {self.cells}" if self.checked else f"none of {self.cells}"
        return f"{self.source}: {counts}; {told} values could be checked, apart from their range"

    @property
    def checked(self) -> int:
        """How many values were held against others, or against what is known."""
        return len({id(cell) for outcome in self.outcomes for cell in outcome.cells})

    def count(self, grade: Grade) -> int:
        """Return the number of findings of one grade."""
        return sum(finding.grade is grade for finding in self.findings)

    @property
    def failed(self) -> bool:
        """Whether something is impossible or inconsistent."""
        return any(finding.grade is not Grade.ROUNDING for finding in self.findings)


def audit_table(audit: Audit) -> Table:
    """Lay out an audit: a row a finding; what was checked and concluded are notes."""
    tables = any(finding.cell.table for finding in audit.findings)
    heads = ["Grade", "Check", *(["Table"] if tables else []), "Scene", "Method", "Score"]
    columns = tuple(Column(title) for title in [*heads, "Printed", "Why"])
    rows = [_finding_row(finding, tables) for finding in audit.findings]
    checked = (f"checked, {outcome.check}: {outcome.text}" for outcome in audit.outcomes)
    notes = (*audit.overview, *checked, *map(_note, audit.conclusions), *audit.notes)
    return Table(audit.summary, columns, tuple(rows), notes)


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
