"""``airzoo-bench manifest``: a benchmark folder made by hand gets its checksums."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import examples, put, say

EXAMPLES = examples("manifest mine")


def manifest(
    folder: Annotated[Path, typer.Argument(help="Benchmark folder, with benchmark.toml.")],
    force: Annotated[
        bool, typer.Option("--force", help="Replace checksums that differ from the files.")
    ] = False,
) -> None:
    """Fill in benchmark.toml of a folder made by hand: its checksums, and what else is missing.

    docs/benchmark-folder.md says which files and columns there are.
    """
    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.datasets.handmade import complete_manifest

    written = complete_manifest(folder, replace=force)
    Benchmark.open(folder)
    put(f"{folder}\n")
    for sentence in written:
        say(f"written: {sentence}")
