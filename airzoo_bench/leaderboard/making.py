"""Writing the folder of a submission, whole or not at all."""

from __future__ import annotations

import re
import shutil
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from airzoo_bench.core.errors import SubmissionError, UsageError
from airzoo_bench.core.files import atomic_entries, atomic_folder, sha256_of_tree
from airzoo_bench.core.validation import SAFE_NAME, nearest, validation_message
from airzoo_bench.leaderboard.board import BOARD_FILE, Board, read_board
from airzoo_bench.leaderboard.known import Place
from airzoo_bench.leaderboard.predictions_given import size_of_tree
from airzoo_bench.leaderboard.submission import (
    CLAIMED_FILE,
    SUBMISSION_FILE,
    Submission,
    submission_text,
)
from airzoo_bench.protocol.lookup import find_protocol

__all__ = ["Files", "board_root", "folder_name", "place_of", "write_submission"]

SUBMISSIONS = "submissions"


@dataclass(frozen=True)
class Files:
    """The files that a submission is made of.

    Attributes
    ----------
    predictions : Path
        The local file or folder.
    url : str or None
        Where others fetch it, if it is not to be copied.
    claimed : Path or None
        A result.json, or the folder that holds it.
    names : Path or None
        A list of image names.
    """

    predictions: Path
    url: str | None = None
    claimed: Path | None = None
    names: Path | None = None


def board_root(start: Path) -> Path:
    """Return the folder of the board that a path is in."""
    for folder in (start.resolve(), *start.resolve().parents):
        if (folder / BOARD_FILE).is_file():
            return folder
    raise UsageError(
        f"not in the repository of a board: no {BOARD_FILE} here or above",
        where=start,
        fix="clone the board's repository and go there, or name its folder by --board; "
        "`airzoo-bench leaderboard init` makes a board",
    )


def folder_name(method: str) -> str:
    """Return a plain name for the folder of a method."""
    return re.sub(r"[^a-z0-9]+", "-", method.casefold()).strip("-")[:64]


def place_of(protocol: str, folder: str, board: Board, data: Path) -> Place:
    """Return where a submission for a protocol stands on a board."""
    known = board.protocols
    if protocol not in known:
        raise UsageError(
            f"this board does not score by {protocol!r}{nearest(protocol, known)}",
            where="--protocol",
            expected=f"one of {', '.join(known)}",
        )
    if not re.match(SAFE_NAME, folder):
        raise UsageError(
            f"no name for a folder: {folder!r}",
            where="--folder",
            expected="letters a to z, digits, dots, hyphens and underscores, such as salad-2026",
            fix="name one by --folder; a method's name without such letters gives none",
        )
    chosen = find_protocol(protocol, data)
    return Place(chosen.benchmark, chosen.track, folder)


def write_submission(
    root: Path, place: Place, values: dict[str, Any], files: Files, *, replace: bool = False
) -> Path:
    """Write the folder of a submission."""
    board = read_board(root / BOARD_FILE)
    _check_inputs(files, board)
    given = _given(files) | {k: values[k] for k in ("reader",) if values.get(k)}
    rest = {key: value for key, value in values.items() if key != "reader"}
    submission = _validated(rest | {"schema": 1, "predictions": given})
    folder = root / SUBMISSIONS / place.benchmark / place.track / place.folder
    with _filled(folder, replace=replace) as staged:
        if files.url is None:
            _copy(files.predictions, staged / given["file"])
        if files.names is not None:
            shutil.copyfile(files.names, staged / given["names"])
        if files.claimed is not None:
            shutil.copyfile(_result_of(files.claimed), staged / CLAIMED_FILE)
        (staged / SUBMISSION_FILE).write_text(
            submission_text(submission), encoding="utf-8", newline=""
        )
    return folder


def _validated(values: dict[str, Any]) -> Submission:
    try:
        return Submission.model_validate(values)
    except ValidationError as error:
        raise SubmissionError(
            validation_message(error, Submission),
            where="what was given for submission.toml",
            fix="correct the option of that name; docs/submission.md says what each is for",
        ) from error


def _check_inputs(files: Files, board: Board) -> None:
    for path in (files.names, files.claimed and _result_of(files.claimed)):
        if path is not None and not path.exists():
            raise UsageError("no such file", where=path)
    size = size_of_tree(files.predictions)
    if files.url is not None and files.predictions.is_dir():
        raise UsageError(
            "a folder, which has no address",
            where=files.predictions,
            fix="pack it into an archive such as predictions.zip, and publish that",
        )
    if files.url is None and size > board.limits.committed_bytes:
        raise UsageError(
            f"takes {size:,} bytes",
            where=files.predictions,
            expected=f"at most {board.limits.committed_bytes:,} bytes in the repository",
            fix="publish it, such as on Zenodo or Hugging Face, and add --url https://...",
        )


def _given(files: Files) -> dict[str, Any]:
    path = files.predictions
    given: dict[str, Any] = {"sha256": sha256_of_tree(path), "bytes": size_of_tree(path)}
    given |= {"file": _plain(path)} if files.url is None else {"url": files.url}
    return given if files.names is None else given | {"names": _plain(files.names)}


def _plain(path: Path) -> str:
    """Return a file's name, or another with its ending where it is none for a submission."""
    name = path.resolve().name
    if re.match(SAFE_NAME, name) and name not in (SUBMISSION_FILE, CLAIMED_FILE):
        return name
    suffix = path.suffix if re.match(r"^\.[A-Za-z0-9]+$", path.suffix) else ""
    return f"predictions{suffix}"


def _result_of(claimed: Path) -> Path:
    return claimed / CLAIMED_FILE if claimed.is_dir() else claimed


def _copy(source: Path, target: Path) -> None:
    if source.is_dir():
        # Modes stay behind: on some disks every file is executable, which no board takes.
        shutil.copytree(source, target, copy_function=shutil.copyfile)
    else:
        shutil.copyfile(source, target)


def _filled(folder: Path, *, replace: bool) -> AbstractContextManager[Path]:
    if folder.is_dir() and replace:
        there = [entry.name for entry in folder.iterdir()]
        return atomic_entries(folder, there)
    return atomic_folder(folder)
