"""``airzoo-bench submission``: what one sends to a leaderboard, made and checked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from airzoo_bench.cli.common import (
    DataOption,
    Format,
    JobsOption,
    MemoryOption,
    examples,
    in_panels,
    memory_bytes,
    progress,
    put,
    resolve_data,
    say,
    show,
    with_data,
)

if TYPE_CHECKING:
    from airzoo_bench.leaderboard.checks import CheckedSubmission
    from airzoo_bench.leaderboard.rescoring import Rescored

__all__ = ["app"]

BoardOption = Annotated[
    Path | None,
    typer.Option(
        "--board",
        help="The board's repository (default: where leaderboard.toml is, here or above).",
        show_default=False,
    ),
]
Shown = Literal["terminal", "json"]

app = typer.Typer(
    help="Make and check what is sent to a leaderboard.",
    no_args_is_help=True,
)


@app.callback()
def _group() -> None:
    """Make and check what is sent to a leaderboard."""


def _option(help_: str, *flags: str, **more: Any) -> Any:
    return typer.Option(*flags, help=help_, show_default=False, **more)


NEW_PANELS = {
    "Files": ("url", "claimed", "reader", "names", "folder", "board", "data", "force"),
    "Method": ("protocol", "method", "summary", "stages", "uses", "training_data", "date"),
    "Who": ("team", "contact", "author", "licence", "supersedes"),
    "Links": ("paper", "code", "weights", "bibtex"),
    "Cost": ("hardware", "seconds_per_query", "memory_gb", "baseline", "setting"),
}


@app.command(
    "new",
    cls=in_panels(NEW_PANELS),
    epilog=examples(
        "submission new preds.npz --protocol airzoo-mini-retrieval --method SALAD "
        "--team 'Example Lab' --contact ada@example.org --author 'Ada Example' --licence CC-BY-4.0 "
        "--stages single-stage --training-data gsv-cities"
    ),
)
def new(
    predictions: Annotated[Path, typer.Argument(help="A prediction file or folder.")],
    protocol: Annotated[str | None, _option("What it is scored by.")] = None,
    method: Annotated[str | None, _option("The method's name in tables.")] = None,
    summary: Annotated[str | None, _option("What it does, in a sentence.")] = None,
    team: Annotated[str | None, _option("Who submits.")] = None,
    contact: Annotated[str | None, _option("For the maintainers; shown on no page.")] = None,
    author: Annotated[list[str] | None, _option("Of the method; once for each.")] = None,
    licence: Annotated[str | None, _option("Of the predictions, an id of SPDX.")] = None,
    training_data: Annotated[
        list[str] | None,
        _option("Id of a dataset, or 'none' for a method without training; once for each."),
    ] = None,
    stages: Annotated[str | None, _option("single-stage or re-ranked.")] = None,
    uses: Annotated[
        list[str] | None, _option("prior, sequence or heights; once for each that is used.")
    ] = None,
    date: Annotated[str | None, _option("Of the predictions (default: today).")] = None,
    paper: Annotated[str | None, _option("Its address.")] = None,
    code: Annotated[str | None, _option("Its address.")] = None,
    weights: Annotated[str | None, _option("Their address.")] = None,
    bibtex: Annotated[Path | None, _option("A file with the BibTeX entry.")] = None,
    hardware: Annotated[str | None, _option("That was timed.")] = None,
    seconds_per_query: Annotated[float | None, _option("With all stages.")] = None,
    memory_gb: Annotated[float | None, _option("Of the accelerator, the most it took.")] = None,
    baseline: Annotated[
        bool, _option("`airzoo-bench baseline` made the predictions.", "--baseline")
    ] = False,
    setting: Annotated[
        list[str] | None, _option("Of the baseline, such as words=16; once for each.")
    ] = None,
    supersedes: Annotated[
        str | None, _option("The folder of your earlier submission that this replaces.")
    ] = None,
    url: Annotated[
        str | None, _option("Where CI fetches the predictions; then they are not copied.")
    ] = None,
    claimed: Annotated[
        Path | None, _option("Your result.json, to be compared with what CI finds.", "--result")
    ] = None,
    reader: Annotated[str | None, _option("What reads a method's own files.")] = None,
    names: Annotated[Path | None, _option("A list of images, where files name none.")] = None,
    folder: Annotated[str | None, _option("Its name (default: made of the method's).")] = None,
    board: BoardOption = None,
    data: DataOption = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace an earlier version in the same folder.")
    ] = False,
) -> None:
    """Write the folder of a submission: submission.toml beside the predictions.

    What is missing is asked for on a terminal. docs/submission.md says what each
    key is for.
    """
    from airzoo_bench.cli.submission_questions import complete
    from airzoo_bench.leaderboard.board import BOARD_FILE, read_board
    from airzoo_bench.leaderboard.making import (
        Files,
        board_root,
        folder_name,
        place_of,
        write_submission,
    )

    root = board_root(board or Path())
    values = complete(
        {
            "protocol": protocol,
            "method": method,
            "summary": summary,
            "team": team,
            "contact": contact,
            "authors": author,
            "licence": licence,
            "training_data": training_data,
            "stages": stages,
            "uses": uses,
            "date": date,
            "paper": paper,
            "code": code,
            "weights": weights,
            "bibtex": bibtex,
            "hardware": hardware,
            "seconds_per_query": seconds_per_query,
            "memory_gb": memory_gb,
            "baseline": setting if baseline or setting else None,
            "supersedes": supersedes,
            "reader": reader,
        }
    )
    place = place_of(
        values["protocol"],
        folder or folder_name(values["method"]),
        read_board(root / BOARD_FILE),
        resolve_data(data),
    )
    files = Files(predictions, url, claimed, names)
    written = write_submission(root, place, values, files, replace=force)
    shown = written.relative_to(Path.cwd()) if written.is_relative_to(Path.cwd()) else written
    put(f"{shown}\n")
    say(f"next: airzoo-bench submission check {shown}{with_data(data)}")
    say("then commit this folder alone on a branch of its own, and open a pull request")


@app.command("check", epilog=examples("submission check submissions/airzoo-mini/matching/sift"))
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
    from airzoo_bench.evaluation.parts import Resources
    from airzoo_bench.leaderboard.board import BOARD_FILE, read_board
    from airzoo_bench.leaderboard.checks import check_submission
    from airzoo_bench.leaderboard.known import known_submissions
    from airzoo_bench.leaderboard.making import board_root

    if not folder.is_dir():
        raise UsageError(
            "no such folder", where=folder, fix="`airzoo-bench submission new` makes one"
        )
    root = board_root(board or folder)
    place = resolve_data(data)
    resources = Resources(memory_bytes(max_memory), jobs, progress)
    checked = check_submission(
        folder,
        read_board(root / BOARD_FILE),
        place,
        known=known_submissions(root),
        fetch=fetch,
        resources=resources,
    )
    rescored = None
    if score is not False and not checked.errors:
        rescored = _rescored(checked, place, resources, again=make_again, must=bool(score))
    wrong = [*checked.errors, *(rescored.errors if rescored else ())]
    if form == "json":
        put(json.dumps(_values(checked, rescored), indent=1, allow_nan=False) + "\n")
    else:
        _print(checked, rescored)
    if wrong:
        raise typer.Exit(1)


def _rescored(
    checked: CheckedSubmission, data: Path, resources: Any, *, again: bool, must: bool
) -> Rescored | None:
    """Score; where that cannot be done here, a warning says why, or an error if it must be."""
    from airzoo_bench.core.errors import SubmissionError
    from airzoo_bench.leaderboard.rescoring import rescore

    hindrance = _hindrance(checked, data)
    if not hindrance:
        return rescore(checked, data=data, resources=resources, make_again=again)
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
            put(f"{line}\n")
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
