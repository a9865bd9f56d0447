"""Pull requests whose folders no list of files shows, or more than are looked at."""

from __future__ import annotations

import pytest

from tests.leaderboard.ci.pull_requests import HOME, SOUND, World
from tests.leaderboard.ci.repositories import File, git


def _with_folder(world: World, head: str, path: str, tree: str) -> str:
    """Open a pull request of a commit with one more folder, such as no index can have."""
    folder, (*above, name) = world.hosted.folder, path.split("/")
    for end in range(len(above), -1, -1):
        lines = git(folder, "ls-tree", f"{head}:{'/'.join(above[:end])}").splitlines()
        kept = [line for line in lines if line.split("\t")[1] != name]
        kept.append(f"040000 tree {tree}\t{name}")
        tree = git(folder, "mktree", stdin="\n".join([*kept, ""]).encode())
        name = above[end - 1] if end else name
    made = world.hosted.commit_tree(head, tree)
    world.hosted.pull(1, made)
    return made


@pytest.mark.parametrize(
    ("path", "said"),
    [
        (f"{HOME}/theirs/empty", "changes more than one folder"),
        (f"{HOME}/mine/empty", "is an empty folder"),
        ("docs", "changes other files than those of a submission"),
    ],
)
def test_folders_without_files_are_changes_too(world: World, path: str, said: str) -> None:
    """Git's list of files shows none, and yet the id of the folder above is another."""
    empty = git(world.hosted.folder, "mktree")
    head = _with_folder(world, world.hosted.pull_of(1, SOUND), path, empty)
    [fault] = world.look(1, head)
    assert said in fault.what


def test_changes_that_are_not_all_looked_at_are_not_counted(world: World) -> None:
    files: dict[str, File | None] = {f"{HOME}/one{n}/p.npz": b"1" for n in range(30)}
    [fault] = world.look(1, world.hosted.pull_of(1, files))
    assert fault.what.startswith("changes more than one folder: at least 20 (first 3: ")


def test_pull_request_of_an_empty_folder_alone(world: World) -> None:
    empty = git(world.hosted.folder, "mktree")
    [fault] = world.look(1, _with_folder(world, world.hosted.tip(), f"{HOME}/mine", empty))
    assert fault.what == "is an empty folder"


def test_folders_without_end_and_without_files(world: World) -> None:
    """A few small trees, each sixteen times in the next, are a million years of walking."""
    tree = git(world.hosted.folder, "mktree")
    for _ in range(12):
        lines = "".join(f"040000 tree {tree}\td{number:02}\n" for number in range(16))
        tree = git(world.hosted.folder, "mktree", stdin=lines.encode())
    head = world.hosted.pull_of(1, SOUND)
    [fault] = world.look(1, _with_folder(world, head, f"{HOME}/mine/deep", tree))
    assert "more than 2,000 files and folders" in fault.what
