"""`leaderboard init`: what it writes, what it leaves alone, and what is the board's own fault."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from airzoo_bench.leaderboard.board import read_board
from tests.leaderboard.hosting import Hosted, event, write_event
from tests.support import run_main


def test_init_writes_a_board_that_can_be_read(tmp_path: Path) -> None:
    home = tmp_path / "b"
    assert run_main("leaderboard", "init", home, "--repository", "lab/x-1") == 0
    board = read_board(home / "leaderboard.toml")
    assert (board.url, board.repository) == ("https://lab.github.io/x-1/", "lab/x-1")
    assert (home / ".github" / "workflows" / "board.yml").is_file()
    (tmp_path / "data" / "airzoo-mini").mkdir(
        parents=True
    )  # data that are there are not made again
    environment = {"PATH": "/usr/bin:/bin", "AIRZOO_BENCH_DATA": str(tmp_path / "data")}
    subprocess.run([home / ".ci" / "get-data"], check=True, env=environment)
    assert run_main("leaderboard", "init", tmp_path / "c") == 0
    assert read_board(tmp_path / "c" / "leaderboard.toml").repository is None


@pytest.mark.parametrize("path", ["leaderboard.toml", ".github/workflows/board.yml", ".gitignore"])
def test_init_replaces_no_file_and_then_writes_none(
    tmp_path: Path, path: str, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / path
    own.parent.mkdir(parents=True, exist_ok=True)
    own.write_text("mine")
    assert run_main("leaderboard", "init", tmp_path) == 2
    assert f"none is replaced: 1 ({path})" in capsys.readouterr().err
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [own]
    assert run_main("leaderboard", "init", tmp_path / "b", "--repository", "lab/x;y") == 2
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize("fault", ["event", "board", "remote", "work"])
def test_faults_of_the_board_are_none_of_a_submission(
    tmp_path: Path, fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run_main("leaderboard", "init", tmp_path / "b")
    hosted = Hosted.create(tmp_path / "hosted.git", {"README.md": b"x"})
    head = hosted.pull_of(1, {"submissions/airzoo-mini/retrieval/x/submission.toml": b"x"})
    file, remote = write_event(tmp_path / "event.json", event(1, head)), hosted.folder
    if fault == "event":
        file.write_text("{}")
    if fault == "board":
        (tmp_path / "b" / "leaderboard.toml").write_text("schema = 9\n")
    if fault == "remote":
        remote = tmp_path / "nowhere.git"
    if fault == "work":
        (tmp_path / "work" / "submissions").mkdir(parents=True)
    call = ("leaderboard", "score", "--event", file, "--remote", remote, "--root", tmp_path / "b")
    places = ("--work", tmp_path / "work", "--out", tmp_path / "f")
    assert run_main(*call, *places) == 2
    assert not (tmp_path / "f").exists()
    assert capsys.readouterr().err.count("airzoo-bench: ") == 1
