"""``airzoo-bench seal-folder``: a benchmark folder made by hand gets its checksums."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import examples, put, say

__all__ = ["EXAMPLES", "seal_folder"]

EXAMPLES = examples("seal-folder mine")


def seal_folder(
    folder: Annotated[Path, typer.Argument(help="Benchmark folder, with benchmark.toml.")],
    force: Annotated[
        bool, typer.Option("--force", help="Replace checksums that differ from the files.")
    ] = False,
) -> None:
    """Write the checksums, and what else is missing, of a benchmark folder made by hand.

    docs/benchmark-folder.md says which files and columns there are.
    """
    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.datasets.sealing import seal_folder as seal

    written = seal(folder, replace=force)
    Benchmark.open(folder)
    put(f"{folder}\n")
    for sentence in written:
        say(f"written: {sentence}")
