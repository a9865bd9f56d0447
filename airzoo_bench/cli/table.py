"""``airzoo-bench table``: results as a table to print or to put into a paper."""

from __future__ import annotations

from typing import Any

from airzoo_bench.cli.built import field_parameters, with_parameters
from airzoo_bench.cli.common import examples, show
from airzoo_bench.cli.table_request import TableRequest

EXAMPLES = examples(
    "table results/*/result.json --format latex",
    "table */result.json --layout scenes --published -f latex",
    "table uav-visloc-retrieval --published --layout scenes",
)
PANELS = {
    "Rows and columns": ("layout", "scene", "every", "scores", "published", "floors", "rename"),
    "Values": ("intervals", "decimals", "second", "baseline", "highlight"),
    "Output": ("form", "cite"),
}


def _table(**options: Any) -> None:
    from airzoo_bench.cli.table_making import make_table

    asked = TableRequest(**options)
    show(make_table(asked), asked.form)


table = with_parameters(
    _table,
    field_parameters(TableRequest),
    "Print one result by scene, or several side by side by method.",
)
