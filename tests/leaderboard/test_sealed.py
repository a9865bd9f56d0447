"""A sealed truth, from `seal` to the board; what it refuses is in tests/goldens/refusals.txt."""

from __future__ import annotations

import re
import socket
from contextlib import suppress
from fnmatch import fnmatchcase
from hashlib import sha256
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import BenchmarkError, PredictionError, UsageError
from airzoo_bench.leaderboard import checks, sealing
from airzoo_bench.leaderboard.git import DataBranch, Limits, RefusedError, Try, check_tries
from airzoo_bench.leaderboard.sealing import opened_truth, round_score
from tests.api.place import NAME
from tests.leaderboard import conftest as world
from tests.leaderboard.conftest import SCENE, Board, Hosted
from tests.statistics.support import CHAMFER, ERROR, HIT
from tests.support import run_main, write_raster

SALT = "5a" * 32
KEY, OTHER_KEY = (sealing.load_pyrage().x25519.Identity.generate() for _ in range(2))


@pytest.fixture(scope="module")
def public(host: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the public folder of the host's; the archive of its truth lies beside it."""
    found = tmp_path_factory.mktemp("sealed") / NAME
    with mock.patch("secrets.token_hex", return_value=SALT):
        assert run_main("seal", host, "--out", found, "--to", KEY.to_public()) == 0
    return found


# Everything else is sealed, until somebody thinks about another track's files.
CUT = {"benchmark.toml", f"{SCENE}/queries.csv", f"{SCENE}/retrieval/tiles.parquet"}
CUT |= {f"{SCENE}/reconstruction/photos.csv", f"data/{NAME}/images/a.png"}  # with metadata
AS_IT_WAS = """protocols/*.toml data/*/images/*.png data/*/d[os]m.tif scenes/*/retrieval/tiles/*
scenes/*/retrieval/dropped_tiles.csv scenes/*/matching/crops.csv scenes/*/matching/map.json
scenes/*/matching/crops/*"""


def test_no_public_file_tells_the_truth(host: Path, public: Path) -> None:
    whole, shown = world.files_of(host), world.files_of(public)
    same = {name for name in whole if any(fnmatchcase(name, one) for one in AS_IT_WAS.split())}
    assert shown.keys() == same | CUT
    assert {name for name in shown if shown[name] != whole[name]} == CUT
    before, after = (pd.read_csv(of / SCENE / "queries.csv", dtype=str) for of in (host, public))
    assert not {"x", "y", "z", "qw", "altitude_m", "pitch_deg"} & set(after.columns)
    assert after.equals(before[list(after.columns)])  # digits as they were
    hidden = [sha256(whole[name]).hexdigest() for name in {*whole} - same | CUT]
    hidden += [text for name in ("x", "y", "z", "qw") for text in before[name] if len(text) > 5]
    assert len(hidden) > 30
    for name, content in world.files_of(public.parent).items():
        told = [*hidden, SALT, "seen_share", "cloud = ", world.TRUE_PLACE]
        assert not [text for text in told if text.encode() in content], name


def test_only_what_was_sealed_is_opened(host: Path, public: Path, tmp_path: Path) -> None:
    whole, archive, path = world.files_of(host), public.with_suffix(".age"), tmp_path / "x.age"
    with suppress(KeyboardInterrupt), opened_truth(public, archive, KEY) as truth:
        assert truth.stat().st_mode & 0o077 == 0
        found = world.files_of(truth)
        raise KeyboardInterrupt
    assert not truth.exists()
    assert whole.keys() == found.keys()
    assert {n for n in whole if found[n] != whole[n]} == {f"data/{NAME}/images/a.png"}  # metadata
    forged = sealing.load_pyrage().encrypt(b"tar", [KEY.to_public()])  # as anybody can
    content = archive.read_bytes()
    damaged = [content.replace(content[at : at + 9], bytes(9)) for at in (3, 40_000)]
    for data in (*damaged, content[:-1], content, forged):
        path.write_bytes(data)
        with pytest.raises(BenchmarkError, match="is damaged, or not of this"):
            opened_truth(public, path, OTHER_KEY if data is content else KEY).__enter__()


def test_no_key_is_told(monkeypatch: Any) -> None:
    monkeypatch.setenv(sealing.KEY_VARIABLE, f"# a comment\n{KEY}\n")
    assert str(sealing.read_key()) == str(KEY)
    for text in ("", f"{KEY}\n{KEY}\n", f"{KEY}!"):
        monkeypatch.setenv(sealing.KEY_VARIABLE, text)
        for read in (sealing.read_key, lambda: sealing.recipient(str(KEY))):
            with pytest.raises(UsageError) as caught:
                read()
            assert str(KEY)[20:40] not in str(caught.value)


@pytest.mark.parametrize("track", ["retrieval", "matching", "reconstruction"])
def test_only_rounded_scores_are_told(track: str, host: Path, public: Path, tmp_path: Path) -> None:
    path, archive = world.write_template(track, public, tmp_path), public.with_suffix(".age")
    stated = world.submission(protocol=f"{NAME}-{track}")
    checked = checks.CheckedSubmission(path.parent, stated, path)
    answer = sealing.score_sealed(checked, "7" * 64, archive, KEY, public.parent, checks.Run())
    whole = checks.evaluate(path, data=host, method="M")
    scenes, told = [part for _, part in whole.records.groupby("scene")], {}
    for key, column in ((one.key, one) for one in whole.result.columns if one.headline):
        parts = [scene[key].to_numpy() for scene in scenes]
        told[key] = round_score(whole.result.overall[key], parts, column, whole.result.unit)[:2]
    assert told == {key: (s.value, s.standard_error) for key, s in answer.row.scores.items()}
    assert whole.result.truth.fingerprint not in answer.model_dump_json()
    assert not {*answer.row.notes, *answer.row.scenes, *answer.row.conditions, *answer.floors}


@pytest.mark.parametrize("count", [20, 300])
@pytest.mark.parametrize("column", [HIT, ERROR, CHAMFER], ids=["share", "median", "mean"])
def test_errors_are_right_and_one_query_changes_little(column: Any, count: int) -> None:
    random, average = np.random.default_rng(1), np.median if column is ERROR else np.mean
    draws = random.random((1000, 2, count))
    values = (draws < 0.4).astype(float) if column is HIT else -np.log1p(-draws)
    means = average(values, axis=2).mean(axis=1)
    found = [round_score(float(x), [*v], column) for x, v in zip(means, values, strict=True)]
    stated = np.array([error for _, error, _ in found], float)
    # Order statistics of few queries are careful, and digits are rounded upward.
    assert 0.9 < np.sqrt(np.mean(stated**2)) / np.std(means) < 2
    values[:, 0, 0] = 1 - values[:, 0, 0] if column is HIT else random.exponential(1.0, 1000)
    means = average(values, axis=2).mean(axis=1)
    other = [round_score(float(x), [*v], column) for x, v in zip(means, values, strict=True)]
    assert sum(map(tuple.__eq__, found, other)) > 700


def test_steps_by_hand() -> None:
    """Two scenes of 60 have errors of up to 0.0645, 0.0456 together: upward 0.05, half is 0.025.

    But 4 queries move the mean by 4 / 60 / 2, upward 0.034: 15 such steps are 0.51. The error of
    the rate (0.51 x 60 + 2) / 64 is (0.509 x 0.491 / 60) ** 0.5 = 0.0645 again. Of 11 errors and 9
    failures the interval of the median, 10.5, begins at the sixth: 4.5 / 1.96 is upward 5.
    """
    half = np.repeat((0.0, 1.0), 30)
    assert round_score(0.5, [half, half], HIT) == (0.51, 0.05, 0.034)
    assert round_score(0.5, [np.repeat((0.0, 1.0), 5000)], HIT) == (0.5, 0.005, 0.0025)
    for value in (0.0, 1.0):
        assert round_score(value, [np.full(100, value)], HIT)[:2] == (value, 0.02)
        one = np.array([value])  # a scene of one query cannot be read off the mean
        assert round_score((0.5 + value) / 2, [half, one], HIT)[::2] == (0.0, 2.0)
    errors = np.array([*range(1, 12), *[np.inf] * 9])
    assert round_score(10.5, [errors], ERROR) == (10.0, None, 2.5)
    assert round_score(np.inf, [errors[5:]], ERROR) == (np.inf, None, 0.0)
    scenes = [np.array([1210.0]), np.array([1260.0])]  # with one record each
    assert round_score(0.126, scenes[:1], HIT, "scene") == (0.13, None, 0.01)
    assert round_score(1235.0, scenes, CHAMFER, "scene") == (1200.0, 30.0, 100.0)


def test_a_try_beyond_the_limit_is_refused(tmp_path: Path) -> None:
    """One commit is one try, also if it was begun before; a job that failed is none."""
    a = Try("7", "made", "a", "started", "2026-11-01T00:00:00Z")
    b, c = a._replace(head="b", time="2026-11-02T00:00:00Z"), a._replace(head="c")
    limits = Limits(tries=2, days=30)
    for tries in ([a], [a, a, a._replace(outcome="scored")], [a, b, b._replace(outcome="failed")]):
        check_tries(tries, c, limits)
    for tries in ([a, b], [a, b, c]):
        with pytest.raises(RefusedError, match="2 tries"):
            check_tries(tries, c, limits)
    check_tries([a, b], c._replace(time="2026-12-01T00:00:01Z"), limits)
    # Two jobs at once cannot both have the last try; another account is not concerned.
    hosted = Hosted(tmp_path / "hosted.git", {".keep": b""})
    first, second = (DataBranch(tmp_path / name, str(hosted.folder)) for name in "ab")
    first.add_try(a, limits := Limits(tries=1, days=30))
    with pytest.raises(RefusedError, match="has had 1 try"):
        second.add_try(b, limits)
    second.add_try(b._replace(account="8"), limits)
    assert [one.head for one in DataBranch(tmp_path / "c", str(hosted.folder)).tries()] == [*"ab"]


def do(board: Board, job: str, found: Path, code: int = 0, said: str = "") -> Path:
    """Take a try, or score against the truth, and return the findings."""
    out, work = found.with_name(f"found-{job}.json"), found.with_name("work")
    jobs = {"try": ("keep", "--started"), "sealed": ("score", "--work", work, "--sealed")}
    assert said in str(board.step(*jobs[job], found, "--out", out, code=code).exception)
    return out


def test_from_request_to_board(board: Board, data: Path, perfect: Any, monkeypatch: Any) -> None:
    write_raster(data / "made/dom.tif", np.full((3, 64, 64), 90, np.uint8))
    archive, _ = sealing.seal(data / "made", board.home / "public/made", KEY.to_public())
    archive.replace(board.main / "made.age")
    limits = world.BOARD.replace("[[", "[limits]\ntries = 2\ndays = 30\n[[", 1)
    (board.main / "leaderboard.toml").write_text(f'{limits}sealed = "made.age"\n')
    board.push(board.main)
    monkeypatch.setenv(sealing.KEY_VARIABLE, str(KEY))
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(board.home / "public"))
    monkeypatch.setattr(socket, "if_nameindex", lambda: [(1, "lo")])
    fork = board.clone("ada")
    world.write_submission(fork, perfect)
    found = board.score(1, board.push(fork, "pull/1/head"))
    for _ in range(2):  # a job that fails gives the try back
        do(board, "try", found)
        board.step("keep", found)
    assert "This does not count as a try" in board.comment(found)
    tried = do(board, "try", found)
    (found.with_name("work") / checks.FETCHED / "of-an-address").mkdir(parents=True)
    board.step("keep", opened := do(board, "sealed", found))
    assert (board.home / "public" / checks.FETCHED / "of-an-address").is_dir()
    assert "| `average` | 10 |" in board.comment(found, tried, opened)

    # A fault that only the truth shows is a try, or whoever finds one could ask without end.
    world.write_submission(fork, perfect, summary="Other.")
    do(board, "try", found := board.score(1, last := board.push(fork, "pull/1/head")))
    with mock.patch.object(checks, "evaluate", side_effect=PredictionError("45.1 degrees off")):
        board.step("keep", opened := do(board, "sealed", found, code=1), code=1)
    assert "The truth was opened" in (comment := board.comment(opened))
    assert "45.1" not in comment

    # The next commit has no try. Changed files and a network keep the truth closed.
    world.write_submission(fork, perfect, summary="One more.")
    found = board.score(1, board.push(fork, "pull/1/head"))
    assert "has had 2 tries on made within 30 days" in board.comment(do(board, "try", found, 1))
    [toml] = found.with_name("work").rglob("submission.toml")
    toml.write_text(toml.read_text().replace("CC-BY-4.0", "MIT"))
    with monkeypatch.context() as patched:
        patched.setattr("airzoo_bench.leaderboard.scoring.score_sealed", None)
        opened = do(board, "sealed", found, code=1, said="not the files")
        patched.setattr(socket, "if_nameindex", lambda: [(1, "lo"), (2, "eth0")])
        do(board, "sealed", found, code=1, said="while there is a network (eth0)")
    assert not opened.exists()

    # What was pushed after the scoring is not what is merged: the board says so.
    unscored = "were not scored against the sealed truth"
    board.merge(1, last)
    board.rescore(code=1, said=unscored)

    # The files that were scored get their answer, without the key, until the truth is sealed anew.
    world.write_submission(board.main, perfect)
    board.push(board.main)
    run = board.rescore() / f"{world.RUNS}/salad/1"
    assert sorted(path.name for path in run.iterdir()) == ["run.json", "submission.toml"]
    stated = board.home / "public/made/benchmark.toml"
    stated.write_text(re.sub('(?<=commitment = ")[0-9a-f]{8}', "0" * 8, stated.read_text()))
    board.rescore(code=1, said=unscored)
