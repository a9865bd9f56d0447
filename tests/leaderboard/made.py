"""One made-up board for all tests: submissions, runs, a hosted repository, and its CI."""

from __future__ import annotations

import base64
import datetime
import json
import os
import subprocess
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from typer.testing import Result

from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.leaderboard.answers import Answer, measure
from airzoo_bench.leaderboard.answers import write_run as keep_run
from airzoo_bench.leaderboard.board import BOARD_FILE, known_submissions, read_board
from airzoo_bench.leaderboard.checks import CheckedSubmission, check_submission
from airzoo_bench.leaderboard.pages import build_board
from airzoo_bench.leaderboard.submission import Submission, submission_text
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import ScoreColumn
from tests.statistics.support import HIT, made_method, write_method
from tests.support import protocol, write_predictions

Command = Callable[..., Result]

ADA, BOB, MAINTAINER = 1001, 1002, 1
PROTOCOL = "made-retrieval"
HOME = "submissions/made/retrieval"
BOARD = f"""schema = 1
title = "A board"
url = "https://example.org/board"
repository = "lab/board"
maintainers = [{MAINTAINER}]
[[benchmarks]]
name = "uav-visloc"
title = "VisLoc"
protocols = ["uav-visloc-retrieval"]
[[benchmarks]]
name = "made"
title = "Made"
protocols = ["{PROTOCOL}"]
"""
COLUMNS = (
    HIT,
    HIT.model_copy(update={"key": "recall@5", "title": "R@5"}),
    HIT.model_copy(update={"key": "ap@5", "title": "AP@5"}),
)

# --- submissions ---


def values(**changes: Any) -> dict[str, Any]:
    """Return the keys of a sound submission, some changed; None takes a key out."""
    found: dict[str, Any] = {
        "schema": 1,
        "protocol": PROTOCOL,
        "method": "SALAD",
        "team": "Example Lab",
        "account": ADA,
        "contact": "ada@example.org",
        "authors": ["Ada Example"],
        "date": datetime.date(2026, 3, 1),
        "licence": "CC-BY-4.0",
        "training_data": ["gsv-cities"],
        "pipeline": {"stages": "single-stage"},
        "predictions": {"file": "preds.npz", "sha256": "0" * 64, "bytes": 1},
    } | changes
    return {key: value for key, value in found.items() if value is not None}


def submission(**changes: Any) -> Submission:
    return Submission.model_validate(values(**changes))


def write_submission(
    root: Path, arrays: Mapping[str, Any], folder: str = "salad", **changes: Any
) -> Path:
    """Write a submission with its predictions and their hash, and return its folder."""
    home = root / HOME / folder
    home.mkdir(parents=True)
    file = write_predictions(home / "preds.npz", PROTOCOL, **arrays)
    given = {"sha256": sha256_of_tree(file), "bytes": file.stat().st_size, "file": file.name}
    stated = submission(**({"predictions": given} | changes))
    (home / "submission.toml").write_text(submission_text(stated), encoding="utf-8")
    return home


def checked(folder: Path, data: Path, seconds: float = 0.0) -> CheckedSubmission:
    """Check a folder as the command line does."""
    root = folder.parents[3]
    board = read_board(root / BOARD_FILE)
    return check_submission(folder, board, data, known=known_submissions(root), seconds=seconds)


# --- runs, and the board that is built of them ---


def method(
    name: str,
    rate: float,
    sizes: Mapping[str, int] = {"east": 30, "west": 20},
    columns: Sequence[ScoreColumn] = COLUMNS,
    seed: int = 0,
    **result: Any,
) -> Method:
    """Return a method of some skill, whose easy queries are those of the others too."""
    shared, own = np.random.default_rng(7), np.random.default_rng([seed, *name.encode()])
    scenes = {}
    for scene, size in sizes.items():
        ease = 0.7 * shared.random(size) + 0.3 * own.random(size)
        scenes[scene] = {c.key: _scores(c, ease, rate).tolist() for c in columns}
    return made_method(scenes, columns, name, **result)


def _scores(column: ScoreColumn, ease: np.ndarray, rate: float) -> np.ndarray:
    if column.key.startswith("ap"):
        return np.clip(np.floor(5 * (rate + 0.5 - ease)), 0, 5) / 5
    if column.unit == "share":
        return (ease < rate + 0.2 * (column.key == "recall@5")).astype(float)
    return np.where(ease > 0.95, np.inf, np.round(ease * 30 * (1.5 - rate), 6))


def write_answer(root: Path, folder: str, number: int, answer: Answer, **fields: Any) -> None:
    """Write the submission and the answer of a run of the data branch."""
    given = submission(**{"team": "Team"} | fields)
    keep_run(root / "runs/made/retrieval" / folder / str(number), given, answer)


def write_run(
    root: Path, folder: str, number: int, scored: Method, *, day: int = 1, **fields: Any
) -> None:
    """Write a run of the data branch below a folder."""
    run = root / "runs/made/retrieval" / folder / str(number)
    write_method(run, scored)
    when = {"scored": f"2026-04-{day:02}T12:00:00Z"}
    answer = measure(run, "d" * 64).model_copy(update=when)
    write_answer(root, folder, number, answer, method=scored.name, **fields)


def write_runs(root: Path, count: int = 4) -> Path:
    """Write so many submissions, the first with an earlier version."""
    for number in range(count):
        made = method(f"Method {number}", 0.25 + 0.5 * number / count)
        write_run(root, f"m{number}", 1 + (number == 0), made, day=number % 28 + 1)
    write_run(root, "m0", 1, method("Method 0", 0.1, seed=1))
    return root


def built(root: Path, out: str = "site", notes: list[str] | None = None) -> Path:
    """Build the board of a folder with runs and submissions, and return the site."""
    made = protocol(
        name=PROTOCOL, benchmark="made", scenes=({"id": "east", "title": "East"},)
    ).model_dump(mode="json", by_alias=True, exclude_none=True)
    place = root / f"data/made/protocols/{PROTOCOL}.toml"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(tomli_w.dumps(made), encoding="utf-8")
    (root / BOARD_FILE).write_text(BOARD)
    board, site = read_board(root / BOARD_FILE), root / out
    said = build_board(root / "runs", root / "submissions", board, root / "data", site)
    if notes is not None:
        notes += said
    return site


def board_of(site: Path) -> Any:
    return json.loads((site / "board.json").read_text(encoding="utf-8"))


def rows_of(site: Path, table: str = PROTOCOL) -> dict[str, Any]:
    return {row["id"]: row for row in board_of(site)["tables"][table]["rows"]}


def unpack_pair(pairs: Any, key: str, first: int, second: int) -> float:
    """Return a number of two ranked methods, by their places, from the pairs of board.json."""
    upper = [*zip(*np.triu_indices(len(pairs["ids"]), 1), strict=True)]
    numbers = np.frombuffer(zlib.decompress(base64.b64decode(pairs[key])), "<f4")
    return float(numbers[upper.index((first, second))])


def files_of(folder: Path) -> dict[str, bytes]:
    """Return all files of a folder."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


# --- a hosted repository, with trees that no program would make ---

AUTHOR = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"}
AUTHOR |= {f"GIT_{role}_NAME": "someone" for role in ("AUTHOR", "COMMITTER")}
AUTHOR |= {f"GIT_{role}_EMAIL": "someone@example.org" for role in ("AUTHOR", "COMMITTER")}

File = bytes | tuple[str, bytes] | None
"""The content of a plain file, or another mode and the content (or, of a submodule, the commit);
None removes one."""


def git(folder: Path, *arguments: str, stdin: bytes = b"", **environment: str) -> str:
    """Run git and return what it prints."""
    done = subprocess.run(
        ["git", *arguments], cwd=folder, input=stdin, capture_output=True,
        env=os.environ | AUTHOR | environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout.decode().strip()


class Hosted:
    """A bare repository as GitHub keeps it, with main and pull requests."""

    def __init__(self, folder: Path, files: Mapping[str, File]) -> None:
        self.folder = folder
        folder.mkdir(parents=True)
        git(folder, "init", "--quiet", "--bare", "--initial-branch=main")
        git(folder, "config", "uploadpack.allowFilter", "true")
        self.move("refs/heads/main", self.commit(None, files))

    def commit(self, parent: str | None, files: Mapping[str, File]) -> str:
        """Commit files on top of a parent, by plumbing."""
        index = {"GIT_INDEX_FILE": str(self.folder / "index.tests")}
        (self.folder / "index.tests").unlink(missing_ok=True)
        if parent is not None:
            git(self.folder, "read-tree", parent, **index)
        blobs: dict[bytes, str] = {}
        lines = b""
        for name, file in files.items():
            mode, content = file if isinstance(file, tuple) else ("100644", file)
            if content is None:
                mode, content, blobs[b""] = "0", b"", "0" * 40
            elif mode == "160000":
                blobs[content] = content.decode()
            elif content not in blobs:
                blobs[content] = git(self.folder, "hash-object", "-w", "--stdin", stdin=content)
            lines += f"{mode} {blobs[content]}\t".encode() + os.fsencode(name) + b"\0"
        git(self.folder, "update-index", "-z", "--index-info", stdin=lines, **index)
        return self.commit_tree(git(self.folder, "write-tree", **index), *filter(None, [parent]))

    def store_tree(self, entries: Mapping[str, str]) -> str:
        """Store a tree as it is, whatever its names: of mode and name the id."""
        lines = (key.encode() + b"\0" + bytes.fromhex(of) for key, of in entries.items())
        stdin, options = b"".join(lines), ("-t", "tree", "-w", "--stdin", "--literally")
        return git(self.folder, "hash-object", *options, stdin=stdin)

    def commit_tree(self, tree: str, *parents: str) -> str:
        of = [part for parent in parents for part in ("-p", parent)]
        return git(self.folder, "commit-tree", *of, tree, stdin=b"a change\n")

    def move(self, ref: str, commit: str) -> None:
        git(self.folder, "update-ref", ref, commit)

    def resolve(self, name: str = "main") -> str:
        return git(self.folder, "rev-parse", name)

    def pull(self, number: int, head: str) -> str:
        """Let a pull request point to a commit, as after a push to it."""
        self.move(f"refs/pull/{number}/head", head)
        return head


def write_event(path: Path, number: int, head: str, account: int) -> Path:
    """Write what GitHub tells a workflow of a pull request, with fields that nobody reads."""
    pull = {
        "number": number,
        "title": "`$(id)` ${{ github.token }}",
        "head": {"sha": head, "ref": "$(reboot)", "label": "x:y", "repo": {"fork": True}},
        "base": {"ref": "main", "sha": "0" * 40},
        "user": {"login": "someone", "id": account, "type": "User"},
    }
    path.write_text(json.dumps({"pull_request": pull, "sender": {"id": 1}}), encoding="utf-8")
    return path


class Board:
    """The hosted repository, and what CI and people do with it."""

    def __init__(self, home: Path, command: Command) -> None:
        self.home, self.command = home, command
        self.runs = 0
        self.hosted = Hosted(home / "hosted.git", {".keep": b""})
        self.main = self.clone("main")
        self.run("leaderboard", "init", self.main, "--repository", "lab/board")
        (self.main / BOARD_FILE).write_text(BOARD)
        self.push_main("A board")

    def clone(self, name: str) -> Path:
        git(self.home, "clone", "--quiet", str(self.hosted.folder), name)
        return self.home / name

    def update(self, fork: Path) -> None:
        """Bring a fork to the present main."""
        git(fork, "fetch", "--quiet", "origin")
        git(fork, "reset", "--quiet", "--hard", "origin/main")

    def run(self, *arguments: object, code: int = 0) -> Result:
        done = self.command(*arguments)
        assert done.exit_code == code, (done.output, done.exception)
        return done

    def step(self, name: str, *arguments: object, code: int = 0) -> Result:
        """Run a step of CI."""
        places = ("--remote", self.hosted.folder, "--root", self.main)
        return self.run("leaderboard", name, *arguments, *places, code=code)

    def push_main(self, message: str) -> None:
        git(self.main, "add", "-A")
        git(self.main, "commit", "--quiet", "-m", message)
        git(self.main, "push", "--quiet", "origin", "HEAD:main")

    def submit(
        self, fork: Path, arrays: Mapping[str, Any], name: str, *more: object, account: int = ADA
    ) -> Path:
        """Make a submission by the documented command, and return its folder."""
        predictions = write_predictions(self.home / f"{name}.npz", PROTOCOL, **arrays)
        self.run(
            "submit", predictions, "--board", fork, "--method", name, "--team", "Example Lab",
            "--contact", "ada@example.org", "--author", "Ada Example", "--licence", "CC-BY-4.0",
            "--stages", "single-stage", "--training-data", "none",
            "--set", f"account={account}", "--no-commit", *more,
        )  # fmt: skip
        return fork / HOME / name.lower()

    def propose(self, fork: Path, number: int) -> str:
        """Commit in a fork and let a pull request point to it."""
        git(fork, "add", "-A")
        git(fork, "commit", "--quiet", "-m", f"change of {number}")
        git(fork, "push", "--quiet", "--force", "origin", f"HEAD:refs/pull/{number}/head")
        return git(fork, "rev-parse", "HEAD")

    def score(self, number: int, head: str, account: int = ADA, *, code: int = 0) -> Path:
        """Play the job that checks a pull request, and return the folder of its files."""
        self.runs += 1
        work = self.home / f"run{self.runs}"
        work.mkdir()
        event = write_event(work / "event.json", number, head, account)
        places = ("--out", work / "found-score.json", "--work", work / "work")
        self.step("score", "--event", event, *places, code=code)
        return work

    def comment(self, *findings: Path) -> str:
        out = self.home / "comment.md"
        self.run("leaderboard", "comment", *findings, "--out", out)
        return out.read_text()

    def ci(self, number: int, head: str, account: int = ADA, *, code: int = 0) -> str:
        """Play the jobs on a pull request, and return the comment."""
        return self.comment(self.score(number, head, account, code=code) / "found-score.json")

    def merge(self, number: int, head: str) -> None:
        git(self.main, "pull", "--quiet", "--ff-only", "origin", "main")
        git(self.main, "fetch", "--quiet", "origin", f"refs/pull/{number}/head")
        git(self.main, "merge", "--quiet", "--squash", head)
        self.push_main(f"merge of {number}")

    def rescore(self, *, said: str | None = None, code: int = 0) -> Path:
        """Score what was merged, and return the folder of all runs; `said` stands in the log."""
        self.runs += 1
        data = self.home / f"data{self.runs}"
        done = self.step("score", "--out", data, code=code)
        assert said is None or (said in done.stderr and bool(said) == bool(done.stderr))
        return data

    def build(self, *, said: str | None = None) -> Path:
        """Play the workflow of the board, and return the site."""
        data = self.rescore(said=said)
        site = self.home / f"site{self.runs}"
        self.run("leaderboard", "build", "--runs", data, "--out", site, "--root", self.main)
        self.step("keep", data)
        return site

    def data_file(self, path: str) -> str:
        return git(self.hosted.folder, "show", f"leaderboard-data:{path}")


def worse(perfect: Mapping[str, list[Any]]) -> dict[str, list[Any]]:
    """Return predictions whose every second query is answered badly."""
    ranked = [row[::-1] if n % 2 else row for n, row in enumerate(perfect["ranked_ids"])]
    return {**perfect, "ranked_ids": ranked}
