"""``airzoo-bench seal`` and what belongs to it: benchmarks whose truth stays with its host."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import (
    Format,
    NamesOption,
    ReaderOption,
    progress,
    put,
    say,
)
from airzoo_bench.cli.locations import DataOption, resolve_data
from airzoo_bench.core.errors import counted
from airzoo_bench.evaluation.opening import ReadBy
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard import sealing
from airzoo_bench.leaderboard.sealed_scoring import score_sealed

ArchiveOption = Annotated[Path, typer.Option("--archive", help="The archive of the truth.")]
KeyOption = Annotated[
    Path | None,
    typer.Option("--key", help="The key file (default: the key in $AIRZOO_BENCH_KEY)."),
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace what is there.")]


def seal(
    folder: Annotated[Path, typer.Argument(help="Benchmark folder, with all its data in it.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The public folder to write.")],
    archive: ArchiveOption,
    to: Annotated[str, typer.Option("--to", help="The host's public key, age1...")],
    force: ForceOption = False,
) -> None:
    """Split a benchmark folder into a public one without the truth, and an archive with it.

    Methods get photos without metadata, cameras, priors, tiles, crops and maps;
    docs/leaderboard.md says what else to consider.
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


def seal_score(
    predictions: Annotated[Path, typer.Argument(help="Predictions, as for `eval`.")],
    protocol: Annotated[str, typer.Option("--protocol", help="Name of the protocol.")],
    archive: ArchiveOption,
    key: KeyOption = None,
    data: DataOption = None,
    method: Annotated[
        str | None, typer.Option("--method", help="The method's name (default: the file's).")
    ] = None,
    reader: ReaderOption = None,
    names: NamesOption = None,
) -> None:
    """Score predictions against a sealed truth, and print the public scores as JSON.

    Nothing else of the truth is printed or kept.
    """
    answer = score_sealed(
        predictions,
        protocol,
        method or predictions.stem,
        archive,
        sealing.read_key(key),
        data=resolve_data(data),
        read_by=ReadBy(reader, names),
        run=Run(progress=progress),
    )
    put(answer.model_dump_json(by_alias=True, indent=2) + "\n", Format.JSON)
