"""Hostile pull requests do no harm, and comments and logs render nothing that strangers wrote."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.leaderboard import git as board_git
from airzoo_bench.leaderboard.board import Board as Rules
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.comment import MARK, Found, comment_on
from airzoo_bench.leaderboard.submission import submission_text
from tests.leaderboard import conftest as world
from tests.leaderboard.conftest import ADA, BOB, HOME, PROTOCOL, Board, File, Hosted
from tests.statistics.support import HIT

LIMITS = {"limits": {"committed_bytes": 1_000_000}}
RULES = Rules.model_validate(tomllib.loads(world.BOARD) | LIMITS)


def toml(**changes: Any) -> bytes:
    return submission_text(world.submission(**changes)).encode()


def only(path: str, content: File = b"x") -> dict[str, File]:
    return {f"{HOME}/{path}": content}


MINE, THEIRS = f"{HOME}/mine", f"{HOME}/theirs"
SOUND: dict[str, File] = {f"{MINE}/submission.toml": toml(method="Mine"), f"{MINE}/p.npz": b"1"}
ON_MAIN: dict[str, File] = {
    "README.md": b"a board\n",
    f"{THEIRS}/submission.toml": toml(method="Theirs", account=BOB),
    f"{THEIRS}/p.npz": b"theirs",
    f"{HOME}/old/submission.toml": toml(method="Old"),
    f"{HOME}/old/p.npz": b"old",
}
MINE_NOW = only("theirs/p.npz", b"mine now")
THEIRS_GONE: dict[str, File] = dict.fromkeys([*ON_MAIN][1:3])


def look(hosted: Hosted, folder: Path, head: str, account: int = ADA, pulled: str = "") -> str:
    """Return what is wrong with a pull request; a sound one lies in `folder` / out then."""
    hosted.move("pull/1/head", pulled or head)
    repository = board_git.Repository(folder / "pull", str(hosted.folder))
    pull, gone = board_git.PullRequest(1, head, "main", account), {"gone": BOB}
    try:
        found = board_git.fetch_changed(repository, pull, RULES, lambda at: gone.get(at.folder))
        assert found is not None
        if found[1]:
            board_git.write_files(repository, head, found[0], RULES, folder / "out")
    except SubmissionError as error:
        return str(error)
    return ""


def beside(path: str, file: File = b"x") -> dict[str, File]:
    return SOUND | {path if path.startswith("submissions") else f"{MINE}/{path}": file}


def bomb(of: dict[str, File]) -> dict[str, File]:
    """Return a folder of 300 to the power of five copies of a folder, in five trees."""
    for _ in range(5):
        of = dict.fromkeys(map("{:03}".format, range(300)), of)
    return of


ANOTHER, OTHERS, TWO = "another account", "changes other files", "more than one folder"
NO_FOLDER, A_LINK, CASE = "not the folder of a submission", "a link, a submodule", "only in case"
MANY, BYTES, UNSOUND = "2,000 files", "1,000,000 bytes", "git refuses its objects"
OTHER_FILES = ".github/workflows/x.yml .github/CODEOWNERS .ci/requirements.txt leaderboard.toml "
OTHER_FILES += ".gitattributes .gitmodules README.md Submissions/made/retrieval/x/submission.toml"
NOT_PLAIN = [
    *(".gitattributes", ".env", "a b.npz", "-rf", "a\n::set-output", "\x1b[2J", "a\u202egpj.npz"),
    *("\udcff.npz", "$(id).npz", "..\\..\\x", "con.npz", "x.", "a" * 200),
]
# What a pull request changes, alone or beside a sound submission, and what is said.
HOSTILE: list[tuple[str, dict[str, File]]] = [
    *((ANOTHER, files) for files in (MINE_NOW, THEIRS_GONE, only("theirs/p.npz", None))),
    *((ANOTHER, only(f"{n}/submission.toml", toml(method="Theirs"))) for n in ("theirs", "gone")),
    (ANOTHER, only("theirs/more.npz")),
    (ANOTHER, only("theirs/empty", {})),  # a merge would add a folder, and no file
    (TWO, SOUND | MINE_NOW),
    (TWO, SOUND | THEIRS_GONE),  # renamed to one's own
    (TWO, beside(f"{HOME}/second/submission.toml", toml(method="Second"))),
    (TWO, beside("submissions/x.toml")),
    (TWO, {f"{HOME}/m{n}/submission.toml": b"x" for n in range(200)}),
    (TWO, {f"submissions/m{n}/a/b/x": b"x" for n in range(300)}),
    *((OTHERS, SOUND | {path: b"x"}) for path in OTHER_FILES.split()),
    (OTHERS, only("mine/submission.toml") | {".github/workflows/board.yml": b"x"}),
    *((NO_FOLDER, {f"{at}/x.toml": b"x"}) for at in ("submissions", "submissions/made", HOME)),
    *((NO_FOLDER, only("mine", of)) for of in (("120000", b"theirs"), ("160000", "a" * 40))),
    *((NO_FOLDER, only(f"{n}/submission.toml")) for n in ("--help", ".hidden", "a\x07b", "aux")),
    (CASE, beside("Ab") | beside("aB")),
    (CASE, beside("a/x") | beside("A/y")),
    ("more than 8 folders", beside(f"{'a/' * 20}x")),
    *((A_LINK, beside("link", ("120000", to))) for to in (b"/etc/passwd", b"../theirs/p.npz")),
    (A_LINK, beside("submission.toml", ("120000", b"../theirs/submission.toml"))),
    (A_LINK, beside("sub", ("160000", "a" * 40))),
    ("executable", beside("run", ("100755", b"#!/bin/sh\n"))),
    *(("not plain", beside(name)) for name in NOT_PLAIN),
    (BYTES, beside("p.npz", b"x" * 1_000_001)),
    (BYTES, beside("1", b"1" * 600_000) | beside("2", b"2" * 600_000)),
    (MANY, SOUND | {f"{MINE}/f{n}": b"x" for n in range(4_100)}),
    (MANY, SOUND | {f"{MINE}/f{n}/x": b"x" for n in range(2_100)}),
    (MANY, only("mine", dict.fromkeys(map("{:06}".format, range(300_000)), b"x"))),
    # Trees that no program would make.
    *((MANY, only("mine", bomb(of))) for of in ({"x": b"x"}, {})),
    *((UNSOUND, only("mine", {name: {"x": b"x"}})) for name in ("..", ".git", "a/b", ".")),
]


@pytest.fixture(scope="module")
def hosted(tmp_path_factory: pytest.TempPathFactory) -> Hosted:
    """Return a repository that pull requests are made to; its main branch stays as it is."""
    return Hosted(tmp_path_factory.mktemp("hosted") / "hosted.git", ON_MAIN)


@pytest.mark.parametrize(
    ("said", "files"), HOSTILE, ids=lambda one: one if isinstance(one, str) else "files"
)
def test_hostile_changes_are_refused(hosted: Hosted, tmp_path: Path, said: str, files: Any) -> None:
    message = look(hosted, tmp_path, hosted.commit(files, hosted.first))
    assert said in message
    assert "\x1b" not in message
    assert not [path for path in tmp_path.glob("out/**/*") if path.is_file()]


def test_sound_pull_requests_and_what_main_has_meanwhile(tmp_path: Path) -> None:
    hosted = Hosted(tmp_path / "hosted.git", ON_MAIN)
    first = hosted.first
    sound, stale, theirs = (
        hosted.commit(files, first) for files in (SOUND, only("old/p.npz", b"newer"), MINE_NOW)
    )
    assert look(hosted, tmp_path / "m", theirs, world.MAINTAINER) == ""  # may change every folder
    newer = hosted.commit(only("x/1", b"") | only("old/p.npz", b"newest"), first)
    hosted.move("heads/main", newer)
    assert "has changed on the board since" in look(hosted, tmp_path / "b", stale)
    # The commit of the event is scored, and no later one.
    later = hosted.commit(MINE_NOW, sound)
    assert look(hosted, tmp_path / "a", sound, pulled=later) == ""
    written = tmp_path / "a/out" / MINE
    assert {f"{MINE}/{path.name}": path.read_bytes() for path in written.iterdir()} == SOUND
    # Merged across: against the later of two bases another's folder looks untouched.
    better, own = (hosted.commit(f, first) for f in (MINE_NOW, {"README.md": b"older\n"}))
    hosted.move("heads/main", hosted.commit({"README.md": b"older\n"}, better, own))
    across = hosted.commit(SOUND, own, better)
    assert "has 2 merge bases" in look(hosted, tmp_path / "c", across)


IDS = [f"{scene}/q{n:05d}" for scene, count in (("east", 6), ("west", 4)) for n in range(count)]
NANS = np.full((10, 4), np.nan, np.float32)
FILES: list[Callable[[Path], object]] = [
    lambda path: np.savez(path, protocol=PROTOCOL, query_ids=np.array([print], object)),
    lambda path: np.savez(path, protocol=PROTOCOL, query_ids=IDS, query_descriptors=NANS),
    lambda path: path.write_bytes(b"PK\x03\x04" + bytes(200)),
    lambda path: path.write_bytes(b"\x93NUMPY\x01\x00"),
]


def test_hostile_files_are_one_refusal_and_no_command_to_the_runner(board: Board) -> None:
    hostile: list[dict[str, File]] = [{f"{MINE}/a\n::set-output\x1b[2J": b"x"}]
    for write in FILES:
        write(file := board.home / "p.npz")
        given = {"file": "p.npz", "sha256": sha256_of_tree(file), "bytes": file.stat().st_size}
        hostile.append({f"{MINE}/submission.toml": toml(predictions=given)})
        hostile[-1][f"{MINE}/p.npz"] = file.read_bytes()
    for number, files in enumerate(hostile, 1):
        head = board.hosted.commit(files, board.hosted.first)
        comment = board.ci(number, board.hosted.move(f"pull/{number}/head", head), code=1)
        assert "is refused" in comment
        assert not [text for text in ("Traceback", str(board.home)) if text in comment]
        assert "set-output" not in outside_code(comment)
        assert board.log.stdout == "refused\n"
        assert all(line.startswith("| ") for line in board.log.stderr.splitlines())
        assert "\x1b" not in board.log.stderr


TEXTS = [
    "@everyone #1 GH-1 a@b.example 0123456789abcdef0123456789abcdef01234567",
    "[click](https://evil.example) ![x](https://evil.example/x.png)",
    "<img src=x onerror=alert(1)>",
    "`@admin` ``@admin`` ```\n@admin\n```",
    "````\n@admin\n````",
    "| a | b |\n| --- | --- |",
    MARK,
    "\x1b[31mred\x1b[0m\u202egnp.exe",
    "a\r\n\r\n# Heading\n\n- [ ] task",
    "x" * 60_000,
    "`" * 500,
    "",
]
BAD = ("@", "#1", "evil", "<img", "admin", "Heading", "gnp", "GH-1", "0123456789")


def outside_code(text: str) -> str:
    """Return what a renderer of Markdown would look at: all but blocks and spans of code."""
    kept, fence = [], False
    for line in text.split("\n"):
        if line.startswith("````"):
            fence = not fence
        elif not fence:
            kept.append(re.sub(r"`[^`]*`", "", line))
    assert not fence
    return "\n".join(kept)


def test_a_comment_renders_nothing_that_was_submitted() -> None:
    scores = {HIT.key: {"value": 0.5, "low": 0.25, "high": 0.75, "rank": (2, 5)}}
    scenes = {f"s{n}": {HIT.key: (0.5, 0.25, 0.75)} for n in range(300)}
    place = Place("made", "retrieval", "mine")
    pull: dict[str, Any] = {"pull_request": 5, "account": 7, "head": "a" * 40, "place": place}
    for text in TEXTS:
        row: dict[str, Any] = {"scores": scores, "scenes": scenes, "notes": (text,)}
        answer = world.made_answer([text] * 300, kind="re-scored", **row)
        names: dict[str, Any] = {"method": text or "x", "team": text, "warnings": (text,) * 9}
        scored = comment_on(Found(kind="scored", answer=answer, **names, **pull))
        problems = (str(SubmissionError(text, where=text, expected=text, fix=text)),) * 500
        refused = comment_on(Found(kind="refused", problems=problems, warnings=(text,), **pull))
        assert refused.startswith(f"{MARK}\n")
        for made in (scored, refused):
            assert all(c.isprintable() or c == "\n" for c in made)
            assert len(made) < 65_536
            assert outside_code(made).count("<!--") == 1
            assert not [part for part in BAD if part in outside_code(made)]
            assert "This is about commit aaaaaaaaaaaa" in outside_code(made)
        tables = [line for line in scored.split("\n") if line.startswith("| ")]
        assert len({line.count("|") for line in tables[:3]}) == 1
