"""``airzoo-bench protocols``: what can be measured."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import (
    DataOption,
    Format,
    FormatOption,
    examples,
    put,
    resolve_data,
    show,
)

__all__ = ["EXAMPLES", "protocols"]

EXAMPLES = examples("protocols uav-visloc-retrieval")


def protocols(
    name: Annotated[
        str | None, typer.Argument(help="Print this protocol's file.", show_default=False)
    ] = None,
    data: DataOption = None,
    form: FormatOption = Format.TERMINAL,
) -> None:
    """List the protocols that are shipped or stand in prepared benchmark folders."""
    from airzoo_bench.protocol.lookup import find_protocol, load_protocol, protocol_files
    from airzoo_bench.tables.model import Cell, Column, Row, Table

    folder = resolve_data(data)
    if name is not None:
        find_protocol(name, folder)
        path = Path(name) if name.endswith(".toml") else protocol_files(folder)[name]
        put(path.read_text(encoding="utf-8"))
        return
    loaded = {key: load_protocol(path) for key, path in protocol_files(folder).items()}
    rows = tuple(
        Row(
            (
                Cell(key),
                Cell(protocol.version),
                Cell(protocol.track),
                Cell(len(protocol.scenes)),
                Cell(protocol.fingerprint[:12]),
                Cell(protocol.title),
            )
        )
        for key, protocol in loaded.items()
    )
    heads = ("Protocol", "Version", "Track", "Scenes", "Fingerprint", "Title")
    show(Table("Protocols", tuple(map(Column, heads)), rows), form)
