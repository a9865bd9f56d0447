"""``airzoo-bench eval``: score predictions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import (
    DataOption,
    Format,
    FormatOption,
    JobsOption,
    MemoryOption,
    ProtocolOption,
    memory_bytes,
    progress,
    put,
    resolve_data,
    say,
    show,
)

__all__ = ["app"]

app = typer.Typer(help="Score predictions and print the per-scene table.", no_args_is_help=True)


@app.callback()
def _group() -> None:
    """Score predictions and print the per-scene table."""


@app.command(
    epilog="Example: airzoo-bench eval retrieval preds.npz --out results/mymethod",
)
def retrieval(
    predictions: Annotated[Path, typer.Argument(help="An .npz or .parquet prediction file.")],
    protocol: ProtocolOption = None,
    data: DataOption = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for result.json and records.csv.")
    ] = None,
    method: Annotated[
        str | None, typer.Option(help="The method's name in tables [default: the file's name].")
    ] = None,
    form: FormatOption = Format.TERMINAL,
    every_score: Annotated[
        bool, typer.Option("--all", help="Print every score, not the paper's only.")
    ] = False,
    jobs: JobsOption = 1,
    max_memory: MemoryOption = "2G",
) -> None:
    """Score aerial image retrieval: Recall@K, AP@5 and more, for each scene."""
    from airzoo_bench.files import check_output_folder
    from airzoo_bench.runner import evaluate_retrieval, save
    from airzoo_bench.tables.build import scenes_table

    if out is not None:
        check_output_folder(out, ("result.json", "records.csv"))
    evaluation = evaluate_retrieval(
        predictions,
        data=resolve_data(data),
        protocol=protocol,
        method=method,
        memory_bytes=memory_bytes(max_memory),
        jobs=jobs,
        progress=progress,
    )
    if out is not None:
        save(evaluation, out)
    if form is Format.JSON:
        content = json.loads(evaluation.result.model_dump_json(by_alias=True))
        put(json.dumps(content, indent=1) + "\n")
    else:
        show(scenes_table(evaluation.result, every_score=every_score), form)
    if out is not None:
        say(f"wrote {out / 'result.json'} and {out / 'records.csv'}")
        say(f"next: airzoo-bench table {out / 'result.json'} --format latex")
    else:
        say("nothing was written; add --out DIR to keep the result and a row for each query")
