"""``airzoo-bench leaderboard build`` and ``serve``: the site of a board, and a look at it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import JobsOption, examples, put, say, working
from airzoo_bench.cli.engines import EngineOption, SchedulerOption
from airzoo_bench.cli.locations import DataOption, resolve_data
from airzoo_bench.core.errors import UsageError
from airzoo_bench.engines.choose import EngineKind, open_engine
from airzoo_bench.engines.engine import Processes

__all__ = ["BUILD_EXAMPLES", "SERVE_EXAMPLES", "build", "serve"]

BUILD_EXAMPLES = examples(
    "leaderboard build --out site", "leaderboard build results/*/result.json --out site"
)
SERVE_EXAMPLES = examples("leaderboard serve site")

_RUNS = Path("runs")


def build(
    results: Annotated[
        list[Path] | None,
        typer.Argument(help="Further results, or folders that hold one, beside the runs."),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="The site's folder; an earlier board is replaced.")
    ] = Path("site"),
    runs: Annotated[
        Path, typer.Option(help="Scored submissions: benchmark/track/folder/number/.")
    ] = _RUNS,
    submissions: Annotated[
        Path, typer.Option(help="Submissions, to say which have not been scored yet.")
    ] = Path("submissions"),
    board: Annotated[
        Path, typer.Option(help="What the board states of itself, if there is such a file.")
    ] = Path("leaderboard.toml"),
    cache: Annotated[
        Path | None,
        typer.Option(help="What builds keep; safe to delete (default: OUT.cache)."),
    ] = None,
    data: DataOption = None,
    jobs: JobsOption = 2,
    engine: EngineOption = EngineKind.LOCAL,
    scheduler: SchedulerOption = None,
) -> None:
    """Make the static site of a board: tables, pages, JSON. See docs/leaderboard-api.md.

    The board that stands is replaced in one step, when the new one is whole. A second build reads
    what the first has kept and takes seconds.
    """
    from airzoo_bench.leaderboard.board import read_board
    from airzoo_bench.leaderboard.site.api_files import Given
    from airzoo_bench.leaderboard.site.build import build_board

    if runs != _RUNS and not runs.is_dir():
        raise UsageError(
            "no folder of runs: the board would lose all that were scored",
            where=runs,
            fix="correct --runs, or leave it out where there are none",
        )
    if next(runs.glob("runs/*/*/*/*/run.json"), None) is not None:
        raise UsageError(
            "the folder above that of the runs",
            where=runs,
            expected="benchmark/track/folder/number/ in it",
            fix=f"--runs {runs / 'runs'}",
        )
    stated = read_board(board) if board.is_file() or board != Path("leaderboard.toml") else None
    given = Given(
        runs,
        submissions,
        results or [],
        stated,
        resolve_data(data),
    )
    kept = out.with_name(f"{out.name}.cache") if cache is None else cache
    with (
        open_engine(engine, scheduler, jobs=jobs, here=Processes(jobs), note=say) as place,
        working("building the board"),
    ):
        build_board(given, out, kept, engine=place, note=say)
    put(f"{out / 'index.html'}\n")


def serve(
    site: Annotated[Path, typer.Argument(help="The folder that `leaderboard build` made.")] = Path(
        "site"
    ),
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: any that is free.")] = 8000,
) -> None:
    """Show a built site at an address of this machine alone, until Ctrl-C."""
    from airzoo_bench.leaderboard.site.serving import serve_folder

    serve_folder(site, port, put)
