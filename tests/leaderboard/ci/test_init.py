"""`leaderboard init`: what it writes, what it leaves alone, and what is the board's own fault."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from airzoo_bench.leaderboard.board import read_board
from airzoo_bench.leaderboard.starter.write import starter_files
from airzoo_bench.leaderboard.submission import SCHEMA_LINE, schema_text
from tests.leaderboard.ci.repositories import Hosted, event, write_event
from tests.support import run_main


def test_init_writes_a_board_that_can_be_read(tmp_path: Path) -> None:
    assert run_main("leaderboard", "init", tmp_path / "b", "--repository", "lab/x-1") == 0
    board = read_board(tmp_path / "b" / "leaderboard.toml")
    assert (board.url, board.repository) == ("https://lab.github.io/x-1/", "lab/x-1")
    assert board.data_url == "https://github.com/lab/x-1/tree/leaderboard-data"
    assert (tmp_path / "b" / ".github" / "workflows" / "board.yml").is_file()
    assert (tmp_path / "b" / ".ci" / "get-data").stat().st_mode & 0o111


def test_data_that_are_there_are_not_made_again(tmp_path: Path) -> None:
    assert run_main("leaderboard", "init", tmp_path / "b") == 0
    (tmp_path / "data" / "airzoo-mini").mkdir(parents=True)
    environment = {"PATH": "/usr/bin:/bin", "AIRZOO_BENCH_DATA": str(tmp_path / "data")}
    subprocess.run([tmp_path / "b" / ".ci" / "get-data"], check=True, env=environment)


def test_an_artifact_that_is_not_there_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ("leaderboard", "comment", tmp_path / "found.json", "--out", tmp_path / "c.md")
    assert run_main(*call) == 2
    assert "found.json: no such artifact" in capsys.readouterr().err


def test_board_without_a_name_can_be_read_too(tmp_path: Path) -> None:
    assert run_main("leaderboard", "init", tmp_path / "b") == 0
    assert read_board(tmp_path / "b" / "leaderboard.toml").repository is None


def test_the_schema_lies_where_each_submission_names_it(tmp_path: Path) -> None:
    assert run_main("leaderboard", "init", tmp_path / "b") == 0
    folder = tmp_path / "b" / "submissions" / "benchmark" / "track" / "method"
    _, _, place = SCHEMA_LINE.partition("#:schema ")
    assert (folder / place).resolve().read_text(encoding="utf-8") == schema_text()


@pytest.mark.parametrize("path", starter_files(None))
def test_init_replaces_no_file_and_then_writes_none(
    tmp_path: Path, path: str, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / path
    own.parent.mkdir(parents=True, exist_ok=True)
    own.write_text("mine")
    assert run_main("leaderboard", "init", tmp_path) == 2
    assert f"none is replaced: 1 ({path})" in capsys.readouterr().err
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [own]
    assert own.read_text() == "mine"


@pytest.mark.parametrize("name", ["lab", "lab/x/y", "lab/", "a b/c", "lab/x;y", "läb/x"])
def test_repository_must_be_a_name(tmp_path: Path, name: str) -> None:
    assert run_main("leaderboard", "init", tmp_path / "b", "--repository", name) == 2
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize("fault", ["event", "board", "remote", "work"])
def test_faults_of_the_board_are_none_of_a_submission(
    tmp_path: Path, fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run_main("leaderboard", "init", tmp_path / "b")
    hosted = Hosted.create(tmp_path / "hosted.git", {"README.md": b"x"})
    files = {"submissions/airzoo-mini/retrieval/x/submission.toml": b"x"}
    head = hosted.pull_of(1, files)  # type: ignore[arg-type]
    file, remote = write_event(tmp_path / "event.json", event(1, head)), hosted.folder
    if fault == "event":
        file.write_text("{}")
    if fault == "board":
        (tmp_path / "b" / "leaderboard.toml").write_text("schema = 9\n")
    if fault == "remote":
        remote = tmp_path / "nowhere.git"
    if fault == "work":
        (tmp_path / "work" / "submissions").mkdir(parents=True)
    code = run_main(
        "leaderboard", "score", "--event", file, "--remote", remote, "--root",
        tmp_path / "b", "--data", tmp_path, "--work", tmp_path / "work", "--out", tmp_path / "f",
    )  # fmt: skip
    assert code == 2
    assert not (tmp_path / "f").exists()
    assert capsys.readouterr().err.count("airzoo-bench: ") == 1
