"""Findings with their grade and arithmetic, and outcomes of checks; as a table and as text."""

from __future__ import annotations

import textwrap
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
        """The gravest first, then in the order of the file."""
        found = [finding for outcome in self.outcomes for finding in outcome.findings]
        grades = list(Grade)
        return tuple(sorted(found, key=lambda one: (grades.index(one.grade), one.cell.line)))

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
        checked = f"only {self.checked}" if self.checked else "none"
        apart = f"{checked} of {self.cells} values could be checked, apart from their range"
        return f"{self.source}: {counts}; {apart}"

    @property
    def failed(self) -> bool:
        """Whether something is impossible or inconsistent."""
        return any(finding.grade is not Grade.ROUNDING for finding in self.findings)


def audit_table(audit: Audit) -> Table:
    """Lay out an audit: a row a finding; checks and conclusions are notes."""
    titles = ("Grade", "Check", "Table", "Scene", "Method", "Score", "Printed", "Why")
    rows = []
    for one in audit.findings:
        where = (one.cell.table, one.cell.place, one.cell.method, one.cell.metric)
        texts = (one.grade, one.check, *where, one.cell.number.text, one.why)
        rows.append(Row(tuple(map(Cell, texts))))
    checked = (f"checked, {outcome.check}: {outcome.text}" for outcome in audit.outcomes)
    concluded = (f"concluded, {conclusion}" for conclusion in audit.conclusions)
    notes = (*checked, *concluded, *audit.notes)
    return Table(audit.summary, tuple(map(Column, titles)), tuple(rows), notes)


def audit_text(audit: Audit, width: int, *, styled: bool = False) -> str:
    """Lay out an audit as text, a paragraph a finding."""
    nothing = "Nothing found." if audit.checked else "Nothing could be checked."
    sections = [(audit.summary, [] if audit.findings else [("", nothing)])]
    for grade, of_grade in groupby(audit.findings, key=lambda finding: finding.grade):
        findings, body, place = list(of_grade), list[tuple[str, str]](), ""
        for one in findings:
            cell = one.cell
            here = ", ".join(filter(None, (cell.table, cell.place)))
            body += [("  ", here)] * (here != place)
            printed = f"{cell.method}, {cell.metric}: {cell.number.text} [{one.check}]"
            body += [(" " * 4, printed), (" " * 8, one.why)]
            place = here
        title = f"{grade.value.upper()} ({len(findings)}): {_MEANING[grade]}"
        sections.append((title, body))
    sections += [
        ("CHECKED", [(f"  {one.check:<10} ", one.text) for one in audit.outcomes]),
        ("WHAT THE NUMBERS SAY", [("  ", text) for text in audit.conclusions]),
        ("NOTES", [("  ", note) for note in audit.notes]),
    ]
    texts, room = [], min(max(width, _NARROWEST), _WIDEST)
    for title, body in sections[:1] + [section for section in sections[1:] if section[1]]:
        head = _wrapped("", title, room)
        shown = [f"\x1b[1m{line}\x1b[0m" for line in head] if styled else head
        lines = [line for first, text in body for line in _wrapped(first, text, room)]
        texts.append("".join(f"{line}\n" for line in [*shown, *lines]))
    return "\n".join(texts)


def _wrapped(first: str, text: str, room: int) -> list[str]:
    further = " " * len(first)
    return textwrap.wrap(
        plain(text), room, initial_indent=first, subsequent_indent=further, break_on_hyphens=False
    )
