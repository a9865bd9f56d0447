"""``airzoo-bench audit``: whether the numbers of a published table can be."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, examples, put, show

if TYPE_CHECKING:
    from airzoo_bench.audit.findings import Audit

__all__ = ["EXAMPLES", "audit"]

EXAMPLES = examples(
    "audit table.csv",
    "audit table.csv --counts City=161,Rural=190 --format markdown",
)

_FOUND = 1


def audit(
    table: Annotated[
        Path,
        typer.Argument(
            help="CSV, a line a number: the columns method, scene, metric, value, and any of "
            "table, benchmark, track, unit, n, bold, gain."
        ),
    ],
    form: FormatOption = Format.TERMINAL,
    counts: Annotated[
        list[str] | None,
        typer.Option(
            help="Queries of scenes, as 'scene=n,...' or 'benchmark/scene=n,...', repeatable "
            "(default: what the file says, else what the values imply)."
        ),
    ] = None,
) -> None:
    """Check a published table against arithmetic. Exit code 1 when it contradicts itself.

    Numbers as they are typed off a page: the first line 'method,scene,metric,value', then a line a
    number, such as 'X,City,R@1,8.70'. Keep trailing zeros. See docs/audit.md.
    """
    from airzoo_bench.audit.audit import audit as audit_published
    from airzoo_bench.audit.counts import parse_counts
    from airzoo_bench.tables.published import read_published

    given = parse_counts(counts or [])
    done = audit_published(read_published(table), given)
    _show(done, form)
    if done.failed:
        raise typer.Exit(_FOUND)


def _show(done: Audit, form: Format) -> None:
    from airzoo_bench.audit.findings import audit_table, audit_text

    if form is Format.TERMINAL:
        width = shutil.get_terminal_size((80, 24)).columns
        put(audit_text(done, width, styled=sys.stdout.isatty()))
    else:
        show(audit_table(done), form)
