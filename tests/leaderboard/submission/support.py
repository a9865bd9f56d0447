"""A board of the made benchmark, and submissions to it."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.leaderboard.board import BOARD_FILE, Board, known_submissions, read_board
from airzoo_bench.leaderboard.checks import CheckedSubmission, check_submission
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, submission_text
from tests.support import write_predictions

PROTOCOL = "made-retrieval"


def values(**changes: Any) -> dict[str, Any]:
    """Return the keys of a sound submission, some changed; None takes a key out."""
    found: dict[str, Any] = {
        "schema": 1,
        "protocol": PROTOCOL,
        "method": "SALAD",
        "team": "Example Lab",
        "contact": "ada@example.org",
        "authors": ["Ada Example"],
        "date": datetime.date(2026, 11, 22),
        "licence": "CC-BY-4.0",
        "training_data": ["gsv-cities"],
        "pipeline": {"stages": "single-stage"},
        "predictions": {"file": "preds.npz", "sha256": "0" * 64, "bytes": 1},
    } | changes
    return {key: value for key, value in found.items() if value is not None}


def submission(**changes: Any) -> Submission:
    return Submission.model_validate(values(**changes))


def write_board(root: Path, more: str = "") -> Board:
    """Write the leaderboard.toml of a board of the made benchmark."""
    root.mkdir(parents=True, exist_ok=True)
    (root / BOARD_FILE).write_text(
        f'schema = 1\ntitle = "Made"\n{more}\n[[benchmarks]]\nname = "made"\ntitle = "Made"\n'
        f'protocols = ["{PROTOCOL}"]\n',
        encoding="utf-8",
    )
    return read_board(root / BOARD_FILE)


def write(root: Path, arrays: dict[str, Any], folder: str = "salad", **changes: Any) -> Path:
    """Write a submission with its predictions and their hash, and return its folder."""
    home = root / "submissions" / "made" / "retrieval" / folder
    home.mkdir(parents=True)
    file = write_predictions(home / "preds.npz", PROTOCOL, **arrays)
    given = {"sha256": sha256_of_tree(file), "bytes": file.stat().st_size, "file": file.name}
    stated = submission(**({"predictions": given} | changes))
    (home / SUBMISSION_FILE).write_text(submission_text(stated), encoding="utf-8")
    return home


def checked(folder: Path, data: Path, seconds: float = 0.0) -> CheckedSubmission:
    """Check a folder as the command line does."""
    root = folder.parents[3]
    board = read_board(root / BOARD_FILE)
    return check_submission(folder, board, data, known=known_submissions(root), seconds=seconds)


def only_error(found: CheckedSubmission) -> str:
    assert len(found.errors) == 1, [str(error) for error in found.errors]
    return str(found.errors[0])
