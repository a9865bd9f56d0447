"""``airzoo-bench submission check``: all that CI refuses, before CI does."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from airzoo_bench.cli.common import (
    Format,
    JobsOption,
    MemoryOption,
    memory_bytes,
    printable,
    progress,
    put,
    say,
    show,
)
from airzoo_bench.cli.locations import DataOption, resolve_data

if TYPE_CHECKING:
    from airzoo_bench.leaderboard.checks import CheckedSubmission
    from airzoo_bench.leaderboard.rescoring import Rescored

__all__ = ["BoardOption", "check"]

BoardOption = Annotated[
    Path | None,
    typer.Option(
        "--board",
        help="The board's repository (default: where leaderboard.toml is, here or above).",
        show_default=False,
    ),
]
Shown = Literal["terminal", "json"]


def check(
    folder: Annotated[Path, typer.Argument(help="The folder with submission.toml.")],
    board: BoardOption = None,
    data: DataOption = None,
    fetch: Annotated[
        bool, typer.Option("--fetch", help="Fetch predictions at an address, to check them too.")
    ] = False,
    score: Annotated[
        bool | None,
        typer.Option(
            "--score/--no-score",
            help="Score them, or do not (default: where benchmark and predictions are here).",
            show_default=False,
        ),
    ] = None,
    make_again: Annotated[
        bool,
        typer.Option("--make-again", help="Run the suite's baseline again, compare and time it."),
    ] = False,
    form: Annotated[
        Shown, typer.Option("--format", "-f", help="How to print what was found.")
    ] = "terminal",
    jobs: JobsOption = 2,
    max_memory: MemoryOption = "2G",
) -> None:
    """Check a submission as CI will: all that it refuses is found here, at the price of no try.

    Exit code 0 if nothing is wrong, 1 if anything is, 2 where there is nothing to
    check: no such folder, no board.
    """
    from airzoo_bench.core.errors import UsageError
    from airzoo_bench.evaluation.track import Run
    from airzoo_bench.leaderboard.board import BOARD_FILE, read_board
    from airzoo_bench.leaderboard.checks import check_submission
    from airzoo_bench.leaderboard.known import known_submissions
    from airzoo_bench.leaderboard.making import board_root
    from airzoo_bench.leaderboard.submission import SUBMISSION_FILE

    if not folder.is_dir():
        raise UsageError(
            "no such folder", where=folder, fix="`airzoo-bench submission new` makes one"
        )
    root = board_root(board or folder)
    if not (folder / SUBMISSION_FILE).exists():
        raise UsageError(
            f"no {SUBMISSION_FILE} here",
            where=folder,
            expected="the folder of one submission, submissions/BENCHMARK/TRACK/FOLDER",
            fix="`airzoo-bench submission new` makes one",
        )
    place = resolve_data(data)
    run = Run(memory_bytes(max_memory), jobs, progress)
    checked = check_submission(
        folder,
        read_board(root / BOARD_FILE),
        place,
        known=known_submissions(root),
        fetch=fetch,
        run=run,
    )
    rescored = None
    if score is not False and not checked.errors:
        rescored = _rescored(checked, place, run, again=make_again, must=bool(score))
    wrong = [*checked.errors, *(rescored.errors if rescored else ())]
    if form == "json":
        put(json.dumps(_values(checked, rescored), indent=1, allow_nan=False) + "\n")
    else:
        _print(checked, rescored)
    if wrong:
        raise typer.Exit(1)


def _rescored(
    checked: CheckedSubmission, data: Path, run: Any, *, again: bool, must: bool
) -> Rescored | None:
    """Score; where that cannot be done here, a warning says why, or an error if it must be."""
    from airzoo_bench.core.errors import SubmissionError
    from airzoo_bench.leaderboard.rescoring import rescore

    hindrance = _hindrance(checked, data)
    if not hindrance:
        return rescore(checked, data=data, run=run, make_again=again)
    if must:
        raise SubmissionError(f"not scored: {hindrance}", where=checked.folder)
    checked.warnings.append(f"not scored: {hindrance}")
    return None


def _hindrance(checked: CheckedSubmission, data: Path) -> str:
    """Say what keeps a sound submission from being scored here, if anything does."""
    from airzoo_bench.benchmark.folder import find_benchmark
    from airzoo_bench.core.errors import BenchmarkError

    if checked.predictions is None:
        return "the predictions are at an address; add --fetch"
    if checked.benchmark is not None and checked.benchmark.sealed:
        return "the truth is sealed, and only CI has its key"
    try:
        find_benchmark(checked.place.benchmark, data)
    except BenchmarkError as error:
        return error.what
    return ""


def _print(checked: CheckedSubmission, rescored: Rescored | None) -> None:
    from airzoo_bench.tables.layouts import scenes_table

    for warning in checked.warnings:
        say(f"{checked.folder}: {warning}")
    if rescored is not None:
        show(scenes_table(rescored.evaluation.result), Format.TERMINAL)
        for line in rescored.lines:
            put(f"{printable(line)}\n")
    errors = [*checked.errors, *(rescored.errors if rescored else ())]
    for error in errors:
        say(str(error))
    if not errors:
        scored = " and scored" if rescored is not None else ""
        put(f"{checked.folder}: checked{scored}, nothing wrong was found\n")


def _values(checked: CheckedSubmission, rescored: Rescored | None) -> dict[str, Any]:
    errors = [*checked.errors, *(rescored.errors if rescored else ())]
    found: dict[str, Any] = {
        "folder": str(checked.folder),
        "passes": not errors,
        "errors": [
            {"what": e.what, "where": e.where, "expected": e.expected, "fix": e.fix} for e in errors
        ],
        "warnings": checked.warnings,
        "lines": list(rescored.lines) if rescored else [],
        "result": None,
    }
    if rescored is not None:
        found["result"] = json.loads(rescored.evaluation.result.model_dump_json(by_alias=True))
    return found
