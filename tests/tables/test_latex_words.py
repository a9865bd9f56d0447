"""Words of LaTeX tables that could break out of their line, and citation keys."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.tables.annotations import cite
from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.model import Cell, Column, Row, Table
from tests.tables.typeset import document, typeset

BREAK = "one\n\\undefined\r\u2028{\x85%\x0b\\par"
SHOWN = r"one \undefined { % \par"


def table(**parts: object) -> Table:
    columns = (Column("Method"), Column("R@1", "%", True, group="all"))
    made = Table("T", columns, (Row((Cell("mine"), Cell(12.5))),))
    return replace(made, **parts)  # type: ignore[arg-type]


def test_a_comment_stays_one_line() -> None:
    made = table(title=BREAK, notes=(BREAK,))
    lines = latex(made).splitlines()
    assert lines[1:3] == [f"% {SHOWN}"] * 2
    assert not any("undefined" in line for line in lines[3:])


def test_lines_break_nothing_on_a_page(tmp_path: Path) -> None:
    columns = (Column(BREAK), Column(BREAK, "%", True, group=BREAK))
    rows = (Row((Cell(BREAK), Cell(12.5)), reported=BREAK),)
    made = table(title=BREAK, columns=columns, rows=rows, notes=(BREAK,), legend=(BREAK,))
    text = typeset(document(latex(made)), tmp_path)
    assert " ".join(text.split()).count("undefined {") == 6


def test_a_long_title_and_a_long_note(tmp_path: Path) -> None:
    made = table(title="long title " * 5000, notes=("note " * 400,), legend=("note " * 400,))
    text = typeset(document(latex(made)), tmp_path)
    assert "title" not in text
    assert text.count("note") == 400


def test_keys_of_citations(tmp_path: Path) -> None:
    key = "DBLP:conf/cvpr/A_B+c-d.e_"
    made = cite(table(), {"mine": f" {key} ,2nd:x "})
    assert rf"mine~\cite{{{key},2nd:x}} & " in latex(made)
    text = typeset(document(latex(made)), tmp_path)
    # An underscore is a rule, which is no letter.
    assert f"[{key.replace('_', ' ')},2nd:x]" in text


@pytest.mark.parametrize(
    "key", ["a b", "a}", r"\a", "a%", "a#", "a,,b", "", "-a", "a\nb", "é", "a&b"]
)
def test_keys_that_latex_would_not_take(key: str) -> None:
    with pytest.raises(UsageError, match="is no citation key"):
        cite(table(), {"mine": key})
