"""Words of LaTeX tables that could break out of their line, and citation keys."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.marks import cite
from airzoo_bench.tables.model import Cell, Column, Row, Table
from tests.tables.typeset import document, typeset

BREAK = "one\n\\undefined\r\u2028{\x85%\x0b\\par"
SHOWN = r"one \undefined { % \par"


def table(**parts: object) -> Table:
    columns = (Column("Method"), Column("R@1", "%", True, group="all"))
    made = Table("T", columns, (Row((Cell("mine"), Cell(12.5))),))
    return replace(made, **parts)  # type: ignore[arg-type]


def test_a_long_title_and_a_long_note(tmp_path: Path) -> None:
    made = table(title="long title " * 5000, notes=("note " * 400,), legend=("note " * 400,))
    text = typeset(document(latex(made)), tmp_path)
    assert "title" not in text
    assert text.count("note") == 400


@pytest.mark.parametrize(
    "key", ["a b", "a}", r"\a", "a%", "a#", "a,,b", "", "-a", "a\nb", "é", "a&b"]
)
def test_keys_that_latex_would_not_take(key: str) -> None:
    with pytest.raises(UsageError, match="is no citation key"):
        cite(table(), {"mine": key})
