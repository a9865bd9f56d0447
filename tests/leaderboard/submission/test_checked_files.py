"""Where a submission lies, and which files it may have."""

from __future__ import annotations

import datetime
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.leaderboard.submission.support import checked, only_error, write, write_board


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("mad/retrieval/salad", "no place for a submission (did you mean 'made'?)"),
        ("made/matching/salad", "the folder is of matching of made"),
        ("made/retrieval/nul", "no place for a submission"),  # Windows takes it for a device
    ],
)
def test_another_place(board: Path, data: Path, perfect: Any, place: str, said: str) -> None:
    home, moved = write(board, perfect), board / "submissions" / place
    moved.parent.mkdir(parents=True, exist_ok=True)
    shutil.move(home, moved)
    assert said in only_error(checked(moved, data))


@pytest.mark.parametrize("protocol", ["airzoo-mini-retrieval", "own.toml"])
def test_a_protocol_that_the_board_has_not_or_that_is_a_path(
    board: Path, data: Path, perfect: Any, protocol: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(board)
    (board / "own.toml").write_text("x", encoding="utf-8")
    home = write(board, perfect, protocol=protocol)
    assert "by which this board does not score made" in only_error(checked(home, data))


def _deep(home: Path) -> None:
    deep = home.joinpath(*"abcdefgh")
    deep.mkdir(parents=True)
    (deep / "x").touch()


def _changed(home: Path, content: Callable[[bytes], bytes]) -> None:
    file = home / "preds.npz"
    file.write_bytes(content(file.read_bytes()))


FILES: dict[str, tuple[Callable[[Path], object], str]] = {
    "a link": (
        lambda home: (home / "names.txt").symlink_to("/etc/passwd"),
        "is no file: a link",
    ),
    "a pipe": (lambda home: os.mkfifo(home / "pipe"), "is no file: a link"),
    "unnamed": (lambda home: (home / "conftest.py").touch(), "1 entry (conftest.py)"),
    "blank": (lambda home: (home / "my scene.npz").touch(), "the name is not plain"),
    "hidden": (lambda home: (home / ".hidden").touch(), "the name is not plain"),
    "device": (lambda home: (home / "aux.npz").touch(), "the name is not plain"),
    "umlaut": (lambda home: (home / "ä.npz").touch(), "the name is not plain"),
    "twins": (
        lambda home: (home / "PREDS.npz").touch(),
        "differs from another name only in case",
    ),
    "deep": (_deep, "lies in more than 12 folders"),
    "executable": (lambda home: (home / "preds.npz").chmod(0o755), "is an executable file"),
    "missing": (
        lambda home: (home / "preds.npz").unlink(),
        "key 'predictions.file' is 'preds.npz', which is not there",
    ),
    "other bytes": (
        lambda home: _changed(home, lambda c: c[:-1] + bytes([c[-1] ^ 1])),
        "key 'predictions.sha256' is",
    ),
    "more bytes": (lambda home: _changed(home, lambda c: c + b"x"), "key 'predictions.bytes' is"),
    "no submission": (
        lambda home: (home / "submission.toml").unlink(),
        "no such submission file",
    ),
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
    assert "key 'date' is 9999-12-31, which is to come" in only_error(checked(home, data))
    write_board(board, "[limits]\ncommitted_bytes = 1000\n")
    assert "at most 1,000 bytes" in only_error(checked(home, data))
    monkeypatch.setattr("airzoo_bench.leaderboard.checks.MOST_FILES", 1)
    assert "more than 1 files and folders" in only_error(checked(home, data))
