"""``airzoo-bench submit`` and ``submission check``: from a prediction file to a pull request."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from airzoo_bench.cli.common import (
    Format,
    JobsOption,
    MemoryOption,
    examples,
    memory_bytes,
    printable,
    progress,
    put,
    say,
    show,
)
from airzoo_bench.cli.locations import DataOption, resolve_data

__all__ = ["EXAMPLES", "PANELS", "app", "submit"]

EXAMPLES = examples(
    "submit preds.npz --method SALAD",
    "submit preds.npz --url https://zenodo.org/records/1/files/preds.npz --set "
    "code=https://github.com/serizba/salad",
)
PANELS = {
    "Questions": (
        *("protocol", "method", "team", "contact", "author", "licence", "training_data", "stages"),
    ),
    "More": ("uses", "more", "account", "url", "claimed", "reader", "names", "folder"),
    "Board": ("board", "data", "force", "commit"),
}

app = typer.Typer(help="Check what is sent to a leaderboard.", no_args_is_help=True)

BoardOption = Annotated[
    Path | None,
    typer.Option(
        "--board",
        help="The board's repository (default: where leaderboard.toml is, here or above).",
        show_default=False,
    ),
]


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
    uses: Annotated[
        list[str] | None, _option("prior, sequence or heights; once for each that is used.")
    ] = None,
    more: Annotated[
        list[str] | None,
        _option("Another key of submission.toml, such as paper=https://...; repeatable.", "--set"),
    ] = None,
    account: Annotated[
        int | None, _option("Id of your GitHub account (default: that of gh, if it is there).")
    ] = None,
    url: Annotated[
        str | None, _option("Where CI fetches the predictions; then they are not copied.")
    ] = None,
    claimed: Annotated[
        Path | None, _option("Your result.json, to be compared with CI's.", "--result")
    ] = None,
    reader: Annotated[str | None, _option("The reader of a method's own files.")] = None,
    names: Annotated[Path | None, _option("A list of images, where files name none.")] = None,
    folder: Annotated[str | None, _option("Its name (default: made of the method's).")] = None,
    board: BoardOption = None,
    data: DataOption = None,
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
    from airzoo_bench.leaderboard.board import BOARD_FILE, board_root, read_board
    from airzoo_bench.leaderboard.submitting import (
        Files,
        answered,
        find_place,
        gh_account,
        open_pull_request,
        protocol_of,
        write_submission,
    )

    root = board_root(board or Path())
    rules, home = read_board(root / BOARD_FILE), resolve_data(data)
    files = Files(predictions, url, claimed, names, reader)
    named = protocol_of(files, home)
    values = answered(
        {
            "protocol": protocol or named,
            "method": method,
            "team": team,
            "contact": contact,
            "authors": author,
            "licence": licence,
            "training_data": training_data,
            "stages": stages,
            "uses": uses,
            "account": account or (gh_account() if commit else None),
        },
        more or (),
        rules.protocols,
    )
    place = find_place(values["protocol"], folder, values["method"], rules, home)
    written = write_submission(root, place, values, files, rules, replace=force)
    put(f"{written}\n")
    if not _passes(written, root, home, fetch=False, score=None):
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
    jobs: JobsOption = 2,
    max_memory: MemoryOption = "2G",
) -> None:
    """Check a submission as CI will: all that it refuses is found here, at the price of no try.

    Exit code 0 if nothing is wrong, 1 if anything is, 2 where there is nothing to
    check: no such folder, no board.
    """
    from airzoo_bench.core.errors import UsageError
    from airzoo_bench.leaderboard.board import board_root
    from airzoo_bench.leaderboard.submission import SUBMISSION_FILE

    if not (folder / SUBMISSION_FILE).exists():
        raise UsageError(
            f"no {SUBMISSION_FILE} here",
            where=folder,
            expected="the folder of one submission, submissions/BENCHMARK/TRACK/FOLDER",
            fix="`airzoo-bench submit` makes one",
        )
    root, home = board_root(board or folder), resolve_data(data)
    more = {"jobs": jobs, "memory": memory_bytes(max_memory)}
    if not _passes(folder, root, home, fetch=fetch, score=score, **more):
        raise typer.Exit(1)


def _passes(
    folder: Path,
    root: Path,
    data: Path,
    *,
    fetch: bool,
    score: bool | None,
    jobs: int = 2,
    memory: int = 2 << 30,
) -> bool:
    """Check a submission, score it where that can be done, print, and say whether it passes."""
    from airzoo_bench.core.errors import SubmissionError
    from airzoo_bench.evaluation.track import Run
    from airzoo_bench.leaderboard.board import BOARD_FILE, known_submissions, read_board
    from airzoo_bench.leaderboard.checks import check_submission
    from airzoo_bench.leaderboard.rescoring import rescore
    from airzoo_bench.tables.layouts import scenes_table

    run = Run(memory, jobs, progress)
    rules = read_board(root / BOARD_FILE)
    known = [*known_submissions(root)]
    checked = check_submission(folder, rules, data, known=known, fetched=fetch, run=run)
    errors, scored = [*checked.errors], ""
    hindrance = _hindrance(checked, rules, data) if score is not False and not errors else "no"
    for warning in checked.warnings:
        say(f"{folder}: {warning}")
    if not hindrance:
        rescored = rescore(checked, data=data, run=run)
        show(scenes_table(rescored.evaluation.result), Format.TERMINAL)
        for line in rescored.lines:
            put(f"{printable(line)}\n")
        errors, scored = [*rescored.errors], " and scored"
    elif score and not errors:
        raise SubmissionError(f"not scored: {hindrance}", where=folder)
    elif hindrance != "no":
        say(f"{folder}: not scored: {hindrance}")
    for error in errors:
        say(str(error))
    if not errors:
        put(f"{folder}: checked{scored}, nothing wrong was found\n")
    return not errors


def _hindrance(checked: Any, board: Any, data: Path) -> str:
    """Say what keeps a sound submission from being scored here, if anything does."""
    from airzoo_bench.benchmark.folder import find_benchmark
    from airzoo_bench.core.errors import BenchmarkError

    if checked.predictions is None:
        return "the predictions are at an address; add --fetch"
    if board.archive(checked.place.benchmark):
        return "the truth is sealed, and only CI has its key"
    try:
        find_benchmark(checked.place.benchmark, data)
    except BenchmarkError as error:
        return error.what
    return ""
