"""Findings: what is wrong, how sure that is, and why; what was checked; as a table and as text."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import groupby

from airzoo_bench.core.errors import counted
from airzoo_bench.tables.model import Cell, Column, Row, Table, plain
from airzoo_bench.tables.printed_values import PrintedValue

__all__ = ["Audit", "Conclusion", "Finding", "Grade", "Outcome", "audit_table", "audit_text"]

# Longer lines are hard to read, shorter ones hold no sentence.
_WIDEST, _NARROWEST = 100, 40
_BOLD, _USUAL = "\x1b[1m", "\x1b[0m"


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
    check : str
        Which check found it.
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
    tested : int
        How many things it compared.
    what : str
        What these are: "shares of queries".
    left : str
        What could not be checked and why; empty where nothing was left.
    cells : tuple of PrintedValue
        The values that were compared with others, or with what is known.
    said : str
        What is wrong but was found by another check, and so is no finding of this one.
    unchecked : int
        Averages that stand next to their scenes and may be wrong all the same.
    """

    check: str
    tested: int
    what: str
    left: str = ""
    findings: tuple[Finding, ...] = ()
    conclusions: tuple[Conclusion, ...] = ()
    cells: tuple[PrintedValue, ...] = ()
    said: str = ""
    unchecked: int = 0

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
        left = f"; {counted(self.unchecked, 'average')} could not be checked against the scenes"
        left = left if self.unchecked else ""
        if self.checked == self.cells:
            return f"{self.source}: {counts}, in {counted(self.cells, 'value')}{left}"
        told = f"only {self.checked} of {self.cells}" if self.checked else f"none of {self.cells}"
        told = f"{told} values could be checked, apart from their range"
        return f"{self.source}: {counts}; {told}{left}"

    @property
    def checked(self) -> int:
        """How many values were compared with others, or with what is known."""
        return len({id(cell) for outcome in self.outcomes for cell in outcome.cells})

    @property
    def unchecked(self) -> int:
        """How many averages may be wrong although their scenes are printed."""
        return sum(outcome.unchecked for outcome in self.outcomes)

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
    titles = ["Grade", "Check", *(["Table"] if tables else []), "Scene", "Method", "Score"]
    columns = tuple(Column(title) for title in [*titles, "Printed", "Why"])
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


_MEANING = {
    Grade.IMPOSSIBLE: "the number cannot be, by itself, its row, and what was given",
    Grade.INCONSISTENT: "two numbers contradict each other; which of them is wrong is not told",
    Grade.ROUNDING: "off by the last digit",
}


def audit_text(audit: Audit, width: int, *, styled: bool = False) -> str:
    """Lay out an audit as text."""
    room = min(max(width, _NARROWEST), _WIDEST)
    titles: set[str] = set()
    lines: list[str] = []
    for title, body in _sections(audit, room):
        titles.update(_wrapped(title, room))
        lines += [*_wrapped(title, room), *body, ""]
    shown = (f"{_BOLD}{line}{_USUAL}" if styled and line in titles else line for line in lines[:-1])
    return "".join(f"{line}\n" for line in shown)


def _sections(audit: Audit, room: int) -> Iterator[tuple[str, list[str]]]:
    none = "Nothing found." if audit.checked else "Nothing could be checked, so nothing was found."
    if audit.checked and audit.unchecked:
        none = "Nothing found in what could be checked."
    said = [line for text in audit.overview for line in _wrapped(text, room)]
    yield audit.summary, said if audit.findings else [none]
    for grade, findings in groupby(audit.findings, key=lambda finding: finding.grade):
        own = list(findings)
        yield f"{grade.value.upper()} ({len(own)}): {_MEANING[grade]}", list(_found(own, room))
    yield (
        "CHECKED",
        [
            line
            for outcome in audit.outcomes
            for line in _wrapped(outcome.text, room, hanging=13, lead=f"  {outcome.check:<10} ")
        ],
    )
    if audit.conclusions:
        yield "WHAT THE NUMBERS SAY", list(_concluded(audit.conclusions, room))
    if audit.notes:
        yield "NOTES", [line for note in audit.notes for line in _wrapped(note, room, 2)]


def _found(findings: Iterable[Finding], room: int) -> Iterator[str]:
    places = groupby(findings, key=lambda finding: (finding.cell.table, finding.cell.place))
    for (table, place), own in places:
        yield from _wrapped(", ".join(filter(None, (table, place))), room, 2)
        for finding in own:
            cell = finding.cell
            printed = f"{cell.method}, {cell.score.name}: {cell.number.text} [{finding.check}]"
            yield from _wrapped(printed, room, 4)
            yield from _wrapped(finding.why, room, 8)


def _concluded(conclusions: Iterable[Conclusion], room: int) -> Iterator[str]:
    for conclusion in conclusions:
        place = f" of {conclusion.place}" if conclusion.place else ""
        yield from _wrapped(f"{conclusion.check}{place}: {conclusion.text}", room, 2, hanging=6)


def _wrapped(
    text: str, room: int, indent: int = 0, *, hanging: int = 0, lead: str = ""
) -> list[str]:
    return textwrap.wrap(
        plain(text),
        room,
        initial_indent=lead or " " * indent,
        subsequent_indent=" " * (hanging or indent),
        break_on_hyphens=False,
    )
