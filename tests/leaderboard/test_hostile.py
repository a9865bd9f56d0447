"""Hostile pull requests do no harm, and comments and logs render nothing that strangers wrote."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.leaderboard.answers import Answer, Head, Row, Scene, Score, Version
from airzoo_bench.leaderboard.board import Board as Rules
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.comment import MARK, MOST_BYTES, Found, code, comment_on
from airzoo_bench.leaderboard.pull_request import (
    PullRequest,
    Repository,
    fetch_changed,
    write_files,
)
from airzoo_bench.leaderboard.submission import submission_text
from tests.leaderboard.made import ADA, BOB, HOME, MAINTAINER, Board, File, Hosted, git, submission
from tests.statistics.support import HIT

RULES = Rules.model_validate(
    {
        "schema": 1,
        "title": "A board",
        "benchmarks": [{"name": "made", "title": "Made", "protocols": ["made-retrieval"]}],
        "maintainers": [MAINTAINER],
        "limits": {"committed_bytes": 1_000_000},
    }
)


def toml(method: str, account: int = ADA) -> bytes:
    return submission_text(submission(method=method, account=account)).encode()


MINE, THEIRS = f"{HOME}/mine", f"{HOME}/theirs"
SOUND: dict[str, File] = {f"{MINE}/submission.toml": toml("Mine"), f"{MINE}/p.npz": b"1"}
ON_MAIN: dict[str, File] = {
    "README.md": b"a board\n",
    f"{THEIRS}/submission.toml": toml("Theirs", BOB),
    f"{THEIRS}/p.npz": b"theirs",
    f"{HOME}/old/submission.toml": toml("Old"),
    f"{HOME}/old/p.npz": b"old",
}


@pytest.fixture(scope="module")
def hosted(tmp_path_factory: pytest.TempPathFactory) -> Hosted:
    """Return a repository that pull requests are made to; its main branch stays as it is."""
    return Hosted(tmp_path_factory.mktemp("hosted") / "hosted.git", ON_MAIN)


def look(hosted: Hosted, folder: Path, head: str, account: int = ADA, pulled: str = "") -> str:
    """Return what is wrong with a pull request; what is sound lies in `folder` / out then."""
    hosted.pull(1, pulled or head)
    repository = Repository(folder / "pull", str(hosted.folder))
    owners = {"gone": BOB}
    try:
        pull = PullRequest(1, head, "main", account)
        found = fetch_changed(repository, pull, RULES, lambda place: owners.get(place.folder))
        assert found is not None
        if found[1]:
            write_files(repository, head, found[0], RULES, folder / "out")
    except SubmissionError as error:
        return str(error)
    return ""


TWO, NOT_PLAIN, NO_FOLDER = "more than one folder", "not plain", "not the folder of a submission"
ANOTHER, CASE, A_LINK, OTHERS = (
    "another account",
    "only in case",
    "a link, a submodule",
    "changes other files",
)
MINE_NOW: dict[str, File] = {f"{THEIRS}/p.npz": b"mine now"}


def beside(name: str, content: File = b"x") -> dict[str, File]:
    return SOUND | {f"{MINE}/{name}": content}


def only(path: str, content: File = b"x") -> dict[str, File]:
    return {f"{HOME}/{path}": content}


HOSTILE: dict[str, tuple[dict[str, File], str]] = {
    # Others' folders, and files that are none of a submission.
    "two submissions": (SOUND | only("second/submission.toml", toml("Second")), TWO),
    "someone else's folder": (MINE_NOW, ANOTHER),
    "someone else's metadata": (only("theirs/submission.toml", toml("Theirs", ADA)), ANOTHER),
    "a file into someone else's": (only("theirs/more.npz"), ANOTHER),
    "someone else's removed": (dict.fromkeys([*ON_MAIN][1:3]), ANOTHER),
    "someone else's file removed": ({f"{THEIRS}/p.npz": None}, ANOTHER),
    "a folder that someone else had": (only("gone/submission.toml", toml("Gone")), ANOTHER),
    "one's own folder and another's": (SOUND | MINE_NOW, TWO),
    "someone else's renamed to one's own": (
        SOUND | dict.fromkeys([*ON_MAIN][1:3]), TWO,
    ),
    "a workflow besides": (SOUND | {".github/workflows/x.yml": b"on: push\n"}, OTHERS),
    "a workflow alone in submissions' name": (
        only("mine/submission.toml") | {".github/workflows/board.yml": b"x"}, OTHERS,
    ),
    "the board's rules": (SOUND | {"leaderboard.toml": b"maintainers = [1001]"}, OTHERS),
    "requirements": (SOUND | {".ci/requirements.txt": b"evil"}, OTHERS),
    "attributes at the top": (SOUND | {".gitattributes": b"* filter=x\n"}, OTHERS),
    "modules": (SOUND | {".gitmodules": b'[submodule "x"]\n'}, OTHERS),
    "code owners": (SOUND | {".github/CODEOWNERS": b"* @me\n"}, OTHERS),
    "the readme": (SOUND | {"README.md": b"mine\n"}, OTHERS),
    "submissions in another case": (
        SOUND | {"Submissions/made/retrieval/x/submission.toml": b"x"}, OTHERS,
    ),
    "a file beside the benchmarks": (SOUND | {"submissions/x.toml": b"x"}, NO_FOLDER),
    "a file beside the tracks": ({"submissions/made/x.toml": b"x"}, NO_FOLDER),
    "file beside the folders": (only("x.toml"), NO_FOLDER),
    # Names.
    "attributes in the folder": (beside(".gitattributes", b"* filter=x\n"), NOT_PLAIN),
    "hidden file": (beside(".env"), NOT_PLAIN),
    "names that differ in case": (beside("P.npz", b"2"), CASE),
    "folders that differ in case": (beside("a/x") | {f"{MINE}/A/y": b"x"}, CASE),
    "blank": (beside("a b.npz"), NOT_PLAIN),
    "leading dash": (beside("-rf"), NOT_PLAIN),
    "folder with a leading dash": (only("--help/submission.toml"), NO_FOLDER),
    "hidden folder": (only(".hidden/submission.toml"), NO_FOLDER),
    "line break": (beside("a\n::set-output"), NOT_PLAIN),
    "escape": (beside("\x1b[2J"), NOT_PLAIN),
    "control characters in the folder": (only("a\x07b/submission.toml"), NO_FOLDER),
    "right to left": (beside("a\u202egpj.npz"), NOT_PLAIN),
    "not UTF-8": (beside("\udcff.npz"), NOT_PLAIN),
    "shell": (beside("$(id).npz"), NOT_PLAIN),
    "backslash": (beside("..\\..\\x"), NOT_PLAIN),
    "device of Windows": (beside("con.npz"), NOT_PLAIN),
    "device as a folder": (only("aux/submission.toml"), NO_FOLDER),
    "dot at the end": (beside("x."), NOT_PLAIN),
    "long name": (beside("a" * 200), NOT_PLAIN),
    "deep folders": (beside("a/" * 20 + "x"), "more than 8 folders"),
    # Kinds and sizes.
    "symbolic link": (beside("link", ("120000", b"/etc/passwd")), A_LINK),
    "link to another's": (beside("p2.npz", ("120000", b"../theirs/p.npz")), A_LINK),
    "link as metadata": (
        only("mine/submission.toml", ("120000", b"../theirs/submission.toml")), A_LINK,
    ),
    "submodule": (beside("sub", ("160000", b"a" * 40)), A_LINK),
    "executable": (beside("run", ("100755", b"#!/bin/sh\n")), "executable"),
    "the folder itself is a link": (only("mine", ("120000", b"theirs")), NO_FOLDER),
    "the folder itself is a submodule": (only("mine", ("160000", b"a" * 40)), NO_FOLDER),
    "large predictions": (beside("p.npz", b"x" * 1_000_001), "1,000,000 bytes"),
    "large together": (
        SOUND | {f"{MINE}/{n}": bytes([n]) * 600_000 for n in range(2)}, "1,000,000 bytes",
    ),
    "many files": (SOUND | {f"{MINE}/f{n}": b"x" for n in range(4_100)}, "2,000 files"),
    "many submissions": (
        {f"{HOME}/m{n}/submission.toml": b"x" for n in range(200)}, "more than 100",
    ),
    "many benchmarks": ({f"submissions/m{n}/a/b/x": b"x" for n in range(300)}, "more than 100"),
    "many folders": (SOUND | {f"{MINE}/f{n}/x": b"x" for n in range(2_100)}, "2,000 files"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_pull_request_is_refused(hosted: Hosted, tmp_path: Path, name: str) -> None:
    files, message = HOSTILE[name]
    said = look(hosted, tmp_path, hosted.commit(hosted.resolve(), files))
    assert message in said
    assert "\x1b" not in said
    assert not [path for path in tmp_path.glob("out/**/*") if path.is_file()]


SUBMISSIONS, HERE = "submissions", ["made", "retrieval"]


def grafted(hosted: Hosted, tree: str, name: str, mode: str = "40000") -> str:
    """Return a commit on main in whose folder of submissions a tree has this name."""
    mine = {f"{mode} {name}": tree}
    for level in (3, 2, 1, 0):
        above = "/".join([SUBMISSIONS, *HERE][:level])
        listed = git(hosted.folder, "ls-tree", "-z", f"main:{above}").split("\0")[:-1]
        entries = dict(line.split("\t")[::-1] for line in listed)
        kept = {
            f"{entry.split()[0].lstrip('0')} {path}": entry.split()[2]
            for path, entry in entries.items()
            if path not in {key.split(" ", 1)[1] for key in mine}
        }
        both = sorted((kept | mine).items(), key=lambda one: one[0].split(" ", 1)[1])
        mine = {f"40000 {[SUBMISSIONS, *HERE, ''][level - 1]}": hosted.store_tree(dict(both))}
    return hosted.commit_tree(mine.popitem()[1], "main")


def _dots(hosted: Hosted, name: str) -> str:
    sound = hosted.commit(hosted.resolve(), SOUND)
    inner = hosted.resolve(f"{sound}:{MINE}")
    metadata = hosted.resolve(f"{sound}:{MINE}/submission.toml")
    entries = {f"40000 {name}": inner, "100644 submission.toml": metadata}
    return grafted(hosted, hosted.store_tree(entries), "mine")


def _bomb(hosted: Hosted, content: bytes | None) -> str:
    """Return a commit of 300 to the power of five files, or empty folders, in five trees."""
    file = git(hosted.folder, "hash-object", "-w", "--stdin", stdin=content or b"")
    tree = hosted.store_tree({} if content is None else {"100644 x": file})
    for _ in range(5):
        tree = hosted.store_tree({f"40000 {n:03}": tree for n in range(300)})
    return grafted(hosted, tree, "mine")


def _empty(hosted: Hosted) -> str:
    """Return a commit whose merge would add an empty folder to another's, and no file."""
    entry = git(hosted.folder, "ls-tree", f"main:{THEIRS}").splitlines()
    kept = {f"{line.split()[0]} {line.split()[3]}": line.split()[2] for line in entry}
    theirs = hosted.store_tree({"40000 empty": hosted.store_tree({})} | kept)
    return grafted(hosted, theirs, "theirs")


def _two_bases(hosted: Hosted) -> str:
    """Return a merge across: against the later of two bases another's folder looks untouched."""
    first = hosted.resolve()
    newer = hosted.commit(first, {f"{THEIRS}/p.npz": b"theirs, better"})
    own = hosted.commit(first, {"README.md": b"older\n"})
    tree = hosted.resolve(f"{hosted.commit(newer, {'README.md': b'older'})}^{{tree}}")
    hosted.move("refs/heads/main", hosted.commit_tree(tree, newer, own))
    mine = hosted.resolve(f"{hosted.commit(own, SOUND)}^{{tree}}")
    return hosted.commit_tree(mine, own, newer)


TREES: dict[str, tuple[Callable[[Hosted], str], str]] = {
    "two dots": (lambda hosted: _dots(hosted, ".."), "git refuses its objects"),
    "the folder of git": (lambda hosted: _dots(hosted, ".git"), "git refuses its objects"),
    "a slash in a name": (lambda hosted: _dots(hosted, "a/b"), "git refuses its objects"),
    "a bomb of trees": (lambda hosted: _bomb(hosted, b"x"), "2,000 files"),
    "a bomb of empty trees": (lambda hosted: _bomb(hosted, None), "2,000 files"),
    "an empty folder in another's": (_empty, ANOTHER),
    "two merge bases": (_two_bases, "has 2 merge bases"),
}


@pytest.mark.parametrize("name", TREES)
def test_trees_that_only_plumbing_makes_are_refused(tmp_path: Path, name: str) -> None:
    hosted = Hosted(tmp_path / "hosted.git", ON_MAIN)
    make, message = TREES[name]
    assert message in look(hosted, tmp_path / "ci", make(hosted))
    assert not (tmp_path / "ci/out").exists()


def test_the_commit_of_the_event_is_scored_and_no_later_one(hosted: Hosted, tmp_path: Path) -> None:
    old = hosted.commit(hosted.resolve(), SOUND)
    newer = hosted.commit(old, MINE_NOW)
    assert look(hosted, tmp_path, old, pulled=newer) == ""
    written = tmp_path / "out" / MINE
    assert {path.name: path.read_bytes() for path in written.iterdir()} == {
        "p.npz": b"1",
        "submission.toml": SOUND[f"{MINE}/submission.toml"],
    }


def test_a_branch_behind_main_and_a_folder_that_changed_meanwhile(tmp_path: Path) -> None:
    hosted = Hosted(tmp_path / "hosted.git", ON_MAIN)
    sound, stale = (
        hosted.commit(hosted.resolve(), files) for files in (SOUND, only("old/p.npz", b"newer"))
    )
    for name in ("x/1", "old/p.npz"):
        newer = hosted.commit(hosted.resolve(), only(name, b"newest"))
        hosted.move("refs/heads/main", newer)
    assert look(hosted, tmp_path / "a", sound) == ""
    assert "has changed on the board since" in look(hosted, tmp_path / "b", stale)


def test_maintainers_may_change_every_folder(hosted: Hosted, tmp_path: Path) -> None:
    head = hosted.commit(hosted.resolve(), MINE_NOW)
    assert look(hosted, tmp_path, head, MAINTAINER) == ""


# --- what reaches the benchmark: predictions ---


def _nan(path: Path) -> None:
    ids = [f"{scene}/q{n:05d}" for scene, count in (("east", 6), ("west", 4)) for n in range(count)]
    numbers = np.full((10, 4), np.nan, np.float32)
    np.savez(path, protocol="made-retrieval", query_ids=ids, query_descriptors=numbers)


def _pickles(path: Path) -> None:
    np.savez(path, protocol="made-retrieval", query_ids=np.array([print], object))


FILES: dict[str, Callable[[Path], object]] = {
    "pickles in an npz": _pickles,
    "NaN": _nan,
    "half an npz": lambda path: path.write_bytes(b"PK\x03\x04" + bytes(200)),
    "no npz": lambda path: path.write_bytes(b"\x93NUMPY\x01\x00"),
}


def test_hostile_predictions_are_one_refusal(board: Board) -> None:
    fork = board.clone("fork")
    for number, write in enumerate(FILES.values(), 1):
        git(fork, "reset", "--quiet", "--hard", "origin/main")
        home = fork / HOME / "mine"
        home.mkdir(parents=True)
        write(home / "p.npz")
        size, sha256 = (home / "p.npz").stat().st_size, sha256_of_tree(home / "p.npz")
        given = {"file": "p.npz", "sha256": sha256, "bytes": size}
        (home / "submission.toml").write_text(submission_text(submission(predictions=given)))
        comment = board.ci(number, board.propose(fork, number), code=1)
        assert "is refused" in comment
        assert "Traceback" not in comment
        assert str(board.home) not in comment


# --- the comment ---

TEXTS = [
    "@everyone #1 GH-1 a@b.example 0123456789abcdef0123456789abcdef01234567",
    "[click](https://evil.example) ![x](https://evil.example/x.png)",
    "<img src=x onerror=alert(1)>",
    "`@admin` ``@admin`` ```\n@admin\n```",
    "````\n@admin\n````",
    "| a | b |\n| --- | --- |",
    "<!-- airzoo-bench leaderboard -->",
    "\x1b[31mred\x1b[0m\u202egnp.exe",
    "a\r\n\r\n# Heading\n\n- [ ] task",
    "x" * 10_000,
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


def found(kind: Any = "scored", answer: Answer | None = None, **more: Any) -> Found:
    place = Place("made", "retrieval", "mine")
    stated: dict[str, Any] = {"pull_request": 5, "account": 7, "head": "a" * 40, "place": place}
    return Found(kind=kind, answer=answer, **(stated | more))


def answer(titles: Sequence[str], columns: int = 1, **more: Any) -> Answer:
    """Return an answer with scores of scenes, and an earlier version."""
    every = tuple(HIT.model_copy(update={"key": f"k{n}"}) for n in range(columns))
    scenes = tuple(Scene(id=f"s{n}", title=text, queries=1234) for n, text in enumerate(titles))
    facts: Any = {"benchmark": "made", "track": "retrieval", "protocol": "p", "scenes": scenes}
    head = Head(protocol_version=1, protocol_fingerprint="f", **facts)
    versions = [Version(number=n, date="", files="", scores={"k0": 0.4}) for n in (2, 1)]
    parts = {scene.id: {c.key: (0.5, 0.25, 0.75) for c in every} for scene in scenes}
    score = Score(value=0.5, low=0.25, high=0.75, rank=(2, 5))
    given = {"scores": {"k0": score}, "scenes": parts, "history": versions} | more
    row = Row(kind="re-scored", method="Salad", **given)
    return Answer(tree="", scored="2026-01-01", version="1", head=head, columns=every, row=row)


@pytest.mark.parametrize("text", TEXTS, ids=lambda text: ascii(text)[:30])
def test_a_comment_renders_nothing_that_was_submitted(text: str) -> None:
    facts = {"method": text or "x", "team": text, "warnings": (text,)}
    scored = comment_on(found(answer=answer([text], notes=(text,)), **facts))
    assert outside_code(scored).count("<!--") == 1
    assert all(c.isprintable() or c == "\n" for c in scored)
    tables = [line for line in scored.split("\n") if line.startswith("| ")]
    assert len({line.count("|") for line in tables[:3]}) == 1
    problem = str(SubmissionError(text, where=text, expected=text, fix=text))
    refused = comment_on(found("refused", problems=(problem,) * 3, warnings=(text,)))
    assert refused.startswith(f"{MARK}\n")
    assert not [part for part in BAD if part in outside_code(scored) + outside_code(refused)]


def test_comments_are_bounded_and_their_blocks_are_closed() -> None:
    made = comment_on(found("refused", problems=("\U0001f4a3" * 60_000,) * 500))
    assert len(made.encode()) <= MOST_BYTES
    assert "This is about commit aaaaaaaaaaaa" in outside_code(made)
    made = comment_on(found(answer=answer(["s" * 120] * 1000, 60)))
    assert len(made.encode()) <= MOST_BYTES
    assert code("a`b|c\nd") == "`a'b/c d`"


def test_a_comment_has_intervals_ranks_and_changes() -> None:
    made = comment_on(found(answer=answer(["East"]), method="Salad", ranked=9))
    assert "Rank **2 to 5** of 9 by `R@1`." in made
    assert "| `East` | 1,234 | 50.00 [25.00, 75.00] |" in made
    assert "| `average` | 1,234 | 40.00 → 50.00 |" in made
    assert "gh pr merge 5 --squash --match-head-commit " + "a" * 40 in made
    far = found(answer=answer(["East"], scenes={"s0": {"k0": (float("inf"), None, None)}}))
    assert "| `East` | 1,234 | inf |" in comment_on(far)
    assert Found.model_validate_json(far.model_dump_json()) == far


def test_the_log_gives_no_command_to_the_runner(board: Board) -> None:
    head = board.hosted.commit(
        board.hosted.resolve(), {os.fspath(f"{MINE}/a\n::set-output\x1b[2J"): b"x"}
    )
    board.hosted.pull(1, head)
    work = board.score(1, head, code=1)
    said = board.comment(work / "found-score.json")
    assert "set-output" in said
    assert "set-output" not in outside_code(said)
    event = work / "event.json"
    done = board.step(
        "score", "--event", event, "--out", work / "f.json", "--work", work / "again", code=1
    )
    assert done.stdout == "refused\n"
    assert all(line.startswith("| ") for line in done.stderr.splitlines())
    assert "\x1b" not in done.stderr
