"""``airzoo-bench readers``: whose files can be scored as they are."""

from __future__ import annotations

from typing import Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, examples, put, show

EXAMPLES = examples(
    "readers vpr", "eval retrieval logs/2026-01-01_12-00-00 --protocol uav-visloc-retrieval"
)


def readers(
    name: Annotated[
        str | None, typer.Argument(help="Say all of this reader.", show_default=False)
    ] = None,
    form: FormatOption = Format.TERMINAL,
) -> None:
    """List what reads files as methods write them."""
    from airzoo_bench.core.registry import READERS
    from airzoo_bench.evaluation.reader import reader_named
    from airzoo_bench.tables.model import Cell, Column, Row, Table

    if name is not None:
        one = reader_named(name)
        put(f"{one.title}, predictions of the {one.track} track\n")
        put(f"written by: {', '.join(one.methods)}\n" * bool(one.methods))
        put(f"recognised by: {one.layout}\n")
        return
    found = {name: READERS.get(name) for name in READERS.names()}
    titles: tuple[str, ...] = ("Reader", "Track", "Reads")
    values: list[tuple[str, ...]] = [(name, one.track, one.title) for name, one in found.items()]
    if form is not Format.TERMINAL:
        titles += ("Written by", "Recognised by")
        values = [
            (*row, ", ".join(one.methods), one.layout)
            for row, one in zip(values, found.values(), strict=True)
        ]
    rows = tuple(Row(tuple(map(Cell, row))) for row in values)
    show(Table("Readers", tuple(map(Column, titles)), rows), form)
