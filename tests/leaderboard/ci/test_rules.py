"""What a pull request may change, and when its commits are read."""

from __future__ import annotations

import base64
from pathlib import Path

import pytest

from airzoo_bench.leaderboard.ci.event import PullRequest
from airzoo_bench.leaderboard.ci.git import BoardError, Repository
from airzoo_bench.leaderboard.ci.git_process import GitProcess
from airzoo_bench.leaderboard.ci.rules import fetch_pull_request, touched
from tests.leaderboard.ci.pull_requests import BOARD, HOME, MAINTAINER, MINE, SOUND, TOML, World
from tests.leaderboard.ci.repositories import git


def test_ref_that_the_remote_lacks_is_named(world: World) -> None:
    head = world.hosted.tip("main")
    with pytest.raises(BoardError, match="couldn't find remote ref refs/pull/77/head") as found:
        world.look(77, head)
    assert str(world.hosted.folder) in str(found.value)


def test_sound_submission_is_read_to_the_byte(world: World) -> None:
    head = world.hosted.pull_of(1, SOUND)
    assert world.look(1, head) == []
    assert (world.folder / "out" / HOME / "mine" / "submission.toml").read_bytes() == TOML
    assert not (world.folder / "out" / HOME / "theirs").exists()


def test_pull_request_without_submission_is_none_of_ours(world: World) -> None:
    head = world.hosted.pull_of(1, {"docs/a.md": b"text"})
    pull = PullRequest(1, head, "refs/pull/1/head", "main", MINE, merged=False)
    repository = Repository.create(world.folder / "bare.git", str(world.hosted.folder))
    fetch_pull_request(repository, pull)
    assert touched(repository, pull, BOARD, []) is None


def test_large_change_of_something_else_is_none_of_ours(world: World) -> None:
    head = world.hosted.pull_of(1, {f"docs/{number}.md": b"text" for number in range(3000)})
    pull = PullRequest(1, head, "refs/pull/1/head", "main", MINE, merged=False)
    repository = Repository.create(world.folder / "bare.git", str(world.hosted.folder))
    fetch_pull_request(repository, pull)
    assert touched(repository, pull, BOARD, []) is None


def test_head_three_commits_behind_main_changes_only_its_own(world: World) -> None:
    head = world.hosted.pull_of(1, SOUND)
    for number in range(3):
        name = f"{HOME}/later{number}/submission.toml"
        world.hosted.move("refs/heads/main", world.hosted.commit(world.hosted.tip(), {name: b"a"}))
    assert world.look(1, head) == []


def test_own_folder_may_be_updated_and_withdrawn(world: World) -> None:
    assert world.look(1, world.hosted.pull_of(1, {f"{HOME}/old/p.npz": b"new"})) == []
    gone = {f"{HOME}/old/p.npz": None, f"{HOME}/old/submission.toml": None}
    (world.folder / "bare.git").rename(world.folder / "before.git")
    assert world.look(2, world.hosted.pull_of(2, gone)) == []


def test_maintainer_may_change_what_others_own(world: World) -> None:
    head = world.hosted.pull_of(1, {f"{HOME}/theirs/p.npz": b"mended"})
    assert world.look(1, head, MAINTAINER) == []


def test_many_files_are_fetched_in_few_steps_and_only_these(world: World) -> None:
    files = {f"{HOME}/mine/p/{number}.npz": f"{number}".encode() for number in range(150)}
    assert world.look(1, world.hosted.pull_of(1, SOUND | files)) == []
    bare = world.folder / "bare.git"
    for number in range(150):
        out = world.folder / "out" / HOME / "mine" / "p" / f"{number}.npz"
        assert out.read_bytes() == f"{number}".encode()
    theirs = git(world.hosted.folder, "rev-parse", f"main:{HOME}/theirs/p.npz")
    listed = git(bare, "cat-file", "--batch-all-objects", "--batch-check=%(objectname)").split()
    assert theirs not in listed
    assert len(list((bare / "objects" / "pack").glob("*.pack"))) < 10


def test_history_of_its_own(world: World) -> None:
    head = world.hosted.commit(None, SOUND)
    world.hosted.pull(1, head)
    [fault] = world.look(1, head)
    assert "no history in common" in fault.what


def test_folder_that_has_changed_on_main_meanwhile(world: World) -> None:
    head = world.hosted.pull_of(1, {f"{HOME}/old/p.npz": b"one"})
    now = world.hosted.commit(world.hosted.tip(), {f"{HOME}/old/p.npz": b"two"})
    world.hosted.move("refs/heads/main", now)
    [fault] = world.look(1, head)
    assert fault.what == "has changed on the board since this branch began"


def test_new_folder_that_another_has_brought_meanwhile(world: World) -> None:
    head = world.hosted.pull_of(1, SOUND)
    now = world.hosted.commit(world.hosted.tip(), {f"{HOME}/mine/submission.toml": b"theirs"})
    world.hosted.move("refs/heads/main", now)
    [fault] = world.look(1, head)
    assert "belongs to another account" in fault.what


def test_commit_that_was_pushed_away_is_no_fault_of_the_submission(world: World) -> None:
    head = world.hosted.commit(world.hosted.tip(), SOUND)
    world.hosted.pull_of(1, SOUND | {f"{HOME}/mine/p.npz": b"newer"})
    with pytest.raises(BoardError, match="no longer part of pull request 1"):
        world.look(1, head)


def test_head_is_scored_at_the_commit_of_the_event_though_a_newer_one_is_there(
    world: World,
) -> None:
    head = world.hosted.pull_of(1, SOUND)
    world.hosted.pull_of(1, {f"{HOME}/mine/p.npz": b"newer"}, parent=head)
    assert world.look(1, head) == []
    assert (world.folder / "out" / HOME / "mine" / "p.npz").read_bytes() == b"1"


def test_token_goes_to_the_remote_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GIT_TOKEN", "of-the-job")
    process = GitProcess(tmp_path, "https://github.com/lab/board.git")
    key, _, _, header = process.run("config", "--get-regexp", "extraheader").decode().split()
    assert key == "http.https://github.com/lab/board.git.extraheader"
    assert base64.b64decode(header) == b"x-access-token:of-the-job"
