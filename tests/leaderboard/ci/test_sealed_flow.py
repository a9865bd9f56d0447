"""A sealed benchmark in CI: a try is taken, the truth is opened without network, and counted."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import Result

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.leaderboard import sealed_scoring as scoring
from airzoo_bench.leaderboard.sealing import KEY_VARIABLE, load_pyrage
from tests.leaderboard.hosting import event, git, write_event
from tests.leaderboard.walk import ADA, BOARD, Board, submit
from tests.support import write_raster

pytest.importorskip("pyrage")

Run = Callable[..., Result]
LIMITS = "[limits]\ntries = 1\ndays = 30\n"


@pytest.fixture
def board(tmp_path: Path, data: Path, command: Run, monkeypatch: pytest.MonkeyPatch) -> Board:
    """Return a board of the made benchmark whose truth is sealed."""
    monkeypatch.setattr("airzoo_bench.cli.leaderboard.Limits", lambda _: None)
    _complete(data / "made")
    command("seal-folder", data / "made", "--force")
    made = Board(tmp_path / "world", command)
    made.run("leaderboard", "init", made.main, "--repository", "lab/board")
    identity = load_pyrage().x25519.Identity.generate()
    monkeypatch.setenv(KEY_VARIABLE, str(identity))
    to = str(identity.to_public())
    public = tmp_path / "public"
    archive = public / "made.age"
    made.run("seal", data / "made", "--out", public / "made", "--archive", archive, "--to", to)
    archive.replace(made.main / "made.age")
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(public))
    monkeypatch.setattr(socket, "if_nameindex", lambda: [(1, "lo")])
    (made.main / "leaderboard.toml").write_text(
        BOARD.replace("[[benchmarks]]", f"{LIMITS}[[benchmarks]]") + 'sealed = "made.age"\n'
    )
    made.push_main("A sealed board")
    return made


def _complete(folder: Path) -> None:
    """Give a made benchmark its map and photos, which a sealed one must have."""
    write_raster(folder / "dom.tif", np.full((3, 64, 64), 90, np.uint8))
    (folder / "images").mkdir()
    for number in range(6):
        Image.new("RGB", (32, 24), (number, 90, 30)).save(folder / f"images/q{number:05d}.jpg")


def scored(board: Board, number: int, head: str, account: int = ADA) -> Path:
    """Play the job that checks, and return the folder of its files."""
    board.runs += 1
    work = board.home / f"run{board.runs}"
    work.mkdir()
    done = board.run(
        "leaderboard", "score", "--event",
        write_event(work / "event.json", event(number, head, account)),
        "--remote", board.hosted.folder, "--out", work / "found-score.json",
        "--work", work / "work", "--root", board.main,
    )  # fmt: skip
    assert done.stdout == "sealed\n"
    return work


def opened(board: Board, work: Path, *more: object, code: int = 0) -> Result:
    return board.run(
        "leaderboard", "score", "--sealed", work / "found-score.json", "--work",
        work / "work", "--root", board.main, "--out", work / "found-sealed.json", *more, code=code,
    )  # fmt: skip


def test_sealed_submission_from_pull_request_to_board(
    board: Board, perfect: dict[str, list[Any]]
) -> None:
    fork = board.clone("ada")
    submit(board, fork, perfect, "Salad")
    head = board.propose(fork, 1)
    work = scored(board, 1, head)
    board.keep(work / "found-score.json", "--started", "--out", work / "try.json")
    opened(board, work)
    artifacts = [work / name for name in ("found-score.json", "try.json", "found-sealed.json")]
    board.keep(artifacts[2])
    board.run("leaderboard", "comment", *artifacts, "--out", work / "comment.md")
    comment = (work / "comment.md").read_text()
    assert "Rounded to half a standard error" in comment
    assert "| `average` | 10 |" in comment
    found = json.loads((work / "found-sealed.json").read_text())
    assert "records_sha256" not in json.dumps(found)

    # One try within 30 days: the next commit has none, and its truth is not opened.
    submit(board, fork, perfect, "Salad", "--force", "--set", "summary=Other words.")
    work = scored(board, 1, board.propose(fork, 1))
    refused = board.home / "refused.json"
    done = board.keep(work / "found-score.json", "--started", "--out", refused, code=1)
    assert "this account has had 1 try on made within 30 days" in done.stderr
    board.run("leaderboard", "comment", refused, "--out", work / "comment.md")
    assert "this account has had 1 try" in (work / "comment.md").read_text()

    # What was pushed after the scoring is not what is merged: the board says so.
    newest = git(fork, "rev-parse", "HEAD")
    board.merge(1, newest)
    board.rescore(code=1, said="were not scored against the sealed truth before they were merged")
    git(board.main, "revert", "--no-edit", "HEAD")
    git(board.main, "push", "--quiet", "origin", "HEAD:main")

    # The commit that was scored gets its answer on the board, without the key.
    git(fork, "push", "--quiet", "--force", "origin", f"{head}:refs/pull/1/head")
    board.merge(1, head)
    run = board.rescore() / "runs/made/retrieval/salad/1"
    answer = json.loads((run / "answer.json").read_text())
    assert sorted(path.name for path in run.iterdir()) == [
        "answer.json",
        "run.json",
        "submission.toml",
    ]

    # An answer from before the truth was sealed anew would make that one's table the newest.
    public = Path(os.environ["AIRZOO_BENCH_DATA"]) / "made" / "benchmark.toml"
    old = answer["truth_commitment"]
    public.write_text(public.read_text().replace(old, "0" * 64))
    board.rescore(code=1, said="scored against an earlier truth")

    # One that is on the board stays where it is, and the log says how it comes to the new truth.
    board.keep(run.parents[4])
    data = board.rescore(said="not scored again")
    assert [path.name for path in data.glob("runs/made/retrieval/salad/*")] == ["1"]


def test_failed_job_gives_the_try_back(board: Board, perfect: dict[str, list[Any]]) -> None:
    fork = board.clone("ada")
    submit(board, fork, perfect, "Salad")
    work = scored(board, 1, board.propose(fork, 1))
    found = work / "found-score.json"
    for started in (["--started"], [], ["--started"], []):
        board.keep(found, *started)
    board.run("leaderboard", "comment", found, "--out", work / "comment.md")
    assert "This does not count as a try" in (work / "comment.md").read_text()


def test_what_only_the_truth_shows_is_a_try(
    board: Board, perfect: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Were it given back, whoever finds such a fault could ask the truth without end."""

    def fail(*_: Any, **__: Any) -> None:
        raise PredictionError("45.1 degrees off the truth")

    fork = board.clone("ada")
    submit(board, fork, perfect, "Salad")
    work = scored(board, 1, board.propose(fork, 1))
    board.keep(work / "found-score.json", "--started")
    with monkeypatch.context() as broken:
        broken.setattr(scoring, "evaluate", fail)
        opened(board, work, code=1)
    board.keep(work / "found-sealed.json", code=1)
    assert ",scored," in board.data_file("tries.csv").splitlines()[-1]
    board.run("leaderboard", "comment", work / "found-sealed.json", "--out", work / "comment.md")
    comment = (work / "comment.md").read_text()
    assert "The truth was opened" in comment
    assert "45.1" not in comment


def test_class_of_a_sealed_method_is_held_to_its_predictions(
    board: Board, perfect: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluate = scoring.evaluate

    def near(*arguments: Any, **options: Any) -> Any:
        found = evaluate(*arguments, **options)
        counts = {scene: one | {"near_prior": 1} for scene, one in found.result.counts.items()}
        return replace(found, result=found.result.model_copy(update={"counts": counts}))

    fork = board.clone("ada")
    submit(board, fork, perfect, "Salad")
    work = scored(board, 1, board.propose(fork, 1))
    monkeypatch.setattr(scoring, "evaluate", near)
    opened(board, work, code=1)
    found = json.loads((work / "found-sealed.json").read_text())
    assert (found["kind"], found["answer"]) == ("refused", None)
    assert "the photo's own prior" in found["problems"][0]


def test_files_that_changed_between_the_jobs_are_not_scored(
    board: Board, perfect: dict[str, list[Any]]
) -> None:
    fork = board.clone("ada")
    submit(board, fork, perfect, "Salad")
    work = scored(board, 1, board.propose(fork, 1))
    [path] = (work / "work").rglob("*.npz")
    path.write_bytes(path.read_bytes() + b"x")
    done = opened(board, work, code=1)
    assert "predictions.bytes" in str(done.exception)
    assert not (work / "found-sealed.json").exists()


def test_truth_is_not_opened_where_there_is_a_network(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socket, "if_nameindex", lambda: [(1, "lo"), (2, "eth0")])
    found = {"schema": 2, "kind": "sealed", "pull_request": 1, "account": 1, "head": "a" * 40}
    (board.home / "found-score.json").write_text(json.dumps(found))
    done = opened(board, board.home, code=1)
    assert "not opened while there is a network (eth0)" in str(done.exception)
