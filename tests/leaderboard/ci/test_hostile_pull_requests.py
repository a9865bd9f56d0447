"""Pull requests that reach beyond their own folder are refused."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
import tomli_w
from typer.testing import Result

from airzoo_bench.core.errors import UserError
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.git import RefusedError, Repository
from airzoo_bench.leaderboard.pull_request import (
    PullRequest,
    fetch_pull_request,
    find_touched,
    read_files,
)
from tests.leaderboard.hosting import File, Hosted, event, git, write_event
from tests.leaderboard.rendered import outside_code

MINE, OTHER, MAINTAINER = 7, 8, 9
HOME = "submissions/made/retrieval"
BOARD = Board.model_validate(
    {
        "schema": 1,
        "title": "A board",
        "benchmarks": [{"name": "made", "title": "Made", "protocols": ["made-retrieval"]}],
        "maintainers": [MAINTAINER],
        "limits": {"committed_bytes": 1_000_000},
    }
)
TOML = b'schema = 1\nmethod = "Salad"\naccount = 7\n'
SOUND: dict[str, File | None] = {f"{HOME}/mine/submission.toml": TOML, f"{HOME}/mine/p.npz": b"1"}


@dataclass
class World:
    hosted: Hosted
    folder: Path

    def look(self, number: int, head: str, account: int = MINE) -> list[UserError]:
        """Return what is wrong with a pull request."""
        pull = PullRequest(number, head, "main", account)
        repository = Repository(self.folder / "bare.git", str(self.hosted.folder))
        try:
            fetch_pull_request(repository, pull)
            found = find_touched(
                repository, pull, BOARD, lambda place: OTHER if place.folder == "gone" else None
            )
            assert found is not None
            into = self.folder / "out"
            return read_files(repository, head, found.place, BOARD, into) if found.tree else []
        except RefusedError as error:
            return [error]


@pytest.fixture
def world(tmp_path: Path) -> World:
    files: dict[str, File] = {
        "README.md": b"a board\n",
        f"{HOME}/theirs/submission.toml": b'method = "Theirs"\naccount = 8\n',
        f"{HOME}/theirs/p.npz": b"theirs",
        f"{HOME}/old/submission.toml": b'method = "Old"\naccount = 7\n',
        f"{HOME}/old/p.npz": b"old",
    }
    return World(Hosted.create(tmp_path / "hosted.git", files), tmp_path / "ci")


TWO, NOT_PLAIN, NO_FOLDER = "more than one folder", "not plain", "not the folder of a submission"
ANOTHER, CASE, A_LINK = "another account", "only in case", "a link, a submodule"
MINE_NOW: dict[str, File | None] = {f"{HOME}/theirs/p.npz": b"mine now"}
HOSTILE: dict[str, tuple[dict[str, File | None], str]] = {
    "two submissions": (SOUND | {f"{HOME}/second/submission.toml": TOML}, f"{TWO}: 2"),
    "someone else's folder": (MINE_NOW, ANOTHER),
    "a folder that someone else had": ({f"{HOME}/gone/submission.toml": TOML}, ANOTHER),
    "one's own folder and another's": (SOUND | MINE_NOW, TWO),
    "a workflow besides": (SOUND | {".github/workflows/x.yml": b"on: push\n"}, "1 (.github/wo"),
    "attributes in the folder": (SOUND | {f"{HOME}/mine/.gitattributes": b"* f=x\n"}, NOT_PLAIN),
    "hidden file": (SOUND | {f"{HOME}/mine/.env": b"x"}, NOT_PLAIN),
    "case-only rename of a folder": ({f"{HOME}/Theirs/submission.toml": TOML}, CASE),
    "names that differ in case": (SOUND | {f"{HOME}/mine/P.npz": b"2"}, CASE),
    "blank": (SOUND | {f"{HOME}/mine/a b.npz": b"x"}, NOT_PLAIN),
    "leading dash": (SOUND | {f"{HOME}/mine/-rf": b"x"}, NOT_PLAIN),
    "folder with a leading dash": ({f"{HOME}/--help/submission.toml": TOML}, NO_FOLDER),
    "not UTF-8": (SOUND | {f"{HOME}/mine/\udcff.npz": b"x"}, NOT_PLAIN),
    "deep folders": (SOUND | {f"{HOME}/mine/{'a/' * 20}x": b"x"}, "more than 12 folders"),
    "symbolic link": (SOUND | {f"{HOME}/mine/link": ("120000", b"/etc/passwd")}, A_LINK),
    "submodule": (SOUND | {f"{HOME}/mine/sub": ("160000", b"a" * 40)}, A_LINK),
    "executable": (SOUND | {f"{HOME}/mine/run": ("100755", b"#!/bin/sh\n")}, "executable"),
    "the folder itself is a link": ({f"{HOME}/mine": ("120000", b"theirs")}, NO_FOLDER),
    "file beside the folders": ({f"{HOME}/x.toml": TOML}, NO_FOLDER),
    "unknown benchmark": ({"submissions/mode/retrieval/x/submission.toml": TOML}, "'made'?"),
    "unknown track": ({"submissions/made/retreival/x/submission.toml": TOML}, "'retrieval'?"),
    "metadata of 50 MB": (SOUND | {f"{HOME}/mine/submission.toml": b"a = 1\n" * 8_400_000}, "50,4"),
    "large predictions": (SOUND | {f"{HOME}/mine/p.npz": b"x" * 1_000_001}, "1,000,000 bytes"),
    "100,000 files": (
        SOUND | {f"{HOME}/mine/f{number}": b"x" for number in range(100_000)}, "2,000 files"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_pull_request_is_refused_with_its_message(world: World, name: str) -> None:
    files, message = HOSTILE[name]
    faults = world.look(1, world.hosted.pull_of(1, files))
    assert message in "\n".join(map(str, faults))
    written = [path for path in (world.folder / "out").rglob("*") if path.is_file()]
    assert not written


def test_log_and_comment_show_what_strangers_wrote_as_code(
    world: World, command: Callable[..., Result], tmp_path: Path
) -> None:
    head = world.hosted.pull_of(1, SOUND | {f"{HOME}/mine/a\n::set-output\x1b[2J": b"x"})
    (tmp_path / "leaderboard.toml").write_text(
        tomli_w.dumps(BOARD.model_dump(by_alias=True, exclude_none=True)), encoding="utf-8"
    )
    scored = command(
        "leaderboard", "score", "--event",
        write_event(tmp_path / "event.json", event(1, head, MINE)), "--remote",
        world.hosted.folder, "--root", tmp_path, "--work", tmp_path / "work",
        "--out", tmp_path / "found.json",
    )  # fmt: skip
    assert (scored.exit_code, scored.stdout) == (1, "refused\n"), scored.exception
    assert all(line.startswith("| ") for line in scored.stderr.splitlines())
    assert "\x1b" not in scored.stderr
    command("leaderboard", "comment", tmp_path / "found.json", "--out", tmp_path / "comment.md")
    comment = (tmp_path / "comment.md").read_text(encoding="utf-8")
    assert "set-output" in comment
    assert "set-output" not in outside_code(comment)


def test_empty_folder_in_another_s_submission_is_seen(world: World) -> None:
    """Nothing of it is a file, and a merge would change the other's folder all the same."""
    hosted = world.hosted
    head = hosted.commit(hosted.tip(), SOUND)
    theirs = git(hosted.folder, "ls-tree", "-z", f"{head}:{HOME}/theirs").encode()
    empty = b"040000 tree 4b825dc642cb6eb9a060e54bf8d69288fbee4904\tempty\0"
    _store(hosted.folder, b"")
    tree = git(hosted.folder, "mktree", "-z", stdin=theirs + empty)
    for name, above in (("theirs", HOME), ("retrieval", "submissions/made"),
                        ("made", "submissions"), ("submissions", "")):  # fmt: skip
        listed = git(hosted.folder, "ls-tree", "-z", f"{head}:{above}").split("\0")
        lines = [f"040000 tree {tree}\t{name}" if one.endswith(f"\t{name}") else one
                 for one in listed if one]  # fmt: skip
        tree = git(hosted.folder, "mktree", "-z", stdin="\0".join([*lines, ""]).encode())
    change = hosted.commit_tree(hosted.tip(), tree)
    hosted.pull(1, change)
    [fault] = world.look(1, change)
    assert "changes more than one folder" in str(fault)


def test_tree_with_dots_that_only_plumbing_makes(world: World) -> None:
    folder = world.hosted.folder
    blob = world.hosted.commit(world.hosted.tip(), SOUND)
    inner = bytes.fromhex(_tree(world, blob, f"{HOME}/mine"))
    tree = (
        b"40000 ..\0"
        + inner
        + b"100644 submission.toml\0"
        + bytes.fromhex(_tree(world, blob, f"{HOME}/mine/submission.toml"))
    )
    mine = _store(folder, tree)
    beside = {"mine": mine} | {
        name: _tree(world, blob, f"{HOME}/{name}") for name in ("old", "theirs")
    }
    parts = [f"40000 {name}\0".encode() + bytes.fromhex(one) for name, one in beside.items()]
    track = _store(folder, b"".join(parts))
    made = _store(folder, b"40000 retrieval\0" + bytes.fromhex(track))
    submissions = _store(folder, b"40000 made\0" + bytes.fromhex(made))
    root = _store(
        folder,
        b"100644 README.md\0" + bytes.fromhex(_tree(world, blob, "README.md"))
        + b"40000 submissions\0" + bytes.fromhex(submissions),
    )  # fmt: skip
    head = world.hosted.commit_tree(world.hosted.tip(), root)
    world.hosted.pull(1, head)
    [fault] = world.look(1, head)
    assert "git refuses its objects" in str(fault)
    assert not (world.folder / "out").exists()


def _tree(world: World, commit: str, path: str) -> str:
    return git(world.hosted.folder, "rev-parse", f"{commit}:{path}")


def _store(folder: Path, tree: bytes) -> str:
    return git(folder, "hash-object", "-t", "tree", "-w", "--stdin", "--literally", stdin=tree)


def test_merges_across_that_would_set_another_s_folder_back(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Git picks the later of two merge bases; against that one, theirs looks untouched."""
    hosted, name = world.hosted, f"{HOME}/theirs/p.npz"
    first = hosted.tip()
    newer = hosted.commit(first, {name: b"theirs, better"})
    with monkeypatch.context() as later:
        later.setenv("GIT_COMMITTER_DATE", "4000000000 +0000")
        own = hosted.commit(first, {"README.md": b"older\n"})

    def merge(one: str, other: str, files: Mapping[str, File | None]) -> str:
        tree = git(hosted.folder, "rev-parse", f"{hosted.commit(one, files)}^{{tree}}")
        return git(hosted.folder, "commit-tree", "-p", one, "-p", other, tree, stdin=b"m")

    hosted.move("refs/heads/main", merge(newer, own, {"README.md": b"older\n"}))
    head = merge(own, newer, SOUND)  # without what they have made better
    hosted.pull(1, head)
    merged = git(hosted.folder, "merge-tree", "--write-tree", "main", head).split()[0]
    assert git(hosted.folder, "show", f"{merged}:{name}") == "theirs"
    [fault] = world.look(1, head)
    assert "has 2 merge bases" in fault.what


def test_head_is_scored_at_the_commit_of_the_event(world: World) -> None:
    old = world.hosted.pull_of(1, SOUND)
    world.hosted.pull(1, world.hosted.commit(old, {f"{HOME}/theirs/p.npz": b"mine now"}))
    assert world.look(1, old) == []


def test_head_behind_main_changes_only_its_own_folder(world: World) -> None:
    head = world.hosted.pull_of(1, SOUND)
    for number in range(3):
        newer = world.hosted.commit(world.hosted.tip(), {f"{HOME}/x/{number}": b"newer"})
        world.hosted.move("refs/heads/main", newer)
    assert world.look(1, head) == []


def test_folder_that_changed_on_main_meanwhile(world: World) -> None:
    head = world.hosted.pull_of(1, {f"{HOME}/old/p.npz": b"newer"})
    newer = world.hosted.commit(world.hosted.tip(), {f"{HOME}/old/p.npz": b"newest"})
    world.hosted.move("refs/heads/main", newer)
    [fault] = world.look(1, head)
    assert "has changed on the board since" in str(fault)


def test_maintainers_may_change_every_folder(world: World) -> None:
    head = world.hosted.pull_of(1, {f"{HOME}/theirs/p.npz": b"mended"})
    assert world.look(1, head, MAINTAINER) == []
