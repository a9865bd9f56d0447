"""Findings with their grade and arithmetic, and outcomes of checks; as a table and as text."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import groupby

from airzoo_bench.audit.values import Value
from airzoo_bench.core.errors import counted
from airzoo_bench.tables.model import Cell, Column, Row, Table, plain

# Longer lines are hard to read, shorter ones hold no sentence.
_WIDEST, _NARROWEST = 100, 40


class Grade(StrEnum):
    """How sure it is that a printed number is wrong.

    `IMPOSSIBLE` follows from the number itself, the others of its row, and what was given.
    `INCONSISTENT` is a contradiction between printed numbers, or to what was concluded from others:
    one of the two is wrong. `ROUNDING` would be no finding if each printed number involved might be
    off by nearly one of its last digit, as one that was cut off or rounded twice is, instead of
    half of one.
    """

    IMPOSSIBLE = "impossible"
    INCONSISTENT = "inconsistent"
    ROUNDING = "rounding"


_MEANING = {
    Grade.IMPOSSIBLE: "the number cannot be, by itself, its row, and what was given",
    Grade.INCONSISTENT: "two numbers contradict each other; which of them is wrong is not told",
    Grade.ROUNDING: "off by the last digit",
}


@dataclass(frozen=True)
class Finding:
    """A finding: a cell, the check that failed, and its arithmetic in words."""

    grade: Grade
    check: str
    cell: Value
    why: str


@dataclass(frozen=True)
class Outcome:
    """The outcome of one check.

    It compared a number of things, such as "shares of queries", made of `cells`. `left` says what
    could not be checked and why; conclusions are a count, a definition, a way to average.
    """

    check: str
    tested: int
    what: str
    left: str = ""
    findings: tuple[Finding, ...] = ()
    conclusions: tuple[str, ...] = ()
    cells: tuple[Value, ...] = ()

    @property
    def text(self) -> str:
        """Summarise one check: its cells, its findings, and the cells left out."""
        if not self.tested:
            return f"not checked: {self.left}"
        found = f"{len(self.findings)} found" if self.findings else "all fine"
        left = f"; not checked: {self.left}" if self.left else ""
        return f"{self.tested} {self.what}: {found}{left}"


@dataclass(frozen=True)
class Audit:
    """The outcomes of all checks on `cells` values of a source, and notes on values left out."""

    source: str
    cells: int
    outcomes: tuple[Outcome, ...]
    notes: tuple[str, ...] = ()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The gravest first, then by table and place, in the order of the file."""
        found = [finding for outcome in self.outcomes for finding in outcome.findings]
        found.sort(key=lambda finding: finding.cell.line)
        places = [(f.cell.table, f.cell.place) for f in found]
        grades = list(Grade)
        first = {place: number for number, place in reversed([*enumerate(places)])}

        def order(finding: Finding) -> tuple[int, int]:
            place = finding.cell.table, finding.cell.place
            return grades.index(finding.grade), first[place]

        return tuple(sorted(found, key=order))

    @property
    def conclusions(self) -> tuple[str, ...]:
        """The conclusions of all checks."""
        return tuple(text for outcome in self.outcomes for text in outcome.conclusions)

    @property
    def checked(self) -> int:
        """The number of values that were compared with others, or with known counts."""
        return len({cell for outcome in self.outcomes for cell in outcome.cells})

    @property
    def summary(self) -> str:
        """All in one line."""
        grades = [finding.grade for finding in self.findings]
        counts = ", ".join(f"{grades.count(grade)} {grade.value}" for grade in Grade)
        if self.checked == self.cells:
            return f"{self.source}: {counts}, in {counted(self.cells, 'value')}"
        checked = (
            f"only {self.checked} of {self.cells}" if self.checked else f"none of {self.cells}"
        )
        return f"{self.source}: {counts}; {checked} values could be checked, apart from their range"

    @property
    def failed(self) -> bool:
        """Whether something is impossible or inconsistent."""
        return any(finding.grade is not Grade.ROUNDING for finding in self.findings)


def audit_table(audit: Audit) -> Table:
    """Lay out an audit: a row a finding; checks and conclusions are notes."""
    titles = ("Grade", "Check", "Table", "Scene", "Method", "Score", "Printed", "Why")
    rows = []
    for one in audit.findings:
        cell = one.cell
        where = (cell.table, cell.place, cell.method, cell.metric)
        rows.append(
            Row(tuple(map(Cell, (one.grade, one.check, *where, cell.number.text, one.why))))
        )
    checked = (f"checked, {outcome.check}: {outcome.text}" for outcome in audit.outcomes)
    concluded = (f"concluded, {conclusion}" for conclusion in audit.conclusions)
    notes = (*checked, *concluded, *audit.notes)
    return Table(audit.summary, tuple(map(Column, titles)), tuple(rows), notes)


def audit_text(audit: Audit, width: int, *, styled: bool = False) -> str:
    """Lay out an audit as text."""
    room = min(max(width, _NARROWEST), _WIDEST)
    sections = []
    for title, body in _sections(audit):
        head = _wrapped("", "", title, room)
        shown = [f"\x1b[1m{line}\x1b[0m" for line in head] if styled else head
        lines = [line for part in body for line in _wrapped(*part, room)]
        sections.append("".join(f"{line}\n" for line in [*shown, *lines]))
    return "\n".join(sections)


def _sections(audit: Audit) -> Iterator[tuple[str, list[tuple[str, str, str]]]]:
    """Yield titles with their paragraphs: indents of the first and further lines, text."""
    none = "Nothing found." if audit.checked else "Nothing could be checked, so nothing was found."
    yield audit.summary, [] if audit.findings else [("", "", none)]
    for grade, of_grade in groupby(audit.findings, key=lambda finding: finding.grade):
        findings, body = list(of_grade), []
        places = groupby(findings, key=lambda finding: (finding.cell.table, finding.cell.place))
        for place, own in places:
            body.append(("  ", "  ", ", ".join(filter(None, place))))
            for one in own:
                cell = one.cell
                printed = f"{cell.method}, {cell.metric}: {cell.number.text} [{one.check}]"
                body += [(" " * 4, " " * 4, printed), (" " * 8, " " * 8, one.why)]
        yield f"{grade.value.upper()} ({len(findings)}): {_MEANING[grade]}", body
    yield "CHECKED", [(f"  {o.check:<10} ", " " * 13, o.text) for o in audit.outcomes]
    if audit.conclusions:
        yield "WHAT THE NUMBERS SAY", [("  ", " " * 6, text) for text in audit.conclusions]
    if audit.notes:
        yield "NOTES", [("  ", "  ", note) for note in audit.notes]


def _wrapped(first: str, further: str, text: str, room: int) -> list[str]:
    return textwrap.wrap(
        plain(text),
        room,
        initial_indent=first,
        subsequent_indent=further,
        break_on_hyphens=False,
    )
