"""The template for GitLab: what its pipelines do, and what each of its jobs is given."""

from __future__ import annotations

import base64
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.leaderboard.ci.git_process import GitProcess
from tests.leaderboard.ci.gitlab import (
    PATH,
    PROJECT,
    SECRETS,
    Api,
    Pipeline,
    Project,
    running_api,
)
from tests.leaderboard.ci.repositories import git
from tests.leaderboard.ci.walk import ADA, BOARD, BOB, Board, Run, submit, worse

pytestmark = pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
READING = {"score", "sealed", "build"}
WRITING = {"ask", "try", "tell", "record", "merged"}


@pytest.fixture
def api() -> Iterator[Api]:
    with running_api() as found:
        yield found


@pytest.fixture
def board(tmp_path: Path, data: Path, command: Run) -> Board:
    """Return a board of the made benchmark, as `leaderboard init --gitlab` begins it."""
    made = Board(tmp_path / "world", command)
    made.run("leaderboard", "init", made.main, "--gitlab", "--repository", PATH)
    (made.main / "leaderboard.toml").write_text(BOARD)
    (made.main / ".ci" / "get-data").write_text("#!/bin/sh\n")
    made.push_main("A board")
    return made


@pytest.fixture
def project(board: Board, api: Api) -> Project:
    return Project(board.hosted.folder, board.home / "jobs", api)


def propose(board: Board, api: Api, fork: Path, number: int, account: int) -> dict[str, Any]:
    """Open a merge request, and return it as the API tells of it."""
    head = board.propose(fork, number)
    ref = f"refs/merge-requests/{number}/head"
    git(fork, "push", "--quiet", "--force", "origin", f"HEAD:{ref}")
    told = {
        "id": 155016530, "iid": number, "state": "opened", "title": "`$(reboot)`", "sha": head,
        "target_branch": "main", "source_branch": "$(reboot)", "author": {"id": account},
    }  # fmt: skip
    api.answers[f"{PROJECT}/merge_requests/{number}"] = told
    return told


def test_from_a_merge_request_to_pages(
    board: Board, api: Api, project: Project, perfect: dict[str, list[Any]]
) -> None:
    fork = board.clone("ada")
    submit(board, fork, worse(perfect), "Salad")
    told = propose(board, api, fork, 1, ADA)
    ran = project.pipeline("web", MERGE_REQUEST_IID="1")
    assert {name: job.code for name, job in ran.items()} == dict.fromkeys(
        ("ask", "score", "try", "sealed", "tell"), 0
    )
    assert "### `Salad` by `Example Lab`" in api.notes[0]
    assert f"`glab mr merge 1 --squash --auto-merge=false --sha {told['sha']}`" in api.notes[0]

    # Merged: the account owns the folder, once, and the site is published.
    git(board.main, "pull", "--quiet", "origin", "refs/merge-requests/1/head")
    git(board.main, "push", "--quiet", "origin", "HEAD:main")
    commit = git(board.main, "rev-parse", "HEAD")
    api.answers[f"{PROJECT}/repository/commits/{commit}/merge_requests"] = [
        told | {"state": "merged"}
    ]
    for _ in range(2):
        ran = project.pipeline()
        assert {name: job.code for name, job in ran.items()} == dict.fromkeys(
            ("build", "record", "pages", "all-scored", "merged"), 0
        )
    rows = [row.split(",") for row in board.data_file("ledger.csv").splitlines()[1:]]
    assert [(row[0], row[6]) for row in rows] == [(str(ADA), "scored"), (str(ADA), "merged")]
    assert board.data_file("runs/made/retrieval/salad/1/run.json")

    # Another account is refused, the pipeline is red, and the comment says why.
    submit(board, fork, perfect, "Salad", "--force")
    propose(board, api, fork, 2, BOB)
    ran = project.pipeline("web", MERGE_REQUEST_IID="2")
    assert {name: job.code for name, job in ran.items()} == {"ask": 0, "score": 1, "tell": 0}
    assert "belongs to another account" in api.notes[-1]

    # One that cannot be scored keeps no other from the site, and is not passed over in silence.
    broken = board.main / "submissions/made/retrieval/broken"
    shutil.copytree(board.main / "submissions/made/retrieval/salad", broken)
    next(broken.glob("*.npz")).write_bytes(b"damaged")
    board.push_main("broken")
    commit = git(board.main, "rev-parse", "HEAD")
    api.answers[f"{PROJECT}/repository/commits/{commit}/merge_requests"] = []
    ran = project.pipeline()
    assert {name: job.code for name, job in ran.items()} == {
        "build": 0, "record": 0, "pages": 0, "all-scored": 1, "merged": 0
    }  # fmt: skip
    assert "retrieval/broken: key 'predictions.bytes'" in ran["build"].log


def test_what_reads_submissions_has_no_token_that_writes(board: Board, project: Project) -> None:
    pipeline = Pipeline(project, project.config(), board.home, "web", {})
    jobs = dict(job for stage in pipeline.config["stages"] for job in pipeline.jobs(stage))
    given = {name: SECRETS.keys() & pipeline.variables(job, "") for name, job in jobs.items()}
    assert {name for name, secrets in given.items() if secrets == {"LEADERBOARD_TOKEN"}} == WRITING
    assert {name: given[name] for name in READING} == {
        "score": set(), "build": set(), "sealed": {"AIRZOO_BENCH_KEY"}
    }  # fmt: skip
    for name, job in jobs.items():
        script = "\n".join([*job["before_script"], *job["script"]])
        assert ("LEADERBOARD_TOKEN" in script) == (name in WRITING), name
        assert "CI_JOB_TOKEN" not in script or job["variables"]["GIT_USER"] == "gitlab-ci-token"
    assert "unshare --net airzoo-bench" in "\n".join(jobs["sealed"]["script"])


@pytest.mark.parametrize(
    ("path", "source", "given"),
    [
        (PATH, "merge_request_event", {}),
        (PATH, "merge_request_event", {"MERGE_REQUEST_IID": "1"}),
        ("ada/board", "push", {}),
        ("ada/board", "web", {"MERGE_REQUEST_IID": "1"}),
        (PATH, "web", {"MERGE_REQUEST_IID": "1/../../../user"}),
        (PATH, "web", {"MERGE_REQUEST_IID": ""}),
    ],
)
def test_nothing_runs(
    board: Board, api: Api, path: str, source: str, given: dict[str, str]
) -> None:
    elsewhere = Project(board.hosted.folder, board.home / "jobs", api, path)
    assert elsewhere.pipeline(source, **given) == {}


def test_a_merge_request_that_is_none_stops_at_once(board: Board, project: Project) -> None:
    ran = project.pipeline("web", MERGE_REQUEST_IID="9")
    assert {name: job.code != 0 for name, job in ran.items()} == {"ask": True, "tell": False}


def test_gitlab_s_own_schema_takes_the_template(board: Board) -> None:
    pytest.importorskip("check_jsonschema")
    done = subprocess.run(
        [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.gitlab-ci",
         "--data-transform", "gitlab-ci", board.main / ".gitlab-ci.yml"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("user", [None, "gitlab-ci-token"])
def test_token_goes_with_its_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, user: str | None
) -> None:
    monkeypatch.setenv("GIT_TOKEN", "of-the-job")
    if user is not None:
        monkeypatch.setenv("GIT_USER", user)
    process = GitProcess(tmp_path, "https://gitlab.com/lab/board.git")
    header = process.run("config", "--get-regexp", "extraheader").split()[-1]
    assert base64.b64decode(header).decode() == f"{user or 'x-access-token'}:of-the-job"
