"""LaTeX tables as rows of cells: environments, rules, and fields that span several columns."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.printed.latex_source import OPTION, Macro, expanded, group_end
from airzoo_bench.tables.printed.tabulars import TABULARS, Tabular, behind_arguments, has_tabulars

__all__ = ["Line", "SpannedCell", "lines_of", "looks_like_latex"]

_NESTED = re.compile(rf"\\(begin|end)\{{(?:{TABULARS})\}}")
_BROKEN = re.compile(r"\\\\\*?|\\(?:begin|end)\{[^{}]*\}|(?<!\\)&")
_FIELD_END = re.compile(r"(?<!\\)&")
_OPTION = re.compile(OPTION)
_ARGUMENT = r"\s*\{[^{}]*\}"
# Rules from side to side: they divide the rows of a table into sections.
_RULE = re.compile(
    rf"\\(?:(?:toprule|midrule|bottomrule|hdashline){OPTION}?|hline|thickhline"
    rf"|Xhline{_ARGUMENT}|specialrule(?:{_ARGUMENT}){{3}})(?![a-zA-Z])"
)
_RULED = "\x1d"
# What stands between rows, or before the first field of one, and is no part of it.
_BETWEEN = re.compile(
    rf"\\(?:(?:addlinespace|morecmidrules){OPTION}?"
    r"|centering|small|footnotesize|scriptsize|endhead|endfirsthead|endfoot|endlastfoot|nopagebreak"
    rf"|(?:cmidrule|cdashline|cdashlinelr|cline|hhline|noalign|vspace\*?|arrayrulecolor){OPTION}?"
    rf"(?:\([lr{{}}\d.a-z]*\))?{_ARGUMENT}|setlength(?:{_ARGUMENT}){{2}}"
    rf"|row(?:color|style){OPTION}?{_ARGUMENT}{OPTION}*"
    rf"|(?:begin|end)\{{[A-Za-z*]+\}}{OPTION}?|label{_ARGUMENT}|caption{OPTION}?{_ARGUMENT}"
    r")(?![a-zA-Z])"
)
_PARTS = re.compile(r"\\\\\*?(?:\s*\[[^][]*\])?|\\tabularnewline\b|\\.|[{}&]", re.DOTALL)
_SPAN = re.compile(r"\\multi(column|row)(?![a-zA-Z])")
_STAR = re.compile(r"\s*(\*)")
_MOST_NESTED = 4
_MOST_COLUMNS = 200


@dataclass(frozen=True)
class SpannedCell:
    """A field, and how many columns it takes."""

    text: str
    span: int


@dataclass(frozen=True)
class Line:
    """A row of a table, with its line in the file.

    `ruled` is whether a rule from side to side stands above it.
    """

    number: int
    cells: tuple[SpannedCell, ...]
    ruled: bool = False

    @property
    def width(self) -> int:
        """How many columns the row takes."""
        return sum(cell.span for cell in self.cells)


def looks_like_latex(text: str) -> bool:
    """Whether a text holds rows of a LaTeX table."""
    return has_tabulars(text) or any(map(_is_row, text.split("\n")))


def _is_row(line: str) -> bool:
    found = _FIELD_END.search(line)
    return found is not None and r"\\" in line[found.end() :]


def lines_of(
    path: Path, text: str, place: Tabular, macros: Mapping[str, Macro] | None = None
) -> list[Line]:
    """Return the rows of one table.

    Parameters
    ----------
    path : Path
        For messages.
    text : str
        From `text_of`.
    place : Tabular
    macros : mapping of str to Macro, optional
        What the source defines.

    Raises
    ------
    ResultError
        Something that is no row stands among the rows, or a field spans no columns.
    """
    before = text.count("\n", 0, place.start)
    where = f"{path}, line {before + 1}"
    body = expanded(text[place.start : place.end], macros or {}, where)
    # Rules become blanks, so that lines in the text stay the file's.
    body = _RULE.sub(lambda found: _RULED + _blank(found[0]), _flat(body))
    return list(_rows(path, _BETWEEN.sub(lambda found: _blank(found[0]), body), before))


def _blank(text: str) -> str:
    return re.sub(r"[^\n]", " ", text)


def _flat(body: str) -> str:
    """Put a table inside a field onto one line, in braces: it is how authors break lines there."""
    kept: list[str] = []
    at = depth = begun = 0
    for edge in _NESTED.finditer(body):
        begins = edge[1] == "begin"
        begun = edge.start() if begins and depth == 0 else begun
        closes = depth == 1 and not begins
        depth = max(0, depth + (1 if begins else -1))
        if closes:
            inner = body[behind_arguments(body, begun, edge.start()) : edge.start()]
            kept += [body[at:begun], "{", _BROKEN.sub(" ", inner), "}"]
            at = edge.end()
    return "".join(kept) + body[at:]


def _rows(path: Path, body: str, before: int) -> Iterator[Line]:
    depth, at, begun = 0, 0, 0
    number = before + 1
    fields: list[str] = []
    for found in _PARTS.finditer(body):
        sign = found[0]
        depth += {"{": 1, "}": -1}.get(sign, 0)
        ends_row = sign.startswith(("\\\\", r"\tabularnewline"))
        if depth > 0 or not (sign == "&" or ends_row):
            continue
        fields.append(body[at : found.start()])
        at = found.end()
        if ends_row:
            if any(field.strip() for field in fields):
                yield _line(path, number + _lead(body, begun), fields)
            number += body.count("\n", begun, at)
            fields, begun = [], at
    rest = body[at:]
    if fields and rest.strip():
        yield _line(path, number + _lead(body, begun), [*fields, rest])
    elif rest.strip() or fields:
        raise ResultError(
            f"{rest.strip()[:80]!r} is no row of a table",
            where=f"{path}, line {number + body.count(chr(10), begun, at) + _lead(body, at)}",
            expected="rows that end with \\\\, and nothing else than rules between them",
        )


_LEAD = re.compile(r"\s*")


def _lead(body: str, at: int) -> int:
    """How many lines the blanks go on that begin at a place."""
    found = _LEAD.match(body, at)
    return found[0].count("\n") if found else 0


def _line(path: Path, number: int, fields: list[str]) -> Line:
    where = f"{path}, line {number}"
    cells = tuple(_cell(where, field.strip()) for field in fields)
    if (width := sum(cell.span for cell in cells)) > _MOST_COLUMNS:
        raise ResultError(
            f"a row of {width} columns", where=where, expected=f"at most {_MOST_COLUMNS}"
        )
    return Line(number, cells, _RULED in fields[0])


def _cell(where: str, text: str) -> SpannedCell:
    span = 1
    for _ in range(_MOST_NESTED):
        found = _SPAN.match(text)
        if not found:
            break
        arguments, at = _three_arguments(where, text, found.end())
        if found[1] == "column":
            span = _columns(where, arguments[0])
        text = f"{arguments[2]} {text[at:]}".strip()
    return SpannedCell(" ".join(text.split()), span)


def _three_arguments(where: str, text: str, at: int) -> tuple[list[str], int]:
    arguments: list[str] = []
    while len(arguments) < 3:
        option = _OPTION.match(text, at)
        at = option.end() if option else at
        star = _STAR.match(text, at)
        following = star.end() if star else group_end(text, at)
        if following == at:
            raise ResultError(
                f"{text[:80]!r} has not three arguments",
                where=where,
                expected=r"\multicolumn{2}{c}{City} or \multirow{2}{*}{Method}",
            )
        arguments.append(text[at:following].strip().removeprefix("{").removesuffix("}"))
        at = following
    return arguments, at


def _columns(where: str, text: str) -> int:
    if not (text.strip().isascii() and text.strip().isdigit() and 0 < int(text[:9]) <= 1000):
        raise ResultError(f"a field over {text[:20]!r} columns", where=where)
    return int(text)
