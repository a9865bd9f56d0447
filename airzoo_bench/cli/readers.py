"""``airzoo-bench readers``: whose files can be scored as they are."""

from __future__ import annotations

from airzoo_bench.cli.common import Format, FormatOption, examples, show

__all__ = ["EXAMPLES", "readers"]

EXAMPLES = examples(
    "readers", "eval retrieval logs/2026-01-01_12-00-00 --protocol uav-visloc-retrieval"
)


def readers(form: FormatOption = Format.TERMINAL) -> None:
    """List what reads files as methods write them."""
    from airzoo_bench.core.registry import READERS
    from airzoo_bench.tables.model import Cell, Column, Row, Table

    found = {name: READERS.get(name) for name in READERS.names()}
    rows = tuple(
        Row(tuple(map(Cell, (name, one.track, one.title, ", ".join(one.methods), one.layout))))
        for name, one in found.items()
    )
    titles = ("Reader", "Track", "Reads", "Written by", "Recognised by")
    show(Table("Readers", tuple(map(Column, titles)), rows), form)
