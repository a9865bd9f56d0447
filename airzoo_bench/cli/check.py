"""``airzoo-bench check``: what is wrong with a prediction file."""

from __future__ import annotations

from typing import Annotated

import typer

from airzoo_bench.cli.common import (
    ImageSizeOption,
    MemoryOption,
    NamesOption,
    ProtocolOption,
    ReaderOption,
    UntrustedOption,
    examples,
    memory_bytes,
    put,
    say,
)
from airzoo_bench.cli.locations import DataOption, predictions_here, resolve_data

EXAMPLES = examples(
    "check preds.npz", "check logs/2026-01-01_12-00-00 --protocol airzoo-mini-retrieval"
)


def check(
    predictions: Annotated[
        str,
        typer.Argument(
            metavar="PREDICTIONS",
            help="A prediction file, folder or archive of any track: a path or a URL.",
        ),
    ],
    protocol: ProtocolOption = None,
    data: DataOption = None,
    reader: ReaderOption = None,
    names: NamesOption = None,
    image_size: ImageSizeOption = None,
    max_memory: MemoryOption = "2G",
    untrusted: UntrustedOption = False,
) -> None:
    """List every error of predictions, their reader, and how many queries they answer.

    Exit code 0: eval would take them; 1: it would refuse them; 2: there is nothing to check, such
    as no file or an unknown protocol.

    Needs no truth. With the benchmark folder, ids are checked and reconstructions are aligned, so
    that every error of eval is found.
    """
    from airzoo_bench.core.sandbox import Limits
    from airzoo_bench.evaluation.evaluate import check as find_errors
    from airzoo_bench.evaluation.opening import ReadBy
    from airzoo_bench.evaluation.track import Run

    memory = memory_bytes(max_memory)
    checked = find_errors(
        predictions_here(predictions),
        data=resolve_data(data),
        protocol=protocol,
        run=Run(memory, limits=Limits(memory) if untrusted else None),
        read_by=ReadBy(reader, names, image_size),
    )
    for line in checked.described:
        (say if checked.errors else _print)(f"{predictions}: {line}")
    for error in checked.errors:
        say(str(error))
    for note in checked.notes:
        say(f"{predictions}: {note}")
    if checked.errors:
        raise typer.Exit(1)
    if checked.notes:
        put(f"{predictions}: nothing that eval refuses was found; see the notes\n")
    else:
        put(f"{predictions}: nothing wrong was found\n")


def _print(line: str) -> None:
    put(f"{line}\n")
