"""A LaTeX source before its tables are read: what is no text is blanked, macros are expanded."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from airzoo_bench.core.errors import ResultError

__all__ = ["OPTION", "Macro", "expanded", "group_end", "macros_of", "text_of", "without_macro"]

# An option ends at the next bracket of either kind: a file of open ones is read in linear time.
OPTION = r"(?:\s*\[[^][]*\])"
_OPTION = re.compile(OPTION)
_GROUP = re.compile(r"\s*\{")
_SIGN = re.compile(r"\\.|[{}]", re.DOTALL)
# A percent sign behind two backslashes begins a comment: they end the row before it.
_COMMENT = re.compile(r"(?<!\\)((?:\\\\)*)%.*")
_UNREAD = re.compile(
    r"\\begin\{(comment|verbatim\*?|lstlisting|filecontents\*?)\}|\\iffalse(?![A-Za-z])"
)
_DOCUMENT_END = r"\end{document}"
_DEFINITION = re.compile(
    r"\\(?:(?:(?:re)?newcommand|providecommand|DeclareRobustCommand)\*?\s*(?:\{\s*)?"
    rf"\\([A-Za-z@]+)(?:\s*\}})?(?:\s*\[([0-9])\])?({OPTION}?)"
    r"|[gex]?def\s*\\([A-Za-z@]+)((?:#[0-9])*))(?=\s*\{)"
)
_CALL = re.compile(r"\\([A-Za-z@]+)")
_ARGUMENT = re.compile(r"#([1-9])")
_DEEPEST = 10
_LONGEST = 4 << 20


@dataclass(frozen=True)
class Macro:
    """A command that the source defines: how many arguments it takes, and what it stands for.

    `default` is that of an optional first argument; None where it has none.
    """

    arguments: int
    default: str | None
    body: str


def text_of(source: str) -> str:
    """Blank comments and what is not typeset; lines stay where they are."""
    text = "\n".join(_COMMENT.sub(r"\1", line) for line in source.split("\n"))
    end = text.find(_DOCUMENT_END)
    text = text if end < 0 else text[:end]
    return "".join(_typeset(text))


def _typeset(text: str) -> Iterator[str]:
    at = 0
    while found := _UNREAD.search(text, at):
        yield text[at : found.start()]
        closing = rf"\end{{{found[1]}}}" if found[1] else r"\fi"
        end = text.find(closing, found.end())
        at = len(text) if end < 0 else end + len(closing)
        yield "\n" * text.count("\n", found.start(), at)
    yield text[at:]


def group_end(text: str, at: int, end: int | None = None) -> int:
    """Return the place behind the group in braces that begins there, or the place itself.

    A group that does not close before `end`, or in the text, ends with it.
    """
    end = len(text) if end is None else end
    begin = _GROUP.match(text, at, end)
    if not begin:
        return at
    depth = 0
    for found in _SIGN.finditer(text, begin.end() - 1, end):
        depth += {"{": 1, "}": -1}.get(found[0], 0)
        if depth == 0:
            return found.end()
    return end


def without_macro(text: str, name: str) -> str:
    r"""Remove a macro with its argument, whatever is nested in it, such as ``\phantom{..}``."""
    start = re.compile(rf"\\{name}(?![a-zA-Z])")
    kept, at = [], 0
    while found := start.search(text, at):
        kept.append(text[at : found.start()])
        at = group_end(text, found.end())
    return "".join(kept) + text[at:]


def macros_of(text: str) -> dict[str, Macro]:
    r"""Return the commands that a source defines by ``\newcommand``, ``\def`` and their kin.

    The last definition of a name counts, wherever it stands.
    """
    macros: dict[str, Macro] = {}
    at = 0
    while found := _DEFINITION.search(text, at):
        at = group_end(text, found.end())
        body = _inside(text[found.end() : at])
        default = found[3].strip()[1:-1] if found[3] else None
        count = len(found[5]) // 2 if found[4] else int(found[2] or 0)
        macros[found[1] or found[4]] = Macro(count, default, " ".join(body.split()))
    return macros


def _inside(group: str) -> str:
    return group.strip().removeprefix("{").removesuffix("}")


def expanded(text: str, macros: Mapping[str, Macro], where: str) -> str:
    """Replace the macros of a text, level by level; its lines stay where they are.

    Raises
    ------
    ResultError
        They make more text than a table can hold.
    """
    for _ in range(_DEEPEST):
        longer = "".join(_one_level(text, macros, where))
        if longer == text:
            break
        text = longer
    return text


def _one_level(text: str, macros: Mapping[str, Macro], where: str) -> Iterator[str]:
    at = length = 0
    for found in _CALL.finditer(text):
        macro = macros.get(found[1])
        if macro is None or found.start() < at:
            continue
        values, end = _arguments(text, found.end(), macro)
        length += found.start() - at + _length(macro, values)
        if length > _LONGEST:
            raise ResultError(
                f"the macro {found[0][:40]!r} makes too much text",
                where=where,
                expected=f"a table of at most {_LONGEST >> 20} MB",
            )
        made = _filled(macro, values).replace("\n", " ")
        yield text[at : found.start()] + made + "\n" * text.count("\n", found.start(), end)
        at = end
    yield text[at:]


def _length(macro: Macro, values: Mapping[str, str]) -> int:
    return len(macro.body) + sum(len(v) * macro.body.count(f"#{k}") for k, v in values.items())


def _filled(macro: Macro, values: Mapping[str, str]) -> str:
    return _ARGUMENT.sub(lambda sign: values.get(sign[1], ""), macro.body)


def _arguments(text: str, at: int, macro: Macro) -> tuple[dict[str, str], int]:
    """Return a macro's arguments by their numbers, and where they end."""
    values: dict[str, str] = {}
    if macro.default is not None:
        option = _OPTION.match(text, at)
        values["1"] = option[0].strip()[1:-1] if option else macro.default
        at = option.end() if option else at
    for number in range(len(values) + 1, macro.arguments + 1):
        end = group_end(text, at)
        if end == at:
            token = re.compile(r"\s*(\\[A-Za-z@]+|\\?[^\s\\{}&])").match(text, at)
            end = token.end() if token else at
        values[str(number)] = _inside(text[at:end])
        at = end
    return values, at
