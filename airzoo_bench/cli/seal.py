"""``airzoo-bench seal``: the truth of a benchmark stays with its host."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import progress, put, say
from airzoo_bench.core.errors import counted
from airzoo_bench.leaderboard import sealing


def seal(
    folder: Annotated[Path, typer.Argument(help="Benchmark folder, with all its data in it.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The public folder to write.")],
    archive: Annotated[Path, typer.Option("--archive", help="The archive of the truth.")],
    to: Annotated[str, typer.Option("--to", help="The host's public key, age1...")],
    force: Annotated[bool, typer.Option("--force", help="Replace what is there.")] = False,
) -> None:
    """Split a benchmark folder into a public one without the truth, and an archive with it.

    Methods get photos without metadata, cameras, priors, tiles, crops and maps;
    docs/leaderboard.md says what else to consider.

    Example: airzoo-bench seal mine --out public/mine --archive public/mine.age --to age1...
    """
    to_key = sealing.recipient(to)
    committed, counts = sealing.seal(folder, out, archive, to_key, replace=force, progress=progress)
    put(f"{out}\n{archive}\n")
    say(
        f"{counted(counts['public'], 'file')} public, {counts['sealed']:,} in the archive, "
        f"{counted(counts['cut'], 'photo')} freed of metadata"
    )
    say(f"commitment {committed}")
    say(f"publish {out}; {archive} may lie next to it: only the key opens it")
