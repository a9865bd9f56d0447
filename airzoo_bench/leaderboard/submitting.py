"""Making a submission: its folder, whole or not at all, its branch and its pull request."""

from __future__ import annotations

import datetime
import hashlib
import re
import shutil
import stat
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import typer
from pydantic import TypeAdapter, ValidationError

from airzoo_bench.core.errors import SubmissionError, UsageError
from airzoo_bench.core.files import atomic_folder, check_new_folder, sha256_of_tree
from airzoo_bench.core.validation import SAFE_NAME, nearest, validated
from airzoo_bench.leaderboard import submission as rules
from airzoo_bench.leaderboard.board import Board, Limits, Place, known_submissions
from airzoo_bench.leaderboard.checks import check_listing, size_of_tree
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission
from airzoo_bench.protocol.model import find_protocol

_LISTS = ("authors", "training_data")


def merge_options(given: Mapping[str, Any], more: Sequence[str]) -> dict[str, Any]:
    """Return the keys of submission.toml, given and further ones, such as ``paper=https://...``."""
    values = dict(given) | {"date": datetime.date.today()}
    for text in more:
        name, _, value = text.partition("=")
        try:
            [(name, found)] = tomllib.loads(text).items()
        except tomllib.TOMLDecodeError:  # a text without quotes
            found = value
        values[name] = values.get(name, {}) | found if isinstance(found, dict) else found
    return values


def ask_missing(values: dict[str, Any], keys: Iterable[str]) -> None:
    """Ask for the keys that are missing; where nobody can be asked, only the account may be."""
    missing = [key for key, value in values.items() if value is None]
    if sys.stdin.isatty() and sys.stderr.isatty():
        values |= {key: _ask(key) for key in missing if key in keys}
    elif names := [f"--{key.replace('_', '-')}" for key in missing if key != "account"]:
        fix = "add these options, or call it on a terminal, where it asks"
        raise UsageError(f"missing: {', '.join(names).replace('authors', 'author')}", fix=fix)


def _ask(key: str) -> Any:
    """Ask until the answer is one that submission.toml takes."""
    field: Any = (rules.Pipeline if key == "stages" else Submission).model_fields[key]
    adapter: TypeAdapter[Any] = TypeAdapter(field.rebuild_annotation())

    def convert(answer: str) -> Any:
        parts = tuple(part.strip() for part in answer.split(",") if part.strip())
        try:
            return adapter.validate_python(parts if key in _LISTS else answer.strip())
        except ValidationError as error:
            raise typer.BadParameter(f"{answer!r}: {error.errors()[0]['msg']}") from None

    typer.echo("\n{} (such as {})".format(*rules.QUESTIONS[key]), err=True)
    return typer.prompt(key, value_proc=convert, err=True)


def find_place(protocol: str, method: str, board: Board, data: Path) -> Place:
    """Return the place of a submission on a board, in a folder named after its method."""
    if protocol not in board.protocols:
        what = f"this board does not score by {protocol!r}{nearest(protocol, board.protocols)}"
        raise UsageError(what, where="--protocol", expected=f"one of {', '.join(board.protocols)}")
    name = re.sub(r"[^a-z0-9]+", "-", method.casefold()).strip("-")[:64]
    name = name or f"method-{hashlib.sha256(method.encode()).hexdigest()[:8]}"
    chosen = find_protocol(protocol, data)
    return Place(chosen.benchmark, chosen.track, name)


def check_owner(root: Path, place: Place, account: int | None, *, replace: bool) -> None:
    """Refuse the folder of another account, and, unless `replace`, one that is there already."""
    there = known_submissions(root).get(place)
    if there and there.account not in (None, account):
        what = f"belongs to team {there.team!r}, account {there.account}, not to {account}"
        raise UsageError(what, where=place.path, fix="choose another name by --method")
    check_new_folder(root / place.path, replace=replace, mark=SUBMISSION_FILE)


def write_submission(
    folder: Path, values: Mapping[str, Any], predictions: Path, limits: Limits, *, replace: bool
) -> None:
    """Write the folder of a submission; predictions that have a URL are not copied."""
    url = values["predictions"]["url"]
    if url is not None and predictions.is_dir():
        fix = "pack it into an archive such as predictions.zip, and publish that"
        raise UsageError("a folder, which has no address", where=predictions, fix=fix)
    size, name = size_of_tree(predictions), predictions.resolve().name
    if not re.match(SAFE_NAME, name) or name == SUBMISSION_FILE:
        name = f"predictions{re.sub('[^A-Za-z0-9.]', '', predictions.suffix)}"
    check_listing([(name, stat.S_IFREG, 0 if url else size)], "here", limits)
    given = {"sha256": sha256_of_tree(predictions), "bytes": size, **values["predictions"]}
    given |= {} if url else {"file": name}
    keys, path = {**values, "schema": 1, "predictions": given}, folder / SUBMISSION_FILE
    keys |= {key: [] if [*keys[key]] == ["none"] else [*keys[key]] for key in _LISTS}
    keys["pipeline"] = {"stages": keys.pop("stages")} | keys.get("pipeline", {})
    stated = validated(keys, Submission, SubmissionError, path, "option of that name")
    with atomic_folder(folder, replace=replace, mark=SUBMISSION_FILE) as staged:
        if url is None and predictions.is_dir():
            # Modes stay behind: on some disks every file is executable, which no board takes.
            shutil.copytree(predictions, staged / name, copy_function=shutil.copyfile)
        elif url is None:
            shutil.copyfile(predictions, staged / name)
        (staged / SUBMISSION_FILE).write_text(rules.submission_text(stated), "utf-8", newline="")


# --- git ---


def gh_account() -> int | None:
    """Return the id of the account that GitHub's command line is logged in with, if any is."""
    said = _run(Path(), "gh", "api", "user", "--jq", ".id")
    return int(said) if said and said.strip().isdecimal() else None


def switch_branch(root: Path, branch: str, base: str) -> None:
    """Begin a branch anew from the board's own, whatever is checked out."""
    if _run(root, "git", "switch", "--quiet", "--no-track", "-C", branch, base) is None:
        fix = "commit or stash what is changed in this clone, or add --no-commit"
        raise UsageError(f"git cannot begin {branch} from {base}", where=root, fix=fix)


def open_pull_request(root: Path, place: Place, branch: str, title: str) -> list[str]:
    """Commit the folder on the branch and open a pull request; return the steps left."""
    steps = [f"git push --force -u origin {branch}", "gh pr create --fill"]
    commit = ("commit", "--quiet", "-m", title, "--", place.path)
    if any(_run(root, "git", *words) is None for words in (("add", "--", place.path), commit)):
        return [f"git add {place.path}", "git commit", *steps]
    if shutil.which("gh") is None or not sys.stdin.isatty():
        return steps
    done = subprocess.run([*steps[1].split(), "--title", title], cwd=root, check=False)
    return steps if done.returncode else []


def _run(folder: Path, *command: str) -> str | None:
    """Return the output of a command, None where it failed or is not installed."""
    if shutil.which(command[0]) is None:
        return None
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return None if done.returncode else done.stdout
