"""Files made to take long: what is read in time that grows with the square would never end."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest

from airzoo_bench.audit.audit import audit
from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.printed.latex import looks_like_latex
from airzoo_bench.tables.printed.latex_source import without_macro
from airzoo_bench.tables.printed.table import read_published
from tests.tables.printed.hostile import FILES

MANY = 200_000


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a & b \\\\", True),
        ("a \\& b \\\\", False),
        ("a & b", False),
        ("a \\\\ & b", False),
        ("a,b\n1,2\nx & y \\\\ \\hline", True),
        ("&" * MANY, False),
    ],
)
def test_rows_of_latex(text: str, found: bool) -> None:
    assert looks_like_latex(text) is found


def test_a_macro_is_taken_out_wherever_it_stands() -> None:
    assert without_macro("a\\phantom{b{c}}d\\phantom{}e\\phantoms{f}", "phantom") == (
        "ade\\phantoms{f}"
    )
    assert without_macro("\\phantom{0}1" * MANY, "phantom") == "1" * MANY


def test_rules_that_never_close(tmp_path: Path) -> None:
    path = tmp_path / "open.tex"
    path.write_text("\\begin{tabular}{l}\n" + "\\cmidrule[" * MANY + "\n\\end{tabular}")
    with pytest.raises(ResultError):
        read_published(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_files_made_to_take_long(tmp_path: Path, name: str) -> None:
    """Each takes seconds; in time that grows with the square it would take hours."""
    path = tmp_path / name
    path.write_text(FILES[name](), encoding="utf-8")
    with suppress(ResultError):
        audit(read_published(path))


def test_macros_that_make_macros_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.tex"
    path.write_text(FILES["macros that make macros.tex"]())
    with pytest.raises(ResultError, match="makes too much text"):
        read_published(path)
