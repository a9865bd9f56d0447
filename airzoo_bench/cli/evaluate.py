"""``airzoo-bench eval``: score predictions."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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

if TYPE_CHECKING:
    from airzoo_bench.results.result import Result

__all__ = ["app"]

OutOption = Annotated[
    Path | None,
    typer.Option(help="Folder for result.json and records.csv, in place of an earlier run's."),
]
MethodOption = Annotated[
    str | None,
    typer.Option(help="The method's name in tables (default: the name of --out, else the file's)."),
]
AllOption = Annotated[bool, typer.Option("--all", help="Print every score, not the paper's only.")]

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
    out: OutOption = None,
    method: MethodOption = None,
    form: FormatOption = Format.TERMINAL,
    every_score: AllOption = False,
    jobs: JobsOption = 1,
    max_memory: MemoryOption = "2G",
) -> None:
    """Score aerial image retrieval: Recall@K, AP@5 and more, for each scene."""
    from airzoo_bench.evaluation.run_files import save
    from airzoo_bench.retrieval.track import evaluate_retrieval

    method = _named_after(out, method)
    evaluation = evaluate_retrieval(
        predictions,
        data=resolve_data(data),
        protocol=protocol,
        method=method,
        memory_bytes=memory_bytes(max_memory),
        jobs=jobs,
        progress=progress,
    )
    written = [] if out is None else save(evaluation, out)
    _print_result(evaluation.result, form, every_score=every_score)
    _print_next(written)


@app.command(
    epilog="Example: airzoo-bench eval matching matches.npz --out results/mymethod --figures",
)
def matching(
    predictions: Annotated[
        Path, typer.Argument(help="An .npz of matches, 2D-3D pairs or poses, or a .txt of poses.")
    ],
    protocol: ProtocolOption = None,
    data: DataOption = None,
    out: OutOption = None,
    method: MethodOption = None,
    form: FormatOption = Format.TERMINAL,
    every_score: AllOption = False,
    figures: Annotated[
        bool, typer.Option("--figures", help="Draw error curves, matches and maps into --out.")
    ] = False,
    seeds: Annotated[
        int,
        typer.Option(
            min=1, max=1000, help="Solve under so many seeds and say how far the scores spread."
        ),
    ] = 1,
    jobs: JobsOption = 2,
    max_memory: MemoryOption = "2G",
) -> None:
    """Score cross-view matching: translation and pose recall, median error, for each scene."""
    from airzoo_bench.core.errors import UsageError
    from airzoo_bench.evaluation.run_files import save
    from airzoo_bench.matching.track import evaluate_matching, save_timings

    if figures and out is None:
        raise UsageError("--figures needs a folder to draw into", mend="add --out DIR")
    method = _named_after(out, method)
    scored = evaluate_matching(
        predictions,
        data=resolve_data(data),
        protocol=protocol,
        method=method,
        memory_bytes=memory_bytes(max_memory),
        jobs=jobs,
        progress=progress,
    )
    written = [] if out is None else save(scored.evaluation, out, partial(save_timings, scored))
    if out is not None and figures:
        from airzoo_bench.report.matching_run import draw_figures

        drawn = draw_figures(scored, resolve_data(data), out / "figures", progress)
        say(f"drew {drawn} pictures into {out / 'figures'}")
    _print_result(scored.evaluation.result, form, every_score=every_score)
    if seeds > 1:
        from airzoo_bench.matching.seeds import spread_over_seeds

        say(f"average over scenes under {seeds} seeds, of which the result has the first:")
        for spread in spread_over_seeds(scored, seeds, jobs=jobs, progress=progress):
            say(f"  {spread}")
    _print_next(written)


@app.command(
    epilog="Example: airzoo-bench eval reconstruction clouds --out results/mymethod --figures",
)
def reconstruction(
    predictions: Annotated[
        Path,
        typer.Argument(
            help="A folder or archive with an entry a scene (cloud, mesh, or .npz of depth or "
            "point maps), or one such file."
        ),
    ],
    protocol: ProtocolOption = None,
    data: DataOption = None,
    out: OutOption = None,
    method: MethodOption = None,
    form: FormatOption = Format.TERMINAL,
    every_score: AllOption = False,
    figures: Annotated[
        bool, typer.Option("--figures", help="Draw curves and maps of errors into --out.")
    ] = False,
    clouds: Annotated[
        bool, typer.Option("--clouds", help="Write clouds coloured by their errors into --out.")
    ] = False,
    jobs: JobsOption = 2,
    max_memory: MemoryOption = "2G",
) -> None:
    """Score multi-view reconstruction: Chamfer distance, F1, precision and recall, by scene."""
    from airzoo_bench.core.errors import UsageError
    from airzoo_bench.evaluation.run_files import save
    from airzoo_bench.reconstruction.track import evaluate_reconstruction

    if (figures or clouds) and out is None:
        raise UsageError("--figures and --clouds need a folder", mend="add --out DIR")
    method = _named_after(out, method)
    scored = evaluate_reconstruction(
        predictions,
        data=resolve_data(data),
        protocol=protocol,
        method=method,
        memory_bytes=memory_bytes(max_memory),
        jobs=jobs,
        keep_clouds=figures or clouds,
        progress=progress,
    )
    written: list[Path] = []
    if out is not None:
        from airzoo_bench.report.reconstruction_run import (
            draw_figures,
            save_alignments,
            write_clouds,
        )

        written = save(scored.evaluation, out, partial(save_alignments, scored))
        if figures:
            drawn = draw_figures(scored, out / "figures", progress)
            say(f"drew {drawn} pictures into {out / 'figures'}")
        if clouds:
            coloured = write_clouds(scored, out / "clouds", progress)
            say(f"wrote {coloured} clouds into {out / 'clouds'}")
    _print_result(scored.evaluation.result, form, every_score=every_score)
    _print_next(written)


def _named_after(out: Path | None, method: str | None) -> str | None:
    """Check the folder for output, and return the method's name, which can be the folder's."""
    from airzoo_bench.core.files import check_output_folder
    from airzoo_bench.evaluation.run_files import RESULT_FILES, earlier_run

    if out is None:
        return method
    check_output_folder(out, RESULT_FILES)
    replaced = earlier_run(out)
    if replaced is not None:
        say(replaced)
    return method or out.resolve().name or None


def _print_result(result: Result, form: Format, *, every_score: bool) -> None:
    from airzoo_bench.tables.build import scenes_table

    if form is Format.JSON:
        content = json.loads(result.model_dump_json(by_alias=True))
        put(json.dumps(content, indent=1) + "\n")
    else:
        show(scenes_table(result, every_score=every_score, floors=True), form)


def _print_next(written: list[Path]) -> None:
    if written:
        *others, last = map(str, written)
        say(f"wrote {', '.join(others)} and {last}")
        say(f"next: airzoo-bench table {written[0]} --format latex")
    else:
        say("nothing was written; add --out DIR to keep the result and its records")
