"""``airzoo-bench submission``: what one sends to a leaderboard, made and checked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from airzoo_bench.cli.common import examples, in_panels, put, say
from airzoo_bench.cli.locations import DataOption, resolve_data, with_data
from airzoo_bench.cli.submission_check import BoardOption, check

__all__ = ["app"]


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
    "Who": ("team", "contact", "author", "licence"),
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
    from airzoo_bench.core.errors import UsageError
    from airzoo_bench.leaderboard.board import BOARD_FILE, read_board
    from airzoo_bench.leaderboard.making import (
        Files,
        board_root,
        folder_name,
        place_of,
        write_submission,
    )

    root = board_root(board or Path())
    rules = read_board(root / BOARD_FILE)
    if not predictions.exists():
        raise UsageError("no such file or folder", where=predictions)
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
            "reader": reader,
        },
        rules.protocols,
    )
    place = place_of(
        values["protocol"],
        folder or folder_name(values["method"]),
        rules,
        resolve_data(data),
    )
    files = Files(predictions, url, claimed, names)
    written = write_submission(root, place, values, files, replace=force)
    shown = written.relative_to(Path.cwd()) if written.is_relative_to(Path.cwd()) else written
    put(f"{shown}\n")
    say(f"next: airzoo-bench submission check {shown}{with_data(data)}")
    say("then commit this folder alone on a branch of its own, and open a pull request")


app.command("check", epilog=examples("submission check submissions/airzoo-mini/matching/sift"))(
    check
)
