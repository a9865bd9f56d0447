"""What the check of a submission's folder refuses, and of what it warns; the board's own ones."""

from __future__ import annotations

import datetime
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.board import BOARD_FILE, known_submissions, read_board
from airzoo_bench.leaderboard.checks import (
    FETCHED,
    check_pipeline,
    check_submission,
    size_of_tree,
)
from airzoo_bench.leaderboard.scoring import score_submission
from tests.leaderboard.submission.support import checked, only_error, submission, write, write_board
from tests.statistics.support import made_method

CHECKOUT = Path(__file__).resolve().parents[3]


@pytest.fixture
def board(tmp_path: Path) -> Path:
    """Return a board to submit to."""
    write_board(tmp_path / "board")
    return tmp_path / "board"


def test_a_sound_submission_has_no_fault(board: Path, data: Path, perfect: Any) -> None:
    found = checked(write(board, perfect), data)
    assert (found.errors, found.warnings) == ([], [])
    assert found.protocol is not None
    assert found.protocol.name == "made-retrieval"
    assert found.predictions == found.folder / "preds.npz"


def test_predictions_are_held_to_the_benchmark(board: Path, data: Path, perfect: Any) -> None:
    perfect["ranked_ids"][0][1] = perfect["ranked_ids"][0][0]
    assert "each tile once a query" in only_error(checked(write(board, perfect), data))


@pytest.mark.parametrize(
    ("place", "named"),
    [
        ("mad/retrieval/salad", "'made'"),
        ("made/matching/salad", "the folder is of matching of made"),
        ("made/retrieval/nul", "no place for a submission"),  # Windows takes it for a device
    ],
)
def test_another_place(board: Path, data: Path, perfect: Any, place: str, named: str) -> None:
    home, moved = write(board, perfect), board / "submissions" / place
    moved.parent.mkdir(parents=True, exist_ok=True)
    shutil.move(home, moved)
    assert named in only_error(checked(moved, data))


@pytest.mark.parametrize("protocol", ["airzoo-mini-retrieval", "own.toml"])
def test_a_protocol_that_the_board_has_not_or_that_is_a_path(
    board: Path, data: Path, perfect: Any, protocol: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(board)
    (board / "own.toml").write_text("x", encoding="utf-8")
    home = write(board, perfect, protocol=protocol)
    assert "by which this board does not score made" in only_error(checked(home, data))


def _deep(home: Path) -> None:
    (home / "a/b/c/d/e/f/g/h").mkdir(parents=True)
    (home / "a/b/c/d/e/f/g/h/x").touch()


def _change(home: Path, content: Callable[[bytes], bytes]) -> None:
    file = home / "preds.npz"
    file.write_bytes(content(file.read_bytes()))


FILES: dict[str, tuple[Callable[[Path], object], str]] = {
    "a link": (lambda home: (home / "names.txt").symlink_to("/etc/passwd"), "is no file: a link"),
    "a pipe": (lambda home: os.mkfifo(home / "pipe"), "is no file: a link"),
    "unnamed": (lambda home: (home / "conftest.py").touch(), "1 entry (conftest.py)"),
    "blank": (lambda home: (home / "my scene.npz").touch(), "not plain"),
    "hidden": (lambda home: (home / ".hidden").touch(), "not plain"),
    "device": (lambda home: (home / "aux.npz").touch(), "not plain"),
    "umlaut": (lambda home: (home / "ä.npz").touch(), "not plain"),
    "twins": (lambda home: (home / "PREDS.npz").touch(), "only in case"),
    "deep": (_deep, "more than 12 folders"),
    "executable": (lambda home: (home / "preds.npz").chmod(0o755), "executable"),
    "missing": (lambda home: (home / "preds.npz").unlink(), "'predictions.file' is 'preds.npz'"),
    "other bytes": (lambda h: _change(h, lambda c: c[:-1] + bytes([c[-1] ^ 1])), ".sha256'"),
    "more bytes": (lambda home: _change(home, lambda c: c + b"x"), "'predictions.bytes'"),
    "no submission": (lambda home: (home / "submission.toml").unlink(), "no such submission file"),
}


@pytest.mark.parametrize("name", FILES)
def test_files_that_ci_refuses(board: Path, data: Path, perfect: Any, name: str) -> None:
    home = write(board, perfect)
    change, said = FILES[name]
    change(home)
    assert said in only_error(checked(home, data))


def test_limits_and_dates(
    board: Path, data: Path, perfect: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = write(board, perfect, date=datetime.date(9999, 12, 31))
    assert "key 'date' is 9999-12-31" in only_error(checked(home, data))
    write_board(board, "[limits]\ncommitted_bytes = 1000\n")
    assert "at most 1,000 bytes" in only_error(checked(home, data))
    monkeypatch.setattr("airzoo_bench.leaderboard.checks.MOST_FILES", 1)
    assert "more than 1 files and folders" in only_error(checked(home, data))


def by_address(board: Path, perfect: Any, **changes: Any) -> tuple[Path, dict[str, Any], Path]:
    """Write a submission whose predictions are elsewhere; return it, what it states, and them."""
    file = write(board, perfect, folder="source") / "preds.npz"
    given = {"url": "https://example.org/preds.npz", "bytes": file.stat().st_size}
    given |= {"sha256": sha256_of_tree(file)} | changes
    home = write(board, perfect, method="Other", predictions=given)
    (home / "preds.npz").unlink()
    return home, given, file


def test_predictions_are_fetched_where_that_is_asked_and_kept(
    board: Path, data: Path, perfect: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    home, given, file = by_address(board, perfect)
    asked = []

    def fetch(url: str, into: Path, *, size: int, sha256: str, seconds: float) -> Path:
        asked.append((url, size, sha256))
        into.mkdir(parents=True)
        (into / ".preds.npz.part").touch()
        return Path(shutil.copy(file, into))

    monkeypatch.setattr("airzoo_bench.leaderboard.checks.fetch", fetch)
    assert checked(home, data).predictions is None
    for seconds in (1.0, 0.0):
        found = checked(home, data, seconds)
        assert not found.errors
        assert found.predictions is not None
        assert found.predictions.is_relative_to(data / FETCHED)
    assert asked == [(given["url"], given["bytes"], given["sha256"])]


def test_what_is_never_fetched_is_refused_before(board: Path, data: Path, perfect: Any) -> None:
    home = by_address(board, perfect, url="https://169.254.169.254/preds.npz")[0]
    assert "https://HOST/PATH" in only_error(checked(home, data))
    shutil.rmtree(board / "submissions")
    write_board(board, "[limits]\nurl_bytes = 100\n")
    assert "at most 100" in only_error(checked(by_address(board, perfect)[0], data))


@pytest.mark.parametrize(
    ("changes", "error", "warning"),
    [
        ({"method": "Salad", "team": "Other"}, "'Salad', which looks like 'SALAD'", ""),
        ({"method": "New", "team": "Example Iab"}, "which looks like 'Example Lab'", ""),
        ({}, "has a method 'SALAD' here already, in salad", ""),
        ({"method": "S-A-L-A-D"}, "a method 'SALAD' here already, in salad", ""),
        ({"method": "Mine", "team": "Other"}, "", "to the last byte those of 'SALAD'"),
        ({"team": "Other"}, "", "'SALAD' is on this board already, of team 'Example Lab'"),
    ],
)
def test_names_and_predictions_that_are_there_already(
    board: Path, data: Path, perfect: Any, changes: dict[str, Any], error: str, warning: str
) -> None:
    write(board, perfect)
    found = checked(write(board, perfect, "second", **changes), data)
    if error:
        assert error in only_error(found)
    else:
        assert not found.errors
        assert any(warning in one for one in found.warnings)


def test_supersedes_is_ignored_with_a_note(board: Path, data: Path, perfect: Any) -> None:
    home = write(board, perfect)
    file = home / "submission.toml"
    file.write_text('supersedes = "nothing"\n' + file.read_text())
    found = checked(home, data)
    assert not found.errors
    assert "'supersedes'" in found.warnings[0]


def test_poses_that_are_the_prior_belong_to_its_class() -> None:
    result = made_method({"east": {"recall@1": [1.0] * 10}}).result
    counts = {scene: c | {"near_prior": 2} for scene, c in result.counts.items()}
    result = result.model_copy(update={"counts": counts})
    assert "2 of 10 poses are the photo's own prior" in str(check_pipeline(submission(), result))
    uses = submission(pipeline={"stages": "single-stage", "uses": ["prior"]})
    assert check_pipeline(uses, result) is None


def test_those_of_this_repository_are_sound_and_small(tmp_path: Path) -> None:
    """Those on AirZoo-Mini are scored where it is made: tests/datasets/mini/test_prepare.py."""
    board, known = read_board(CHECKOUT / BOARD_FILE), known_submissions(CHECKOUT)
    assert {place.benchmark for place in known} >= {"airzoo-demo", "airzoo-mini"}
    for place in known:
        found = check_submission(CHECKOUT / place.path, board, tmp_path, known=known)
        assert not found.errors
        if place.benchmark == "airzoo-demo":
            scored = score_submission(found, tmp_path, Run())
            assert scored.result.counts["city"]["near_prior"] == 0
    assert size_of_tree(CHECKOUT / "submissions") < 1_500_000
