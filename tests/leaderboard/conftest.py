"""One small world for all tests of boards: submissions, a hosted repository, people and CI."""

from __future__ import annotations

import datetime
import json
import os
import subprocess
import tempfile
import tomllib
from collections.abc import Sequence
from functools import cache, partial, reduce
from itertools import product
from pathlib import Path
from typing import Any
from unittest import mock

import pandas as pd
import pytest
import tomli_w
from PIL import Image, PngImagePlugin
from typer.testing import CliRunner, Result

from airzoo_bench.benchmark.folder import BenchmarkFile, write_benchmark_file
from airzoo_bench.cli.main import app
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.leaderboard.answers import Answer
from airzoo_bench.leaderboard.board import BOARD_FILE
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission
from tests.api.place import NAME, make_field
from tests.report.conftest import browser, opened
from tests.statistics.support import HIT
from tests.support import made_once, write_predictions

__all__ = ["browser", "opened"]

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
OPTIONS = [
    *("--method", "SALAD", "--team", "Example Lab", "--author", "Ada Example"),
    *("--contact", "ada@example.org", "--licence", "CC-BY-4.0", "--training-data", "none"),
    *("--stages", "single-stage", "--set", f"account={ADA}"),
]


def values(**changes: Any) -> dict[str, Any]:
    """Return the keys of a sound submission, some changed; None takes a key out."""
    found: dict[str, Any] = {"schema": 1, "protocol": PROTOCOL, "date": datetime.date(2026, 3, 1)}
    found |= {"method": "SALAD", "team": "Example Lab", "account": ADA}
    found |= {"contact": "ada@example.org", "authors": ["Ada Example"], "licence": "CC-BY-4.0"}
    found |= {"training_data": ["gsv-cities"], "pipeline": {"stages": "single-stage"}}
    found |= {"predictions": {"file": "preds.npz", "sha256": "0" * 64, "bytes": 1}} | changes
    return {key: value for key, value in found.items() if value is not None}


def submission(**changes: Any) -> Submission:
    return Submission.model_validate(values(**changes))


def write_submission(root: Path, arrays: Any, folder: str = "salad", **changes: Any) -> Path:
    """Write predictions and what states them, in place of earlier ones; return their folder."""
    (home := root / HOME / folder).mkdir(parents=True, exist_ok=True)
    file = write_predictions(home / "preds.npz", PROTOCOL, **arrays)
    stated = {"file": file.name, "sha256": sha256_of_tree(file), "bytes": file.stat().st_size}
    keys = values(**({"predictions": stated} | changes))
    (home / SUBMISSION_FILE).write_text(tomli_w.dumps(keys), encoding="utf-8")
    return home


def made_answer(titles: Sequence[str], *, sealed: bool = False, **row: Any) -> Answer:
    """Return an answer by R@1 on scenes of these titles, as no run gave it."""
    scenes = [{"id": f"s{n}", "title": text, "queries": 50} for n, text in enumerate(titles)]
    head = {"benchmark": "made", "track": "retrieval", "protocol": PROTOCOL, "scenes": scenes}
    head |= {"protocol_version": 1, "protocol_fingerprint": "f", "sealed": sealed}
    facts = {"tree": "", "scored": "2026-04-01", "version": "1", "columns": [HIT.model_dump()]}
    return Answer.model_validate(facts | {"head": head, "row": {"method": "M"} | row})


def files_of(folder: Path) -> dict[str, bytes]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def run(*arguments: object, code: int = 0, answers: Sequence[object] = ()) -> Result:
    answered = "".join(f"{answer}\n" for answer in answers)
    done = CliRunner().invoke(app, [str(one) for one in arguments], input=answered)
    assert done.exit_code == code, (done.output, done.exception)
    return done


# --- a benchmark of every track ---

SCENE, TRUE_PLACE = f"scenes/{NAME}", "401234.5 3120234.5"


def make_host(root: Path) -> None:
    """Make a benchmark of every track with all files that `prepare` can write, and a host's own."""
    with mock.patch.dict("os.environ", {"AIRZOO_BENCH_DATA": str(root / "data")}):
        folder = make_field(root, "--copy", "--tiles", "files", "--crops", "files")
    notes = PngImagePlugin.PngInfo()
    notes.add_text("place", TRUE_PLACE)
    with Image.open(path := folder / "data" / NAME / "images/a.png") as image:
        image.save(path, pnginfo=notes)
    tiles = folder / SCENE / "retrieval/tiles.parquet"
    pd.read_parquet(tiles).assign(seen_share=0.5).to_parquet(tiles)
    photos = folder / SCENE / "reconstruction/photos.csv"
    pd.read_csv(photos).assign(seen_share=0.5).to_csv(photos, index=False)
    stated = tomllib.loads((folder / "benchmark.toml").read_text())
    write_benchmark_file(folder, BenchmarkFile.model_validate(stated))


@pytest.fixture(scope="session")
def host(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_once(tmp_path_factory, "host", make_host) / "data" / NAME


def write_template(track: str, data: Path, folder: Path) -> Path:
    """Write random predictions for a track of it, where a submission would have them."""
    path = folder / NAME / track / "m" / ("p" if track == "reconstruction" else "p.npz")
    path.parent.mkdir(parents=True)
    run("template", f"{NAME}-{track}", "--data", data, "--out", path)
    return path


# --- a hosted repository ---

ROLES = product(("AUTHOR", "COMMITTER"), ("NAME", "EMAIL"))
AUTHOR = {f"GIT_{role}_{key}": "someone@example.org" for role, key in ROLES}
AUTHOR |= {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"}
os.environ |= AUTHOR  # the code under test calls git too

Files = dict[str, Any]
"""By path: bytes, a mode with bytes or the id of an object, or a folder; None is no file."""


def git(folder: Path, *arguments: object, stdin: bytes = b"") -> str:
    line = ["git", *map(str, arguments)]
    done = subprocess.run(line, cwd=folder, input=stdin, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.decode().strip()


class Hosted:
    """A bare repository as GitHub keeps it, into which objects are written as they are given."""

    def __init__(self, folder: Path, files: Files) -> None:
        self.folder, self.git = folder, cache(partial(git, folder))  # an object is written once
        git(Path(), "init", "--quiet", "--bare", "--initial-branch=main", folder)
        git(folder, "config", "uploadpack.allowFilter", "true")
        self.first = self.move("heads/main", self.commit(files))

    def move(self, name: str, commit: str) -> str:
        """Let a branch or a pull request point to a commit, as after a push to it."""
        git(self.folder, "update-ref", f"refs/{name}", commit)
        return commit

    def store(self, file: Any) -> str:
        """Store a file or a folder, whatever its names, and return its line in a tree."""
        if isinstance(file, dict):
            kinds = {id(one): one for one in file.values()}  # a bomb is one object many times
            stored = {key: self.store(one) for key, one in kinds.items()}
            lines = "".join(f"{stored[id(one)]}\t{name}\0" for name, one in file.items())
            made = self.git("mktree", "-z", "--missing", stdin=os.fsencode(lines))
            return f"040000 tree {made}"
        mode, content = file if isinstance(file, tuple) else ("100644", file)
        if isinstance(content, bytes):
            content = self.git("hash-object", "-w", "--stdin", stdin=content)
        return f"{mode} {'commit' if mode == '160000' else 'blob'} {content}"

    def commit(self, files: Files, *parents: str) -> str:
        tree: Files = {}
        for path, file in ((path, file) for path, file in files.items() if file is not None):
            *folders, name = path.split("/")
            reduce(lambda at, part: at.setdefault(part, {}), folders, tree)[name] = file
        before = [f"-p{parent}" for parent in parents]
        return git(self.folder, "commit-tree", "-m", "x", *before, self.store(tree).split()[-1])


class Board:
    """The hosted repository, and what people and CI do with it; `log` is of the last scoring."""

    log: Result

    def __init__(self, home: Path) -> None:
        self.home, self.hosted = home, Hosted(home / "hosted.git", {".keep": b""})
        self.main = self.clone("main")
        run("leaderboard", "init", self.main, "--repository", "lab/board")
        (self.main / BOARD_FILE).write_text(BOARD)
        self.push(self.main)

    def clone(self, name: str) -> Path:
        git(self.home, "clone", "--quiet", "hosted.git", name)
        return self.home / name

    def push(self, clone: Path, ref: str = "heads/main") -> str:
        """Commit everything in a clone, push it, and return the commit."""
        git(clone, "add", "--all")
        git(clone, "commit", "--quiet", "--allow-empty", "-m", f"change of {ref}")
        git(clone, "push", "--quiet", "--force", "origin", f"HEAD:refs/{ref}")
        return git(clone, "rev-parse", "HEAD")

    def step(self, name: str, *arguments: object, code: int = 0) -> Result:
        places = ("--remote", self.hosted.folder, "--root", self.main)
        return run("leaderboard", name, *arguments, *places, code=code)

    def score(self, number: int, head: str, account: int = ADA, *, code: int = 0) -> Path:
        """Play the job that checks a pull request, and return its findings."""
        (work := self.home / f"{head}-{account}").mkdir()
        pull = {"number": number, "head": {"sha": head}, "base": {"ref": "main"}}
        pull |= {"user": {"id": account}}
        (event := work / "event.json").write_text(json.dumps({"pull_request": pull}))
        out, options = work / "found-score.json", ("--event", event, "--work", work / "work")
        self.log = self.step("score", *options, "--out", out, code=code)
        return out

    def comment(self, *findings: Path) -> str:
        run("leaderboard", "comment", *findings, "--out", self.home / "comment.md")
        return (self.home / "comment.md").read_text()

    def ci(self, number: int, clone: Path, account: int = ADA, *, code: int = 0) -> str:
        """Push a clone to a pull request, and return the comment on it."""
        head = self.push(clone, f"pull/{number}/head")
        return self.comment(self.score(number, head, account, code=code))

    def merge(self, number: int, head: str = "FETCH_HEAD") -> None:
        git(self.main, "fetch", "--quiet", "origin", f"refs/pull/{number}/head")
        git(self.main, "merge", "--quiet", "--squash", head)
        self.push(self.main)

    def rescore(self, *, said: str = "", code: int = 0) -> Path:
        """Score what was merged, and return the folder of all runs; `said` is in the log."""
        data = Path(tempfile.mkdtemp(dir=self.home))
        self.log = self.step("score", "--out", data, code=code)
        assert said in self.log.stderr
        return data

    def build(self, *, said: str = "") -> Path:
        """Play the workflow of the board, and return the site."""
        data = self.rescore(said=said)
        run("leaderboard", "build", "--runs", data, "--out", data / "site", "--root", self.main)
        self.step("keep", data)
        return data / "site"

    def data_file(self, path: str) -> str:
        return git(self.hosted.folder, "show", f"leaderboard-data:{path}")


@pytest.fixture
def board(tmp_path: Path, data: Path, monkeypatch: Any) -> Board:
    """Return a new board, which reads predictions in this process: a second less each time."""
    monkeypatch.setattr("airzoo_bench.cli.leaderboard.Limits", lambda _: None)
    return Board(tmp_path / "world")
