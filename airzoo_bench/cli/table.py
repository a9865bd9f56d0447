"""``airzoo-bench table``: results as a table to print or to put into a paper."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from airzoo_bench.cli.built import option_parameters, parameter, with_parameters
from airzoo_bench.cli.common import show
from airzoo_bench.cli.table_request import TableRequest

PANELS = {
    "Rows and columns": ("layout", "scene", "every", "scores", "published", "floors", "rename"),
    "Values": ("intervals", "decimals", "second", "baseline", "highlight"),
    "Output": ("form", "cite"),
}


def _table(**options: Any) -> None:
    from airzoo_bench.cli.table_making import make_table

    asked = TableRequest(**options)
    show(make_table(asked), asked.form)


_about = "One or more result.json, or their folders: paths or URLs. With --published also names of "
_about += "protocols, for what papers print on them."
_results = Annotated[list[str], typer.Argument(metavar="RESULTS", help=_about)]
table = with_parameters(
    _table,
    [parameter("results", _results), *option_parameters(TableRequest)],
    "Print one result by scene, or several results side by side.",
)
