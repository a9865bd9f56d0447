"""Downloads beside board.json: a CSV file a table, and BibTeX."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from typing import Any

__all__ = ["bibtex", "table_csv"]

_FACTS = ("id", "kind", "method", "team", "source", "reason", "date", "rescored", "code", "paper")
_PARTS = ("value", "low", "high", "standard_error")
_NOT_IN_URL = re.compile(r"[{}\\%#]")
_WORK = re.compile(
    r"\s*@(article|book|booklet|conference|dataset|in(book|collection|proceedings)|manual|misc|"
    r"online|patent|proceedings|report|software|techreport|(masters|phd)?thesis|unpublished)\b",
    re.IGNORECASE,
)
_COMMAND = re.compile(r"\\([A-Za-z@]+|.|\Z)", re.DOTALL)
# Accents, letters, escaped signs, and what only changes how text looks.
_HARMLESS = re.compile(
    r"""["'`^\\~=.&%$#_{} ,-]|[bcdHijklLoOrtuv]|ae|AE|oe|OE|aa|AA|ss|dh|DH|th|TH|dj|DJ|ng|NG"""
    r"|emph|em|it|bf|tt|sc|text(it|bf|tt|sc|superscript|subscript|endash|emdash|asciitilde)"
    r"|math(cal|rm|bb|bf|it)|url|href|l?dots|pi|alpha|beta|[gG]amma|[dD]elta|[lL]ambda|[sS]igma"
)
_TEX = {
    **{"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"},
    **{letter: f"\\{letter}" for letter in "{}#$%&_"},
    **{'"': "''", "@": "{@}"},
}


def table_csv(table: Mapping[str, Any]) -> str:
    """Return the averages over scenes of a table, a line a row, numbers as in board.json."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    keys = [column["key"] for column in table["scores"]]
    ends = (*_PARTS, "rank_first", "rank_last")
    writer.writerow([*_FACTS, *(f"{key} {end}" for key in keys for end in ends)])
    for row in table["rows"]:
        cells = [_plain(row[name]) for name in _FACTS]
        for key in keys:
            score = row["scores"].get(key, {})
            cells += [score.get(name) for name in _PARTS]
            cells += score.get("rank") or (None, None)
        writer.writerow(["" if cell is None else cell for cell in cells])
    return out.getvalue()


def _plain(text: str | None) -> str | None:
    """Return a text that no spreadsheet takes for a formula."""
    return f"'{text}" if text and text[0] in "=+-@" else text


def bibtex(row: Mapping[str, Any], board: str) -> str:
    """Return a BibTeX entry: the authors' own if it is valid, else one from the metadata."""
    own: str = row["bibtex"]
    if own and _is_one_entry(own.strip()):
        return own.strip() + "\n"
    fields = {
        "title": f"{{{_escaped(row['method'])}}}",
        "author": " and ".join(f"{{{_escaped(name)}}}" for name in row["authors"]),
        "year": (row["date"] or "")[:4],
        "howpublished": _url(row["paper"] or row["code"]),
        "note": _escaped(f"{row['source'] or row['team']}; {board}".strip("; ")),
    }
    lines = [f"  {key} = {{{value}}}" for key, value in fields.items() if value]
    return f"@misc{{{row['id']},\n" + ",\n".join(lines) + "\n}\n"


def _is_one_entry(text: str) -> bool:
    """Whether it is the entry of a work, braces close where it ends, and no command acts."""
    depth = 0
    for place, letter in enumerate(text):
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if depth < 0 or (depth == 0 and "{" in text[: place + 1] and place < len(text) - 1):
            return False
    harmless = all(map(_HARMLESS.fullmatch, _COMMAND.findall(text)))
    caret = "^^" in text  # TeX reads ^^5c as a backslash
    return depth == 0 and harmless and not caret and _WORK.match(text) is not None


def _escaped(text: str) -> str:
    return "".join(_TEX.get(letter, letter) for letter in text if letter.isprintable())


def _url(url: str | None) -> str:
    return "" if url is None else "\\url{" + _NOT_IN_URL.sub("", url) + "}"
