"""LaTeX tables as rows of cells: environments, rules, and fields that span several columns."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.errors import ResultError

__all__ = ["Line", "SpannedCell", "latex_tables", "looks_like_latex", "without_macro"]

_TABULARS = r"tabular[*xy]?|longtable|longtabu|tabu|array"
_BEGIN = re.compile(rf"\\begin\{{({_TABULARS})\}}")
_EDGE = re.compile(rf"\\(begin|end)\{{(?:{_TABULARS})\}}")
_LABEL = re.compile(r"\\label\{([^}]*)\}")
_FLOAT = re.compile(r"\\end\{(?:table|wraptable|longtable)\*?\}")
_COMMENT = re.compile(r"(?<!\\)%.*")
_FIELD_END = re.compile(r"(?<!\\)&")
# An option ends at the next bracket of either kind: a file of open ones is read in linear time.
_OPTION, _ARGUMENT = r"(?:\s*\[[^][]*\])", r"\s*\{[^{}]*\}"
# What stands between rows, or before the first field of one, and is no part of it.
_RULES = re.compile(
    rf"\\(?:(?:toprule|midrule|bottomrule|addlinespace|morecmidrules){_OPTION}?"
    r"|hline|centering|small|footnotesize|scriptsize|endhead|endfirsthead|endfoot|endlastfoot"
    rf"|(?:cmidrule|cdashline|cline|hhline|noalign|Xhline|vspace\*?|arrayrulecolor){_OPTION}?"
    rf"(?:\([lr{{}}\d.a-z]*\))?{_ARGUMENT}|specialrule(?:{_ARGUMENT}){{3}}"
    rf"|row(?:color|style){_OPTION}?{_ARGUMENT}{_OPTION}*"
    rf"|(?:begin|end)\{{[a-z*]+\}}{_OPTION}?|label{_ARGUMENT})(?![a-zA-Z])"
)


@dataclass(frozen=True)
class SpannedCell:
    """A field, and how many columns it takes."""

    text: str
    span: int


@dataclass(frozen=True)
class Line:
    """A row of a table, with its line in the file."""

    number: int
    cells: tuple[SpannedCell, ...]

    @property
    def width(self) -> int:
        """How many columns the row takes."""
        return sum(cell.span for cell in self.cells)


def looks_like_latex(text: str) -> bool:
    """Whether a text holds rows of a LaTeX table."""
    return bool(_BEGIN.search(text)) or any(map(_is_row, text.split("\n")))


def _is_row(line: str) -> bool:
    found = _FIELD_END.search(line)
    return found is not None and r"\\" in line[found.end() :]


def latex_tables(path: Path, text: str) -> list[tuple[str, list[Line]]]:
    """Return the label (empty without one) and the rows of each table of a LaTeX source.

    Raises
    ------
    ResultError
        Something that is no row stands among the rows.
    """
    plain = "\n".join(_COMMENT.sub("", line) for line in text.split("\n"))
    bodies = list(_bodies(plain))
    if not bodies:
        return [("", list(_lines(path, plain, 0, len(plain))))]
    return [(_label(plain, at, end), list(_lines(path, plain, at, end))) for at, end in bodies]


def _bodies(text: str) -> Iterator[tuple[int, int]]:
    """Yield where the outermost tabulars begin and end, without their column types."""
    end = 0
    while found := _BEGIN.search(text, end):
        start = _behind_arguments(text, found)
        close = end = len(text)
        depth = 1
        for edge in _EDGE.finditer(text, found.end()):
            depth += 1 if edge[1] == "begin" else -1
            if depth == 0:
                close, end = edge.start(), edge.end()
                break
        yield start, close


def _behind_arguments(text: str, found: re.Match[str]) -> int:
    at = found.end()
    for _ in range(2 if found[1][-1] in "*xy" else 1):
        option = re.compile(_OPTION).match(text, at)
        at = option.end() if option else at
        at = _group_end(text, at)
    return at


def _label(text: str, start: int, end: int) -> str:
    """Return the label inside a table, or of the float around it."""
    closed = _FLOAT.search(text, end)
    last = closed.start() if closed else len(text)
    opened = text.rfind(r"\begin{table", 0, start)
    labels = _LABEL.findall(text, max(opened, 0), last)
    following = _BEGIN.search(text, end)
    is_alone = following is None or following.start() > last
    return labels[0] if labels and is_alone else ""


def _group_end(text: str, at: int) -> int:
    """Return the place behind the group in braces that begins there, or the place itself."""
    begin = re.compile(r"\s*\{").match(text, at)
    if not begin:
        return at
    depth = 0
    for found in re.compile(r"\\.|[{}]", re.DOTALL).finditer(text, begin.end() - 1):
        depth += {"{": 1, "}": -1}.get(found[0], 0)
        if depth == 0:
            return found.end()
    return len(text)


def without_macro(text: str, name: str) -> str:
    r"""Remove a macro with its argument, whatever is nested in it, such as ``\phantom{..}``."""
    start = re.compile(rf"\\{name}(?![a-zA-Z])")
    kept, at = [], 0
    while found := start.search(text, at):
        kept.append(text[at : found.start()])
        at = _group_end(text, found.end())
    return "".join(kept) + text[at:]


def _lines(path: Path, text: str, start: int, end: int) -> Iterator[Line]:
    # Rules become blanks, so that places in the text stay the file's.
    body = _RULES.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text[start:end])
    before = text.count("\n", 0, start)
    depth, at, fields = 0, 0, []
    parts = re.compile(r"\\\\\*?(?:\s*\[[^][]*\])?|\\tabularnewline\b|\\.|[{}&]", re.DOTALL)
    begun = 0
    for found in parts.finditer(body):
        sign = found[0]
        depth += {"{": 1, "}": -1}.get(sign, 0)
        ends_row = sign.startswith(("\\\\", r"\tabularnewline"))
        if depth > 0 or not (sign == "&" or ends_row):
            continue
        fields.append(body[at : found.start()])
        at = found.end()
        if ends_row:
            if any(field.strip() for field in fields):
                yield _line(path, body, begun, before, fields)
            fields, begun = [], at
    rest = body[at:]
    if fields and rest.strip():
        yield _line(path, body, begun, before, [*fields, rest])
    elif rest.strip() or fields:
        raise ResultError(
            f"{rest.strip()[:80]!r} is no row of a table",
            where=f"{path}, line {_number(body, at, before)}",
            expected="rows that end with \\\\, and nothing else than rules between them",
        )


def _number(body: str, at: int, before: int) -> int:
    blank = len(body[at:]) - len(body[at:].lstrip())
    return before + 1 + body.count("\n", 0, at + blank)


def _line(path: Path, body: str, at: int, before: int, fields: list[str]) -> Line:
    number = _number(body, at, before)
    return Line(number, tuple(_cell(f"{path}, line {number}", field.strip()) for field in fields))


def _cell(where: str, text: str) -> SpannedCell:
    span = 1
    while found := re.match(r"\\multi(column|row)(?![a-zA-Z])", text):
        at = found.end()
        arguments: list[str] = []
        while len(arguments) < 3:
            option = re.compile(_OPTION).match(text, at)
            at = option.end() if option else at
            star = re.compile(r"\s*(\*)").match(text, at)
            following = star.end() if star else _group_end(text, at)
            if following == at:
                raise ResultError(
                    f"{text[:80]!r} has not three arguments",
                    where=where,
                    expected=r"\multicolumn{2}{c}{City} or \multirow{2}{*}{Method}",
                )
            arguments.append(text[at:following].strip().removeprefix("{").removesuffix("}"))
            at = following
        if found[1] == "column":
            if not (arguments[0].strip().isdigit() and 0 < int(arguments[0]) <= 1000):
                raise ResultError(f"a field over {arguments[0][:20]!r} columns", where=where)
            span = int(arguments[0])
        text = f"{arguments[2]} {text[at:]}".strip()
    return SpannedCell(" ".join(text.split()), span)
