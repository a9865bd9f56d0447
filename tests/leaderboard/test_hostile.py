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
from tests.leaderboard.made import (
    ADA,
    BOB,
    HOME,
    MAINTAINER,
    PROTOCOL,
    Board,
    File,
    Hosted,
    git,
    submission,
)
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
    "a file beside the benchmarks": ({"submissions/x.toml": b"x"}, NO_FOLDER),
    "a file beside the tracks": ({"submissions/made/x.toml": b"x"}, NO_FOLDER),
    "file beside the folders": (only("x.toml"), NO_FOLDER),
    # Names.
    "names that differ in case": (beside("P.npz", b"2"), CASE),
    "folders that differ in case": (beside("a/x") | {f"{MINE}/A/y": b"x"}, CASE),
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
        {f"{HOME}/m{n}/submission.toml": b"x" for n in range(200)}, TWO,
    ),
    "many benchmarks": ({f"submissions/m{n}/a/b/x": b"x" for n in range(300)}, TWO),
    "many folders": (SOUND | {f"{MINE}/f{n}/x": b"x" for n in range(2_100)}, "2,000 files"),
}  # fmt: skip


FILE_NAMES = (
    *(".gitattributes", ".env", "a b.npz", "-rf", "a\n::set-output", "\x1b[2J", "a\u202egpj.npz"),
    *("\udcff.npz", "$(id).npz", "..\\..\\x", "con.npz", "x.", "a" * 200),
)
HOSTILE |= {f"file {name!a}"[:40]: (beside(name), NOT_PLAIN) for name in FILE_NAMES}
HOSTILE |= {
    f"folder {name!a}": (only(f"{name}/submission.toml"), NO_FOLDER)
    for name in ("--help", ".hidden", "a\x07b", "aux")
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_pull_request_is_refused(hosted: Hosted, tmp_path: Path, name: str) -> None:
    files, message = HOSTILE[name]
    said = look(hosted, tmp_path, hosted.commit(hosted.resolve(), files))
    assert message in said
    assert "\x1b" not in said
    assert not [path for path in tmp_path.glob("out/**/*") if path.is_file()]


def grafted(hosted: Hosted, tree: str, name: str = "mine") -> str:
    """Return a commit on main in whose folder of submissions a tree has this name."""
    for above in (HOME, *map(str, Path(HOME).parents[:-1]), ""):
        listed = git(hosted.folder, "ls-tree", "-z", f"main:{above}").split("\0")[:-1]
        entries = {path: head.split() for head, path in (line.split("\t") for line in listed)}
        entries[name] = ["040000", "tree", tree]
        kept = sorted(entries.items())
        tree = hosted.store_tree({f"{e[0].lstrip('0')} {path}": e[2] for path, e in kept})
        name = Path(above).name
    return hosted.commit_tree(tree, "main")


def _dots(hosted: Hosted, name: str) -> str:
    sound = hosted.commit(hosted.resolve(), SOUND)
    inner, file = (hosted.resolve(f"{sound}:{MINE}{end}") for end in ("", "/submission.toml"))
    entries = {f"40000 {name}": inner, "100644 submission.toml": file}
    return grafted(hosted, hosted.store_tree(entries))


def _bomb(hosted: Hosted, entries: dict[str, str]) -> str:
    """Return a commit of 300 to the power of five files, or empty folders, in five trees."""
    tree = hosted.store_tree(entries)
    for _ in range(5):
        tree = hosted.store_tree({f"40000 {n:03}": tree for n in range(300)})
    return grafted(hosted, tree)


def _empty(hosted: Hosted) -> str:
    """Return a commit whose merge would add an empty folder to another's, and no file."""
    file = hosted.resolve(f"main:{THEIRS}/p.npz"), hosted.resolve(f"main:{THEIRS}/submission.toml")
    entries = {"40000 empty": hosted.store_tree({}), "100644 p.npz": file[0]}
    return grafted(
        hosted, hosted.store_tree(entries | {"100644 submission.toml": file[1]}), "theirs"
    )


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
    "a bomb of trees": (
        lambda hosted: _bomb(hosted, {"100644 x": hosted.resolve("main:README.md")}), "2,000 files",
    ),
    "a bomb of empty trees": (lambda hosted: _bomb(hosted, {}), "2,000 files"),
    "an empty folder in another's": (_empty, ANOTHER),
    "two merge bases": (_two_bases, "has 2 merge bases"),
}  # fmt: skip


@pytest.mark.parametrize("name", TREES)
def test_trees_that_only_plumbing_makes_are_refused(tmp_path: Path, name: str) -> None:
    hosted = Hosted(tmp_path / "hosted.git", ON_MAIN)
    make, message = TREES[name]
    assert message in look(hosted, tmp_path / "ci", make(hosted))
    assert not (tmp_path / "ci/out").exists()


def test_sound_pull_requests_and_what_main_has_meanwhile(tmp_path: Path) -> None:
    hosted = Hosted(tmp_path / "hosted.git", ON_MAIN)
    sound, stale, theirs = (
        hosted.commit(hosted.resolve(), files)
        for files in (SOUND, only("old/p.npz", b"newer"), MINE_NOW)
    )
    assert look(hosted, tmp_path / "m", theirs, MAINTAINER) == ""  # may change every folder
    for name in ("x/1", "old/p.npz"):
        newer = hosted.commit(hosted.resolve(), only(name, b"newest"))
        hosted.move("refs/heads/main", newer)
    assert "has changed on the board since" in look(hosted, tmp_path / "b", stale)
    # The commit of the event is scored, and no later one.
    later = hosted.commit(sound, MINE_NOW)
    assert look(hosted, tmp_path / "a", sound, pulled=later) == ""
    written = tmp_path / "a/out" / MINE
    assert {f"{MINE}/{path.name}": path.read_bytes() for path in written.iterdir()} == SOUND


# --- what reaches the benchmark: predictions ---


IDS = [f"{scene}/q{n:05d}" for scene, count in (("east", 6), ("west", 4)) for n in range(count)]
NANS = np.full((10, 4), np.nan, np.float32)
FILES: list[Callable[[Path], object]] = [
    lambda path: np.savez(path, protocol=PROTOCOL, query_ids=np.array([print], object)),
    lambda path: np.savez(path, protocol=PROTOCOL, query_ids=IDS, query_descriptors=NANS),
    lambda path: path.write_bytes(b"PK\x03\x04" + bytes(200)),
    lambda path: path.write_bytes(b"\x93NUMPY\x01\x00"),
]


def test_hostile_predictions_are_one_refusal(board: Board) -> None:
    for number, write in enumerate(FILES, 1):
        write(file := board.home / "p.npz")
        given = {"file": "p.npz", "sha256": sha256_of_tree(file), "bytes": file.stat().st_size}
        text = submission_text(submission(predictions=given)).encode()
        files = {f"{MINE}/submission.toml": text, f"{MINE}/p.npz": file.read_bytes()}
        head = board.hosted.commit(board.hosted.resolve(), files)
        comment = board.ci(number, board.hosted.pull(number, head), code=1)
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
    assert "| the last version | 1,234 | 40.00 |" in made
    far = found(answer=answer(["East"], scenes={"s0": {"k0": (float("inf"), None, None)}}))
    assert "| `East` | 1,234 | inf |" in comment_on(far)
    assert Found.model_validate_json(far.model_dump_json()) == far


def test_the_log_gives_no_command_to_the_runner(board: Board) -> None:
    files = {os.fspath(f"{MINE}/a\n::set-output\x1b[2J"): b"x"}
    head = board.hosted.commit(board.hosted.resolve(), files)
    work = board.score(1, board.hosted.pull(1, head), code=1)
    said = board.comment(work / "found-score.json")
    assert "set-output" in said
    assert "set-output" not in outside_code(said)
    places = ("--out", work / "f.json", "--work", work / "again")
    done = board.step("score", "--event", work / "event.json", *places, code=1)
    assert done.stdout == "refused\n"
    assert all(line.startswith("| ") for line in done.stderr.splitlines())
    assert "\x1b" not in done.stderr
