"""Words of LaTeX tables that could break out of their line, and citation keys."""

from __future__ import annotations

from dataclasses import replace

import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.tables.marks import cite
from airzoo_bench.tables.model import Cell, Column, Row, Table


def table(**parts: object) -> Table:
    columns = (Column("Method"), Column("R@1", "%", True, group="all"))
    made = Table("T", columns, (Row((Cell("mine"), Cell(12.5))),))
    return replace(made, **parts)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "key", ["a b", "a}", r"\a", "a%", "a#", "a,,b", "", "-a", "a\nb", "é", "a&b"]
)
def test_keys_that_latex_would_not_take(key: str) -> None:
    with pytest.raises(UsageError, match="is no citation key"):
        cite(table(), {"mine": key})
