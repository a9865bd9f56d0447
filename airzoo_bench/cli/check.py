"""``airzoo-bench check``: what is wrong with a prediction file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import (
    DataOption,
    MemoryOption,
    ProtocolOption,
    memory_bytes,
    put,
    resolve_data,
    say,
)

__all__ = ["check"]


def check(
    predictions: Annotated[Path, typer.Argument(help="A prediction file of any track.")],
    protocol: ProtocolOption = None,
    data: DataOption = None,
    max_memory: MemoryOption = "2G",
) -> None:
    """Say what is wrong with a prediction file; needs no truth. Exit code 1 if anything is."""
    from airzoo_bench.runner.checks import check_predictions

    found = check_predictions(
        predictions,
        data=resolve_data(data),
        protocol=protocol,
        memory_bytes=memory_bytes(max_memory),
    )
    for fault in found:
        say(str(fault))
    if found:
        raise typer.Exit(1)
    put(f"{predictions}: nothing wrong was found\n")
