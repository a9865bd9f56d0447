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
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import typer
from pydantic import TypeAdapter, ValidationError

from airzoo_bench.core.errors import SubmissionError, UsageError
from airzoo_bench.core.files import atomic_folder, sha256_of_tree
from airzoo_bench.core.validation import SAFE_NAME, nearest, validated
from airzoo_bench.leaderboard import submission as rules
from airzoo_bench.leaderboard.board import Board, Limits, Place
from airzoo_bench.leaderboard.checks import check_listing, size_of_tree
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission
from airzoo_bench.protocol.model import find_protocol

_LISTS = ("authors", "training_data")


def ask_missing(given: Mapping[str, Any], more: Sequence[str]) -> dict[str, Any]:
    """Return the keys of submission.toml, once the missing ones were asked for.

    `given` is by key, None where an option is missing; `more` are further keys, such as
    ``paper=https://...``.
    """
    missing = [key for key, value in given.items() if value is None]
    if missing and not (sys.stdin.isatty() and sys.stderr.isatty()):
        names = [f"--{key.replace('_', '-').replace('authors', 'author')}" for key in missing]
        fix = "add these options, or call it on a terminal, where it asks"
        raise UsageError(f"missing: {', '.join(names)}", fix=fix)
    values = dict(given) | {key: _ask(key) for key in missing}
    values |= {key: [] if [*values[key]] == ["none"] else [*values[key]] for key in _LISTS}
    values |= {"pipeline": {"stages": values.pop("stages")}, "date": datetime.date.today()}
    for text in more:
        name, _, value = text.partition("=")
        try:
            [(name, found)] = tomllib.loads(text).items()
        except tomllib.TOMLDecodeError:  # a text without quotes
            found = value
        values[name] = values.get(name, {}) | found if isinstance(found, dict) else found
    return values


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
        expected = f"one of {', '.join(board.protocols)}"
        raise UsageError(what, where="--protocol", expected=expected)
    name = re.sub(r"[^a-z0-9]+", "-", method.casefold()).strip("-")[:64]
    name = name or f"method-{hashlib.sha256(method.encode()).hexdigest()[:8]}"
    chosen = find_protocol(protocol, data)
    return Place(chosen.benchmark, chosen.track, name)


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


def open_pull_request(root: Path, place: Place, title: str) -> list[str]:
    """Commit the folder on a branch of its own and open a pull request; return the steps left."""
    branch, push = f"submit-{place.folder}", ["gh", "pr", "create", "--fill"]
    steps = [f"git push -u origin {branch}", " ".join(push)]
    commit = ("commit", "--quiet", "-m", title, "--", place.path)
    calls = (("switch", "--quiet", "-C", branch), ("add", "--", place.path), commit)
    if any(_run(root, "git", *words) is None for words in calls):
        return [f"git switch -C {branch}", f"git add {place.path}", "git commit", *steps]
    if shutil.which("gh") is None or not sys.stdin.isatty():
        return steps
    done = subprocess.run([*push, "--title", title], cwd=root, check=False)
    return steps if done.returncode else []


def _run(folder: Path, *command: str) -> str | None:
    """Return the output of a command, None where it failed or is not installed."""
    if shutil.which(command[0]) is None:
        return None
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return None if done.returncode else done.stdout
