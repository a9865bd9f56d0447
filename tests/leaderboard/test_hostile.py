"""Hostile pull requests do no harm, and comments and logs render nothing that strangers wrote."""

from __future__ import annotations

import re
import tomllib
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from markdown_it import MarkdownIt

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard import board as rules
from airzoo_bench.leaderboard import git
from airzoo_bench.leaderboard.comment import MARK, Found, comment_on
from tests.leaderboard import conftest as world
from tests.leaderboard.conftest import ADA, BOB, HOME, Board, Files, Hosted
from tests.statistics.support import HIT

LIMITS = {"limits": {"committed_bytes": 1_000_000}}
RULES = rules.Board.model_validate(tomllib.loads(world.BOARD) | LIMITS)


def only(path: str, content: Any = b"x") -> Files:
    return {f"{HOME}/{path}": content}


def beside(path: str, content: Any = b"x") -> Files:
    return SOUND | only(f"mine/{path}", content)


def many(count: int, content: Any = b"x") -> Files:
    return dict.fromkeys(map("{:06}".format, range(count)), content)


SOUND = only("mine/submission.toml") | only("mine/p.npz", b"1")
THEIRS = only("theirs/submission.toml", b"account = %d" % BOB) | only("theirs/p.npz", b"theirs")
ON_MAIN = {"README.md": b"a board\n"} | THEIRS
MINE_NOW, THEIRS_GONE = only("theirs/p.npz", b"mine now"), dict.fromkeys(THEIRS)
# 300 to the power of five copies of a folder, in five trees.
BOMBS = [reduce(lambda of, _: many(300, of), range(5), one) for one in ({"x": b"x"}, {})]

OTHER_FILES = ".github/workflows/x.yml .github/CODEOWNERS .ci/requirements.txt leaderboard.toml "
OTHER_FILES += ".gitattributes .gitmodules README.md Submissions/made/retrieval/x/submission.toml"
NOT_PLAIN = [
    *(".gitattributes", ".env", "a b.npz", "-rf", "a\n::set-output", "\x1b[2J", "a\u202egpj.npz"),
    *("\udcff.npz", "$(id).npz", "..\\..\\x", "con.npz", "x.", "a" * 200),
]
# What is said of pull requests, by what they change.
HOSTILE: dict[str, list[Files]] = {
    "another account": [
        *(MINE_NOW, THEIRS_GONE, only("theirs/p.npz", None), only("theirs/more.npz")),
        *(only(f"{folder}/submission.toml") for folder in ("theirs", "gone")),
        only("theirs/empty", {}),  # a merge would add a folder, and no file
    ],
    "more than one folder": [
        *(SOUND | MINE_NOW, SOUND | THEIRS_GONE),  # the latter renames theirs
        *(SOUND | only("second/submission.toml"), SOUND | {"submissions/x.toml": b"x"}),
        {f"{HOME}/m{n}/submission.toml": b"x" for n in range(30)},
        {f"submissions/m{n}/a/b/x": b"x" for n in range(30)},
    ],
    "changes other files": [SOUND | {path: b"x"} for path in OTHER_FILES.split()],
    "not the folder of a submission": [
        *({f"{at}/x.toml": b"x"} for at in ("submissions", "submissions/made", HOME)),
        *(only("mine", of) for of in (("120000", b"theirs"), ("160000", "a" * 40))),
        *(only(f"{name}/p.npz") for name in ("--help", ".hidden", "a\x07b", "aux")),
    ],
    "only in case": [beside("Ab") | beside("aB"), beside("a/x") | beside("A/y")],
    "a link, a submodule": [
        *(beside("link", ("120000", to)) for to in (b"/etc/passwd", b"../theirs/p.npz")),
        beside("submission.toml", ("120000", b"../theirs/submission.toml")),
        beside("sub", ("160000", "a" * 40)),
    ],
    "executable": [beside("run", ("100755", b"#!/bin/sh\n"))],
    "not plain": [*map(beside, NOT_PLAIN)],
    "more than 8 folders": [beside(f"{'a/' * 20}x")],
    "1,000,000 bytes": [
        beside("p.npz", b"x" * 1_000_001),
        beside("1", b"1" * 600_000) | beside("2", b"2" * 600_000),
    ],
    "2,000 files": [
        *(only("mine", of) for of in (many(4_100), many(2_100, {"x": b"x"}), *BOMBS)),
        only("mine", many(300_000, ("100644", "a" * 40))),  # git looks for what is there
    ],
    # Trees that no program would make.
    "git refuses its objects": [only("mine", {name: {"x": b"x"}}) for name in ("..", ".git", ".")],
}


@pytest.fixture(scope="module")
def hosted(tmp_path_factory: pytest.TempPathFactory) -> Hosted:
    """Return a repository that pull requests are made to; its main branch stays as it is."""
    return Hosted(tmp_path_factory.mktemp("hosted") / "hosted.git", ON_MAIN)


def look(hosted: Hosted, folder: Path, head: str, pulled: str = "") -> str:
    """Return what is wrong with a pull request; a sound one lies in `folder` / out then."""
    hosted.move("pull/1/head", pulled or head)
    repository = git.Repository(folder / "pull", str(hosted.folder))
    pull, gone = git.PullRequest(1, head, "main", ADA), {"gone": BOB}
    try:
        found = git.fetch_changed(repository, pull, RULES, lambda at: gone.get(at.folder))
        assert found is not None
        if found[1]:
            git.write_files(repository, head, found[0], RULES, folder / "out")
    except SubmissionError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("said", "files"), [(said, files) for said, cases in HOSTILE.items() for files in cases]
)
def test_hostile_changes_are_refused(hosted: Hosted, tmp_path: Path, said: str, files: Any) -> None:
    message = look(hosted, tmp_path, hosted.commit(ON_MAIN | files, hosted.first))
    assert said in message
    assert "\x1b" not in message
    assert not world.files_of(tmp_path / "out")


def test_the_commit_of_the_event_is_scored_against_one_base(tmp_path: Path) -> None:
    hosted, newer = Hosted(tmp_path / "hosted.git", ON_MAIN), {"README.md": b"newer\n"}
    changes = (SOUND, newer, MINE_NOW)
    sound, own, theirs = (hosted.commit(ON_MAIN | files, hosted.first) for files in changes)
    hosted.move("heads/main", own)
    later = hosted.commit(ON_MAIN | SOUND | MINE_NOW, sound)
    assert look(hosted, tmp_path, sound, pulled=later) == ""
    assert world.files_of(tmp_path / "out") == SOUND
    # Against the later of two bases another's folder looks untouched.
    hosted.move("heads/main", hosted.commit(ON_MAIN | MINE_NOW | newer, theirs, own))
    across = hosted.commit(ON_MAIN | newer | SOUND, own, theirs)
    assert "has 2 merge bases" in look(hosted, tmp_path / "across", across)


def test_hostile_files_are_one_refusal_and_no_command_to_the_runner(
    board: Board, scenes: Any, perfect: Any
) -> None:
    fork, tiles = board.clone("fork"), [tile for scene in scenes for tile in scene.tile_ids]
    nans = {"query_ids": perfect["query_ids"], "query_descriptors": np.full((10, 4), np.nan)}
    nans |= {"gallery_ids": tiles, "gallery_descriptors": np.ones((20, 4))}
    pickle, command = {"query_ids": np.array([print], object)}, "\n::set-output\x1b["
    cases = [("pickle", pickle, "a"), ("NaN", nans, "a"), ("set-output", perfect, command)]
    for number, (said, arrays, name) in enumerate(cases, 1):
        (world.write_submission(fork, arrays) / name).touch()
        comment = board.ci(number, fork, code=1)
        assert "is refused" in comment
        assert said in comment
        assert not [text for text in ("Traceback", str(board.home)) if text in comment]
        assert "set-output" not in rendered(comment)
        assert board.log.stdout == "refused\n"
        assert all(line.startswith("| ") for line in board.log.stderr.splitlines())
        assert "\x1b" not in board.log.stderr


TEXTS = [
    "@everyone #1 GH-1 a@b.example 0123456789abcdef0123456789abcdef01234567",
    "[click](https://evil.example) ![x](https://evil.example/x.png) <img src=x onerror=alert(1)>",
    "`@admin` ``@admin`` ```\n@admin\n```",
    "````\n@admin\n````",
    "| a | b |\n| --- | --- |",
    *(MARK, "\x1b[31mred\x1b[0m\u202egnp.exe", "a\r\n\r\n# Heading\n\n- [ ] task"),
    *("x" * 60_000, "`" * 500, ""),
]
SCORES = {HIT.key: {"value": 0.5, "low": 0.25, "high": 0.75, "rank": (2, 5)}}
SCENES = {f"s{n}": {HIT.key: (0.5, 0.25, 0.75)} for n in range(300)}


def rendered(comment: str) -> str:
    """Return the page that Markdown gives, without what is shown as code."""
    page = MarkdownIt().enable("table").render(comment)
    return re.sub("<code.*?</code>", "", page, flags=re.DOTALL)


def whole_comment(text: str) -> str:
    """Return a comment that has all parts, and this wherever strangers may write."""
    facts: dict[str, Any] = {"pull_request": 5, "account": 7, "head": "a" * 40, "team": text}
    facts |= {"kind": "refused", "method": text or "x", "warnings": (text,) * 9}
    facts["problems"] = (str(SubmissionError(text, where=text, expected=text, fix=text)),) * 500
    row: dict[str, Any] = {"kind": "re-scored", "scores": SCORES, "scenes": SCENES}
    answer = world.made_answer([text] * 300, notes=(text,), **row)
    return comment_on(Found(answer=answer, **facts))


def test_a_comment_renders_nothing_that_was_submitted() -> None:
    page = rendered(whole_comment("harmless"))
    assert page.startswith(MARK)
    for said in ("is refused", "<td", "This is about commit aaaaaaaaaaaa"):
        assert said in page
    for text in TEXTS:
        made = whole_comment(text)
        assert rendered(made) == page
        assert all(c.isprintable() or c == "\n" for c in made)
        assert len(made) < 65_536
