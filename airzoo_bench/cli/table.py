"""``airzoo-bench table``: results as a table to print or to put into a paper."""

from __future__ import annotations

from typing import Any

from airzoo_bench.cli.built import field_parameters, with_parameters
from airzoo_bench.cli.common import Format, examples, show
from airzoo_bench.cli.table_request import TableRequest
from airzoo_bench.core.errors import UsageError, agreeing

__all__ = ["EXAMPLES", "PANELS", "table"]

EXAMPLES = examples(
    "table results/*/result.json --format latex",
    "table */result.json --layout scenes --published -f latex --fit",
    "table --published --protocol uav-visloc-retrieval --layout scenes",
)
PANELS = {
    "Rows and columns": (
        *("layout", "scene", "every_score", "scores", "sort", "highlight", "floors", "rename"),
        *("queries", "average"),
    ),
    "Statistics": ("intervals", "second", "baseline"),
    "Published numbers": ("published", "protocol"),
    "Output": ("form", "decimals"),
    "LaTeX": ("cite", "fit"),
}


def _table(**options: Any) -> None:
    from airzoo_bench.cli.table_making import make_table

    asked = TableRequest(**options)
    odd = [name for name, given in (("--fit", asked.fit), ("--cite", asked.cite)) if given]
    if odd and asked.form is not Format.LATEX:
        are = agreeing(len(odd), "is", "are")
        raise UsageError(f"{' and '.join(odd)} {are} for LaTeX", fix="add --format latex")
    show(make_table(asked), asked.form, fit=asked.fit)


table = with_parameters(
    _table,
    field_parameters(TableRequest),
    "Print one result by scene, or several side by side by method.",
)
