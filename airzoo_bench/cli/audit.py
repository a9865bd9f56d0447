"""``airzoo-bench audit``: whether the numbers of a published table can be."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, show

__all__ = ["audit"]

_FOUND = 1


class Variant(StrEnum):
    """Which average precision at K is meant."""

    PRECISION = "precision"
    MIN = "min"
    TREC = "trec"
    HITS = "hits"


def audit(
    table: Annotated[
        Path, typer.Argument(help="A CSV file: method, scene, metric, value (docs/audit.md).")
    ],
    form: FormatOption = Format.TERMINAL,
    counts: Annotated[
        list[str] | None,
        typer.Option(
            help="Queries of scenes, as 'scene=n,...' or 'benchmark/scene=n,...', repeatable "
            "(default: what the file says, else what the values imply)."
        ),
    ] = None,
    ap: Annotated[
        Variant | None,
        typer.Option(
            "--ap", help="Which average precision at K is meant (default: what the values imply)."
        ),
    ] = None,
) -> None:
    """Check a published table against arithmetic. Exit code 1 when it contradicts itself.

    Example: airzoo-bench audit table.csv --counts City=161,Rural=190
    """
    from airzoo_bench.audit.audit import audit as audit_published
    from airzoo_bench.audit.findings import audit_table
    from airzoo_bench.audit.published import read_published
    from airzoo_bench.audit.queries import parse_counts

    given = parse_counts(counts or [])
    done = audit_published(read_published(table), given, ap.value if ap else None)
    show(audit_table(done), form)
    if done.failed:
        raise typer.Exit(_FOUND)
