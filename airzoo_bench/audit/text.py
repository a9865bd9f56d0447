"""An audit as text for a terminal: findings by grade, what was checked, what the numbers say."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from itertools import groupby

from airzoo_bench.audit.findings import Audit, Conclusion, Finding, Grade
from airzoo_bench.tables.model import plain

__all__ = ["audit_text"]

_MEANING = {
    Grade.IMPOSSIBLE: "the number cannot be, by itself, its row, and what was given",
    Grade.INCONSISTENT: "two numbers contradict each other; which of them is wrong is not told",
    Grade.ROUNDING: "off by the last digit",
}
# Longer lines are hard to read, shorter ones hold no sentence.
_WIDEST, _NARROWEST = 100, 40
_BOLD, _USUAL = "\x1b[1m", "\x1b[0m"


def audit_text(audit: Audit, width: int, *, styled: bool = False) -> str:
    """Lay out an audit as text.

    Parameters
    ----------
    audit : Audit
    width : int
        Of the terminal, in characters; no line is longer, nor than 100.
    styled : bool
        Write bold by escape sequences.
    """
    room = min(max(width, _NARROWEST), _WIDEST)
    heads: set[str] = set()
    lines: list[str] = []
    for head, body in _sections(audit, room):
        heads.update(_wrapped(head, room))
        lines += [*_wrapped(head, room), *body, ""]
    shown = (f"{_BOLD}{line}{_USUAL}" if styled and line in heads else line for line in lines[:-1])
    return "".join(f"{line}\n" for line in shown)


def _sections(audit: Audit, room: int) -> Iterator[tuple[str, list[str]]]:
    none = "Nothing found." if audit.checked else "Nothing could be checked, so nothing was found."
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
