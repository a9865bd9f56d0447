"""One made-up board for all tests: submissions, runs, a hosted repository, and its CI."""

from __future__ import annotations

import datetime
import json
import os
import shutil
import subprocess
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
import pytest
import tomli_w
from PIL import Image, PngImagePlugin
from typer.testing import CliRunner, Result

from airzoo_bench.benchmark.folder import BenchmarkFile, write_benchmark_file
from airzoo_bench.cli.main import app
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard import answers
from airzoo_bench.leaderboard.board import BOARD_FILE, known_submissions, read_board
from airzoo_bench.leaderboard.checks import CheckedSubmission, Rules, check_submission
from airzoo_bench.leaderboard.pages import build_board
from airzoo_bench.leaderboard.submission import Submission, submission_text
from airzoo_bench.results.records import Method
from tests.api.place import NAME, make_field
from tests.report.conftest import browser
from tests.statistics.support import HIT, made_method, write_method
from tests.support import made_once, protocol, write_predictions

__all__ = ["browser"]

ADA, BOB, MAINTAINER = 1001, 1002, 1
PROTOCOL = "made-retrieval"
HOME, RUNS = "submissions/made/retrieval", "runs/made/retrieval"
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
COLUMNS = (HIT, HIT.model_copy(update={"key": "recall@5", "title": "R@5"}))

# --- submissions ---

OPTIONS = [
    *("--team", "Example Lab", "--contact", "ada@example.org", "--author", "Ada Example"),
    *("--licence", "CC-BY-4.0", "--training-data", "none", "--stages", "single-stage"),
]


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
    rules = Rules(read_board(root / BOARD_FILE), root, data, Run())
    return check_submission(folder, rules, known_submissions(root), seconds)


# --- a benchmark of every track ---

SCENE, TRUE_PLACE = f"scenes/{NAME}", "401234.5 3120234.5"


def write_sums(folder: Path) -> None:
    """Write the checksums of a folder whose files were changed by hand."""
    values = tomllib.loads((folder / "benchmark.toml").read_text())
    write_benchmark_file(folder, BenchmarkFile.model_validate(values))


def make_host(root: Path) -> None:
    """Make a benchmark of every track with all files that `prepare` can write, and a host's own."""
    with mock.patch.dict("os.environ", {"AIRZOO_BENCH_DATA": str(root / "data")}):
        folder = make_field(root, "--copy", "--tiles", "files", "--crops", "files")
    notes = PngImagePlugin.PngInfo()
    notes.add_text("place", TRUE_PLACE)
    with Image.open(path := folder / "data" / NAME / "images/a.png") as image:
        image.save(path, pnginfo=notes)
    at = folder / SCENE
    tiles, photos = at / "retrieval/tiles.parquet", at / "reconstruction/photos.csv"
    pd.read_parquet(tiles).assign(seen_share=0.5).to_parquet(tiles)
    pd.read_csv(photos).assign(seen_share=0.5).to_csv(photos, index=False)
    write_sums(folder)


@pytest.fixture(scope="session")
def host(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_once(tmp_path_factory, "host", make_host) / "data" / NAME


def write_template(track: str, data: Path, folder: Path) -> Path:
    """Write random predictions for a track of it, where a submission would have them."""
    path = folder / NAME / track / "m" / ("p" if track == "reconstruction" else "p.npz")
    path.parent.mkdir(parents=True)
    run("template", f"{NAME}-{track}", "--data", data, "--out", path)
    return path


# --- runs, and the board that is built of them ---


def method(name: str, rate: float, columns: Any = COLUMNS, **result: Any) -> Method:
    """Return a method of some skill, whose easy queries are those of the others too."""
    shared, own = np.random.default_rng(7), np.random.default_rng([0, *name.encode()])
    scenes = {}
    for scene, size in {"east": 30, "west": 20}.items():
        ease = 0.7 * shared.random(size) + 0.3 * own.random(size)
        made = {c.key: (ease < rate + 0.2 * (c.key == "recall@5")).astype(float) for c in columns}
        made["error_m"] = np.where(ease > 0.95, np.inf, np.round(ease * 30 * (1.5 - rate), 6))
        scenes[scene] = {c.key: made[c.key].tolist() for c in columns}
    return made_method(scenes, columns, name, **result)


def made_answer(titles: Sequence[str], *, sealed: bool = False, **row: Any) -> answers.Answer:
    """Return an answer by R@1 on scenes of these titles, as no run gave it."""
    scenes = [{"id": f"s{n}", "title": text, "queries": 50} for n, text in enumerate(titles)]
    head = {"benchmark": "made", "track": "retrieval", "protocol": PROTOCOL, "scenes": scenes}
    head |= {"protocol_version": 1, "protocol_fingerprint": "f", "sealed": sealed}
    facts = {"tree": "", "scored": "2026-04-01", "version": "1", "columns": [HIT.model_dump()]}
    return answers.Answer.model_validate(facts | {"head": head, "row": {"method": "M"} | row})


def write_run(
    root: Path, folder: str, number: int, scored: Method, *, day: int = 1, **fields: Any
) -> None:
    """Write a run of the data branch below a folder."""
    run = root / RUNS / folder / str(number)
    write_method(run, scored)
    when = {"scored": f"2026-04-{day:02}T12:00:00Z"}
    answer = answers.measure(run, "d" * 64).model_copy(update=when)
    given = submission(**{"team": "Team", "method": scored.name} | fields)
    answers.write_run(run, given, answer)


def write_runs(root: Path, count: int = 4) -> Path:
    """Write so many submissions, the first with an earlier version."""
    for number in range(count):
        made = method(f"Method {number}", 0.25 + 0.5 * number / count)
        write_run(root, f"m{number}", 1 + (number == 0), made, day=number % 28 + 1)
    write_run(root, "m0", 1, method("Method 0", 0.1))
    return root


def built(root: Path, out: str = "site") -> tuple[Path, list[str]]:
    """Build the board of a folder with runs and submissions; return the site and the notes."""
    scenes = ({"id": "east", "title": "East"},)
    made = protocol(name=PROTOCOL, benchmark="made", scenes=scenes)
    place = root / f"data/made/protocols/{PROTOCOL}.toml"
    place.parent.mkdir(parents=True, exist_ok=True)
    keys = made.model_dump(mode="json", by_alias=True, exclude_none=True)
    place.write_text(tomli_w.dumps(keys), encoding="utf-8")
    (root / BOARD_FILE).write_text(BOARD)
    board, site = read_board(root / BOARD_FILE), root / out
    return site, build_board(root, root / "submissions", board, root / "data", site)


def board_of(site: Path) -> Any:
    return json.loads((site / "board.json").read_text(encoding="utf-8"))


def rows_of(site: Path, table: str = PROTOCOL) -> dict[str, Any]:
    return {row["id"]: row for row in board_of(site)["tables"][table]["rows"]}


def files_of(folder: Path) -> dict[str, bytes]:
    """Return all files of a folder."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


# --- a hosted repository, with trees that no program would make ---

AUTHOR = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"}
AUTHOR |= {f"GIT_{role}_NAME": "someone" for role in ("AUTHOR", "COMMITTER")}
AUTHOR |= {f"GIT_{role}_EMAIL": "someone@example.org" for role in ("AUTHOR", "COMMITTER")}
_COMMIT = "commit refs/tests/made\nmark :1\ncommitter a <a@example.org> 1700000000 +0000\ndata 0\n"

File = bytes | tuple[str, bytes] | None
"""The content of a plain file, or another mode and the content (or, of a submodule, the commit);
None removes one."""


def git(folder: Path, *arguments: str, stdin: bytes = b"") -> str:
    """Run git and return what it prints."""
    own = os.environ | AUTHOR
    done = subprocess.run(
        ["git", *arguments], cwd=folder, input=stdin, capture_output=True, env=own
    )
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout.decode().strip()


class Hosted:
    """A bare repository as GitHub keeps it, with main and pull requests."""

    def __init__(self, folder: Path, files: Mapping[str, File] | None = None) -> None:
        self.folder = folder
        if files is not None:
            folder.mkdir(parents=True)
            git(folder, "init", "--quiet", "--bare", "--initial-branch=main")
            git(folder, "config", "uploadpack.allowFilter", "true")
            self.move("refs/heads/main", self.commit(None, files))

    def commit(self, parent: str | None, files: Mapping[str, File]) -> str:
        """Commit files on top of a parent."""
        lines = [f"{_COMMIT}from {parent}\n".encode() if parent else _COMMIT.encode()]
        for name, file in files.items():
            path = b'"%s"\n' % b"".join(b"\\%03o" % letter for letter in os.fsencode(name))
            mode, content = file if isinstance(file, tuple) else ("100644", file)
            line = b"D %s" % path if content is None else b"M 160000 %s %s" % (content, path)
            if content is not None and mode != "160000":
                head = (mode.encode(), path, len(content), content)
                line = b"M %s inline %sdata %d\n%s\n" % head
            lines.append(line)
        lines.append(b"get-mark :1\n")
        return git(self.folder, "fast-import", "--quiet", "--force", stdin=b"".join(lines))

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


def run(*arguments: object, code: int = 0) -> Result:
    """Run a command in this process."""
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    assert done.exit_code == code, (done.output, done.exception)
    return done


class Board:
    """The hosted repository, and what CI and people do with it; `log` is of the last scoring."""

    log: Result

    def __init__(self, home: Path) -> None:
        self.home, self.main, self.jobs = home, home / "main", 0
        self.hosted = Hosted(home / "hosted.git")

    def clone(self, name: str) -> Path:
        git(self.home, "clone", "--quiet", "hosted.git", name)
        return self.home / name

    def update(self, fork: Path) -> None:
        """Bring a fork to the present main."""
        git(fork, "fetch", "--quiet", "origin")
        git(fork, "reset", "--quiet", "--hard", "origin/main")

    def step(self, name: str, *arguments: object, code: int = 0) -> Result:
        """Run a step of CI."""
        places = ("--remote", self.hosted.folder, "--root", self.main)
        return run("leaderboard", name, *arguments, *places, code=code)

    def push_main(self, message: str) -> None:
        git(self.main, "add", "-A")
        git(self.main, "commit", "--quiet", "-m", message)
        git(self.main, "push", "--quiet", "origin", "HEAD:main")

    def submit(
        self, fork: Path, arrays: Mapping[str, Any], name: str, *more: object, account: int = ADA
    ) -> Path:
        """Make a submission by the documented command, and return its folder."""
        predictions = write_predictions(self.home / f"{name}.npz", PROTOCOL, **arrays)
        own = ("--board", fork, "--method", name, "--set", f"account={account}", "--no-commit")
        run("submit", predictions, *OPTIONS, *own, *more)
        return fork / HOME / name.lower()

    def propose(self, fork: Path, number: int) -> str:
        """Commit in a fork and let a pull request point to it."""
        git(fork, "add", "-A")
        git(fork, "commit", "--quiet", "-m", f"change of {number}")
        git(fork, "push", "--quiet", "--force", "origin", f"HEAD:refs/pull/{number}/head")
        return git(fork, "rev-parse", "HEAD")

    def score(self, number: int, head: str, account: int = ADA, *, code: int = 0) -> Path:
        """Play the job that checks a pull request, and return the folder of its files."""
        self.jobs += 1
        (work := self.home / f"run{self.jobs}").mkdir()
        # What GitHub tells of a pull request, with fields that nobody reads.
        pull = {"number": number, "title": "`$(id)`", "head": {"sha": head, "ref": "$(reboot)"}}
        pull |= {"base": {"ref": "main"}, "user": {"login": "a", "id": account}}
        event = work / "event.json"
        event.write_text(json.dumps({"pull_request": pull, "sender": {"id": 1}}))
        places = ("--out", work / "found-score.json", "--work", work / "work")
        self.log = self.step("score", "--event", event, *places, code=code)
        return work

    def comment(self, *findings: Path) -> str:
        run("leaderboard", "comment", *findings, "--out", self.home / "comment.md")
        return (self.home / "comment.md").read_text()

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
        self.jobs += 1
        data = self.home / f"data{self.jobs}"
        done = self.step("score", "--out", data, code=code)
        assert said is None or (said in done.stderr and bool(said) == bool(done.stderr))
        return data

    def build(self, *, said: str | None = None) -> Path:
        """Play the workflow of the board, and return the site."""
        data = self.rescore(said=said)
        site = self.home / f"site{self.jobs}"
        run("leaderboard", "build", "--runs", data, "--out", site, "--root", self.main)
        self.step("keep", data)
        return site

    def data_file(self, path: str) -> str:
        return git(self.hosted.folder, "show", f"leaderboard-data:{path}")


# --- boards that are made once, and a browser for their pages ---


@pytest.fixture(scope="session")
def new_board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a hosted board as `leaderboard init` begins it, and a clone; both are copied."""
    home = tmp_path_factory.mktemp("new")
    Hosted(home / "hosted.git", {".keep": b""})
    board = Board(home)
    git(board.clone("main"), "config", "remote.origin.url", "../hosted.git")
    run("leaderboard", "init", board.main, "--repository", "lab/board")
    (board.main / BOARD_FILE).write_text(BOARD)
    board.push_main("A board")
    return home


@pytest.fixture
def board(new_board: Path, tmp_path: Path, data: Path, monkeypatch: pytest.MonkeyPatch) -> Board:
    """Return a new board, which reads predictions in this process: a second less each time."""
    for name, value in AUTHOR.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("airzoo_bench.cli.leaderboard.Limits", lambda _: None)
    return Board(Path(shutil.copytree(new_board, tmp_path / "world")))


@pytest.fixture(scope="session")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the runs of four submissions and the site that is built of them."""
    folder = write_runs(tmp_path_factory.mktemp("board"))
    built(folder)
    return folder


@pytest.fixture
def opened(browser: Any) -> Iterator[Any]:
    from tests.report.browser import Opened

    browser.set_window_size(1280, 900)
    yield Opened(browser)
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
    # A refused script, style or address would stand here, as would any error.
    assert browser.get_log("browser") == []
