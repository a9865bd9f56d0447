"""``airzoo-bench submit`` and ``submission check``: from a prediction file to a pull request."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.cli.common import Format, examples, progress, put, say, show
from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.core.files import data_root
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.board import BOARD_FILE, board_root, known_submissions, read_board
from airzoo_bench.leaderboard.checks import CheckedSubmission, check_submission
from airzoo_bench.leaderboard.scoring import score_submission
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE
from airzoo_bench.leaderboard.submitting import (
    Files,
    ask_missing,
    find_place,
    gh_account,
    open_pull_request,
    protocol_of,
    write_submission,
)
from airzoo_bench.tables.layouts import scenes_table

__all__ = ["PANELS", "app", "submit"]

PANELS = {
    "Questions": (
        *("protocol", "method", "team", "contact", "author", "licence", "training_data", "stages"),
    ),
    "More": ("more", "url", "reader", "names"),
    "Board": ("board", "force", "commit"),
}

app = typer.Typer(help="Check what is sent to a leaderboard.", no_args_is_help=True)

_FETCHING_S = 3600.0


def _option(help_: str, *flags: str) -> Any:
    return typer.Option(*flags, help=help_, show_default=False)


def submit(
    predictions: Annotated[Path, typer.Argument(help="A prediction file or folder.")],
    protocol: Annotated[str | None, _option("Default: the one that the file names.")] = None,
    method: Annotated[str | None, _option("The method's name in tables.")] = None,
    team: Annotated[str | None, _option("Who submits.")] = None,
    contact: Annotated[str | None, _option("For the maintainers; shown on no page.")] = None,
    author: Annotated[list[str] | None, _option("Author of the method; repeatable.")] = None,
    licence: Annotated[str | None, _option("Licence of the predictions, by SPDX.")] = None,
    training_data: Annotated[
        list[str] | None,
        _option("Id of a dataset, or 'none' for a method without training; once for each."),
    ] = None,
    stages: Annotated[str | None, _option("single-stage or re-ranked.")] = None,
    more: Annotated[
        list[str] | None,
        _option("Another key of submission.toml, such as paper=https://...; repeatable.", "--set"),
    ] = None,
    url: Annotated[
        str | None, _option("Where CI fetches the predictions; then they are not copied.")
    ] = None,
    reader: Annotated[str | None, _option("The reader of a method's own files.")] = None,
    names: Annotated[Path | None, _option("A list of images, where files name none.")] = None,
    board: Annotated[
        Path, _option("The board's repository (default: where leaderboard.toml is, above).")
    ] = Path(),
    force: Annotated[
        bool, typer.Option("--force", help="Replace an earlier version in the same folder.")
    ] = False,
    commit: Annotated[
        bool, typer.Option("--commit/--no-commit", help="Make a branch and a pull request.")
    ] = True,
) -> None:
    """Submit predictions to the board whose repository this is.

    Writes the folder of the submission, checks it as CI will, commits it on a branch of its own,
    and opens the pull request by gh, or prints the commands that do. Missing options are asked
    for on a terminal. docs/submission.md says what each key is for.
    """
    root, data = board_root(board), data_root()
    rules = read_board(root / BOARD_FILE)
    files = Files(predictions, url, names, reader)
    values = ask_missing(
        {
            "protocol": protocol or protocol_of(files, data),
            "method": method,
            "team": team,
            "contact": contact,
            "authors": author,
            "licence": licence,
            "training_data": training_data,
            "stages": stages,
            "account": gh_account() if commit else None,
        },
        more or (),
        rules.protocols,
    )
    place = find_place(values["protocol"], values["method"], rules, data)
    written = write_submission(root, place, values, files, rules, replace=force)
    put(f"{written}\n")
    if not _passes(written, root, fetch=False):
        say(f"mend {written / 'submission.toml'}, or submit again with --force; nothing was sent")
        raise typer.Exit(1)
    if commit:
        title = f"{values['method']} on {place.benchmark}, {place.track}"
        for step in open_pull_request(root, place, title):
            put(f"{step}\n")


@app.callback()
def _group() -> None:
    """Check what is sent to a leaderboard."""


@app.command(epilog=examples("submission check submissions/airzoo-mini/matching/sift"))
def check(
    folder: Annotated[Path, typer.Argument(help="The folder with submission.toml.")],
    fetch: Annotated[
        bool, typer.Option("--fetch", help="Fetch predictions at an address, to check them too.")
    ] = False,
) -> None:
    """Check a submission as CI will: all that it refuses is found here, at the price of no try.

    It is scored too where the benchmark is in the data root. Exit code 0 if nothing is wrong, 1 if
    anything is, 2 where there is nothing to check: no such folder, no board.
    """
    if not (folder / SUBMISSION_FILE).exists():
        raise UsageError(
            f"no {SUBMISSION_FILE} here",
            where=folder,
            expected="the folder of one submission, submissions/BENCHMARK/TRACK/FOLDER",
            fix="`airzoo-bench submit` makes one",
        )
    if not _passes(folder, board_root(folder), fetch=fetch):
        raise typer.Exit(1)


def _passes(folder: Path, root: Path, *, fetch: bool) -> bool:
    """Check a submission, score it where that can be done, print, and say whether it passes."""
    data, rules, run = data_root(), read_board(root / BOARD_FILE), Run(progress=progress)
    checked = check_submission(
        folder, rules, data, known=known_submissions(root), seconds=_FETCHING_S * fetch, run=run
    )
    for warning in checked.warnings:
        say(f"{folder}: {warning}")
    errors, done = [*checked.errors], "checked"
    if not errors:
        sealed = rules.archive(checked.place.benchmark) is not None
        if hindrance := _hindrance(checked, data, sealed=sealed):
            say(f"{folder}: not scored: {hindrance}")
        else:
            show(scenes_table(score_submission(checked, data, run).result), Format.TERMINAL)
            done = "checked and scored"
    for error in errors:
        say(str(error))
    if not errors:
        put(f"{folder}: {done}, nothing wrong was found\n")
    return not errors


def _hindrance(checked: CheckedSubmission, data: Path, *, sealed: bool) -> str:
    """Say why a sound submission cannot be scored here; nothing where it can."""
    if checked.predictions is None:
        return "the predictions are at an address; add --fetch"
    if sealed:
        return "the truth is sealed, and only CI has its key"
    try:
        find_benchmark(checked.place.benchmark, data)
    except BenchmarkError as error:
        return error.what
    return ""
