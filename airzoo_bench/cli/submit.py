"""``airzoo-bench submit`` and ``submission check``: from a prediction file to a pull request."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import Format, Text, Texts, echo, examples, option, progress, say, show
from airzoo_bench.core.errors import BenchmarkError, UsageError, UserError, counted
from airzoo_bench.core.files import data_root
from airzoo_bench.evaluation.predictions import ReadRequest, open_predictions
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard import submitting
from airzoo_bench.leaderboard.board import BOARD_FILE, board_root, known_submissions, read_board
from airzoo_bench.leaderboard.checks import FETCHING_S, Rules, check_submission
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE
from airzoo_bench.tables.layouts import scenes_table

_ASKED = ("protocol", "method", "team", "contact", "author", "licence", "training_data", "stages")
PANELS = {"Questions": _ASKED, "More": ("more", "url", "reader")}
PANELS |= {"Board": ("board", "force", "commit")}

# With a callback, `check` is a command of a group.
app = typer.Typer(
    help="Check a submission to a board.", no_args_is_help=True, callback=lambda: None
)


def submit(
    predictions: Annotated[Path, typer.Argument(help="A prediction file or folder.")],
    protocol: Annotated[Text, option("The protocol (default: from the file).")] = None,
    method: Annotated[Text, option("The method's name in tables.")] = None,
    team: Annotated[Text, option("Who submits.")] = None,
    contact: Annotated[Text, option("For the maintainers; not shown on pages.")] = None,
    author: Annotated[Texts, option("Author of the method; repeatable.")] = None,
    licence: Annotated[Text, option("Licence of the predictions, by SPDX.")] = None,
    training_data: Annotated[Texts, option("Id of a dataset, or 'none'; repeatable.")] = None,
    stages: Annotated[Text, option("single-stage or re-ranked.")] = None,
    more: Annotated[Texts, option("Another key: paper=https://...; repeatable.", "--set")] = None,
    url: Annotated[Text, option("Where CI fetches the predictions: no copy.")] = None,
    reader: Annotated[Text, option("The reader of a method's own files.")] = None,
    board: Annotated[Path, option("A folder in the board.", show_default=False)] = Path(),
    force: Annotated[bool, option("Replace an earlier version.", "--force")] = False,
    commit: Annotated[bool, option("Make a branch and a pull request.")] = True,
) -> None:
    """Submit predictions to the board in this repository.

    Writes the folder of the submission, checks it as CI will, commits it on a branch of its own,
    and opens the pull request by gh, or prints the commands for that. On a terminal it asks for
    missing options. docs/submission.md explains each key.

    Example: airzoo-bench submit preds.npz --method SALAD

    Example: airzoo-bench submit preds.npz --url https://zenodo.org/records/1/files/preds.npz --set code=https://github.com/serizba/salad
    """
    root, data = board_root(board), data_root()
    rules = read_board(root / BOARD_FILE)
    if not predictions.exists():
        raise UsageError("no such file or folder", where=predictions)
    if protocol is None:
        with suppress(UserError):  # it is asked for
            request = ReadRequest(reader)
            protocol = open_predictions(predictions, data=data, request=request).protocol.name
    given = {"account": submitting.gh_account(), "protocol": protocol, "method": method}
    given |= {"team": team, "contact": contact, "authors": author, "licence": licence}
    given |= {"training_data": training_data, "stages": stages}
    values = submitting.merge_options(given, more or ())
    submitting.ask_missing(values, ("protocol", "method", "account"))
    place = submitting.find_place(values["protocol"], values["method"], rules, data)
    branch = "-".join(("submit", *place))
    if commit:
        submitting.switch_branch(root, branch, rules.branch)
    submitting.check_owner(root, place, values["account"], replace=force)
    submitting.ask_missing(values, given)
    folder, values["predictions"] = root / place.path, {"url": url, "reader": reader}
    submitting.write_submission(folder, values, predictions, rules.limits, replace=force)
    echo(f"{folder}\n")
    if not _passes(folder, root, fetch=False):
        say(f"mend {folder / SUBMISSION_FILE}, or submit again with --force; nothing was sent")
        raise typer.Exit(1)
    if commit:
        title = f"{values['method']} on {place.benchmark}, {place.track}"
        for step in submitting.open_pull_request(root, place, branch, title):
            echo(f"{step}\n")


@app.command(epilog=examples("submission check submissions/airzoo-mini/matching/sift"))
def check(
    folder: Annotated[Path, typer.Argument(help="The folder with submission.toml.")],
    fetch: Annotated[bool, option("Fetch predictions at an address, to check them too.")] = False,
) -> None:
    """Check a submission as CI will, without using a try.

    It is scored too if the benchmark is in the data root. Exit code 0 if nothing is wrong, 1 if
    something is, 2 if there is no board.
    """
    if not _passes(folder, board_root(folder), fetch=fetch):
        raise typer.Exit(1)


def _passes(folder: Path, root: Path, *, fetch: bool) -> bool:
    """Check a submission, score it where that can be done, print, and say whether it passes."""
    rules = Rules(read_board(root / BOARD_FILE), root, data_root(), Run(progress=progress))
    checked = check_submission(folder, rules, known_submissions(root), FETCHING_S * fetch)
    done = "checked"
    if not checked.errors:
        try:
            show(scenes_table(checked.score(rules.data, rules.run).result), Format.TERMINAL)
            done = "checked and scored"
        except BenchmarkError as error:  # the truth is not here, or sealed
            checked.warnings.append(f"not scored: {error.what}")
        except UserError as refusal:
            checked.errors.append(refusal)
    for line in (*(f"{folder}: {one}" for one in checked.warnings), *checked.errors):
        say(str(line))
    if not checked.errors:
        echo(f"{folder}: {done}, no error, {counted(len(checked.warnings), 'warning')}\n")
    return not checked.errors
