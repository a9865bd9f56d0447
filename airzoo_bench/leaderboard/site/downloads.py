"""What can be downloaded beside the pages: tables in four formats, BibTeX."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from airzoo_bench.leaderboard.site.api import Row, Score, ScoreColumn, TableFile
from airzoo_bench.leaderboard.submission import PublicSubmission
from airzoo_bench.tables.marks import mark_best
from airzoo_bench.tables.model import Between, Cell, Column, Table, share_to_percent
from airzoo_bench.tables.model import Row as TableRow
from airzoo_bench.tables.render import render

__all__ = ["bibtex", "downloads"]

_FORMATS = {"csv": "csv", "json": "json", "tex": "latex", "md": "markdown"}
_UNITS = {"share": "%", "m": "m", "deg": "deg"}
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
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "#": r"\#",
    "$": r"\$",
    "%": r"\%",
    "&": r"\&",
    "_": r"\_",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    '"': "''",
    "@": r"{@}",
}


def downloads(table: TableFile) -> dict[str, bytes]:
    """Render a table's averages over scenes, with rank ranges, in every format."""
    scores = [score for score in table.scores if score.headline]
    ranked = any(row.scores[key].rank for row in table.rows for key in row.scores)
    columns = [Column("Method")]
    for score in scores:
        columns.append(Column(score.title, _UNITS[score.unit], score.higher_is_better))
        columns += [Column(f"Rank by {score.title}")] * ranked
    times = Counter(row.method.casefold() for row in table.rows if row.team)
    laid_out = Table(
        f"{table.title}, average over scenes",
        tuple(columns),
        tuple(
            _row(row, scores, ranked=ranked, team=times[row.method.casefold()] > 1)
            for row in table.rows
        ),
        tuple(filter(None, (table.apart, *table.notes, table.about_intervals, table.about_ranks))),
    )
    made = mark_best(laid_out)
    return {
        f"downloads/{table.id}.{end}": render(made, form).encode() for end, form in _FORMATS.items()
    }


def _row(row: Row, scores: Sequence[ScoreColumn], *, ranked: bool, team: bool) -> TableRow:
    cells = [Cell(f"{row.method} ({row.team})" if team and row.team else row.method)]
    for score in scores:
        found = row.scores.get(score.key)
        cells.append(_cell(score, found))
        if ranked:
            rank = None if found is None or found.rank is None else found.rank
            cells.append(Cell(None if rank is None else " to ".join(map(str, rank))))
    floor = row.kind == "floor"
    reported = row.source if row.kind == "reported" else ""
    return TableRow(tuple(cells), summary=floor, reported=reported, floor=floor)


def _cell(column: ScoreColumn, score: Score | None) -> Cell:
    def shown(value: object) -> float:
        number = float(str(value))
        return share_to_percent(number) if column.unit == "share" else number

    if score is None or score.value is None:
        return Cell(None)
    if score.low is None or score.high is None:
        return Cell(shown(score.value))
    return Cell(shown(score.value), uncertainty=Between(shown(score.low), shown(score.high)))


def bibtex(row: Row, given: PublicSubmission | None, board: str) -> str:
    """Return a BibTeX entry: the authors' own, or one made of what is known."""
    if given is not None and given.bibtex is not None and _is_one_entry(given.bibtex):
        return given.bibtex.strip() + "\n"
    names = " and ".join(f"{{{_escaped(name)}}}" for name in row.authors)
    fields = {
        "title": f"{{{_escaped(row.method)}}}",
        "author": names,
        "year": (row.date or "")[:4],
        "howpublished": _url(row.paper or row.code),
        "note": _escaped(f"{row.source or row.team}; {board}".strip("; ")),
    }
    lines = [f"  {key} = {{{value}}}" for key, value in fields.items() if value]
    return f"@misc{{{row.id},\n" + ",\n".join(lines) + "\n}\n"


def _is_one_entry(text: str) -> bool:
    """Whether it is the entry of a work, braces close where it ends, and no command acts."""
    depth = 0
    for place, letter in enumerate(text.strip()):
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if depth < 0 or (depth == 0 and "{" in text[: place + 1] and place < len(text.strip()) - 1):
            return False
    harmless = all(map(_HARMLESS.fullmatch, _COMMAND.findall(text)))
    caret = "^^" in text  # TeX reads ^^5c as a backslash
    return depth == 0 and harmless and not caret and _WORK.match(text) is not None


def _escaped(text: str) -> str:
    return "".join(_TEX.get(letter, letter) for letter in text if letter.isprintable())


def _url(url: str | None) -> str:
    return "" if url is None else "\\url{" + _NOT_IN_URL.sub("", url) + "}"
