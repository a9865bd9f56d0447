"""A sealed truth: what is public, how coarse the answer is, keys and archives, and CI's steps."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
import socket
import tarfile
from contextlib import nullcontext, suppress
from fnmatch import fnmatchcase
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import POSE_COLUMNS
from airzoo_bench.core.errors import BenchmarkError, PredictionError, UsageError, UserError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard import checks, sealing
from airzoo_bench.leaderboard.board import Limits
from airzoo_bench.leaderboard.checks import CheckedSubmission
from airzoo_bench.leaderboard.git import DataBranch, RefusedError, Try, check_tries
from airzoo_bench.leaderboard.sealing import opened_truth, round_score, score_sealed, seal
from tests.api.place import NAME
from tests.leaderboard import conftest as world
from tests.leaderboard.conftest import SCENE, Board, Hosted
from tests.statistics.support import ERROR, HIT
from tests.support import run_main, write_raster

SALT = "5a" * 32
NEW_KEY = sealing.load_pyrage().x25519.Identity.generate
KEY = NEW_KEY()


@pytest.fixture(scope="module")
def public(host: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the public folder of the host's; the archive of its truth lies beside it."""
    found = tmp_path_factory.mktemp("sealed") / NAME
    with mock.patch("secrets.token_hex", return_value=SALT):
        assert run_main("seal", host, "--out", found, "--to", KEY.to_public()) == 0
    return found


# Where each file is: in public as it was ("same") or cut, or only in the archive. A file that is
# not in the table fails: another track's files are sealed until somebody thinks about them.
CUT = "benchmark.toml scenes/*/queries.csv scenes/*/retrieval/tiles.parquet "
CUT += "scenes/*/reconstruction/photos.csv data/*/images/a.png"  # which has metadata
SAME = "protocols/*.toml data/*/images/*.png data/*/d[os]m.tif scenes/*/retrieval/tiles/* "
SAME += "scenes/*/retrieval/dropped_tiles.csv scenes/*/matching/crops.csv "
SAME += "scenes/*/matching/map.json scenes/*/matching/crops/*"
SEALED = "prepared.json scenes/*/retrieval/positives.npz scenes/*/retrieval/overlaps.npz "
SEALED += "scenes/*/retrieval/footprints.csv scenes/*/*/excluded.csv data/*/cloud.ply"
WHERE = {"cut": CUT.split(), "same": SAME.split(), "sealed": SEALED.split()}


def test_no_public_file_tells_the_truth(host: Path, public: Path) -> None:
    prepared, shown, hidden = world.files_of(host), world.files_of(public), []
    for name, content in prepared.items():
        there = "same" if shown.get(name) == content else "cut" if name in shown else "sealed"
        fitting = (w for w, names in WHERE.items() if any(fnmatchcase(name, one) for one in names))
        assert there == next(fitting), name
        hidden += [] if there == "same" else [hashlib.sha256(content).hexdigest()]
    assert shown.keys() <= prepared.keys()
    before, after = (pd.read_csv(of / SCENE / "queries.csv", dtype=str) for of in (host, public))
    assert not {*POSE_COLUMNS, "altitude_m", "pitch_deg"} & set(after.columns)
    assert after.equals(before[list(after.columns)])  # digits as they were
    hidden += [text for name in ("x", "y", "z", "qw") for text in before[name] if len(text) > 5]
    hidden += [world.TRUE_PLACE, SALT, "seen_share"]
    assert len(hidden) > 30
    for name, content in world.files_of(public.parent).items():
        assert not [secret for secret in hidden if secret.encode() in content], name
    text = (public / "benchmark.toml").read_text()
    assert "cloud" not in text.split("[checksums]")[0].split("[[scenes]]")[1]


def test_known_truth_and_data_outside_are_not_sealed(host: Path, tmp_path: Path) -> None:
    queries, toml, images = f"{SCENE}/queries.csv", "benchmark.toml", f"data/{NAME}/images"
    table = pd.read_csv(host / queries)
    for name in POSE_COLUMNS:
        table[f"prior_{name}"] = table[f"prior_{name}"].where(table.index != 2, table[name])
    outside = (host / toml).read_text().replace(images, "../x")
    faults = {"pose: 1, and": (queries, table.to_csv(index=False)), "outside": (toml, outside)}
    for said, (name, text) in faults.items():
        folder = Path(shutil.copytree(host, tmp_path / said[:4] / NAME))
        (folder / name).write_text(text)
        world.write_sums(folder)
        with pytest.raises(BenchmarkError, match=said):
            seal(folder, tmp_path / "public", KEY.to_public())


def opened(public: Path, key: Any = KEY, archive: Path | None = None) -> Any:
    return opened_truth(public, archive or public.with_suffix(".age"), key)


def test_opened_is_what_was_sealed_and_goes(host: Path, public: Path) -> None:
    whole = world.files_of(host)
    for error in (UserError("x"), KeyboardInterrupt(), SystemExit(143)):
        with suppress(type(error)), opened(public) as truth:
            assert truth.stat().st_mode & 0o077 == 0
            Benchmark.open(truth)
            found = world.files_of(truth)
            raise error
        assert not truth.exists()
    assert whole.keys() == found.keys()
    other = {name for name in whole if found[name] != whole[name]}
    assert other == {f"data/{NAME}/images/a.png"}  # it had metadata


def test_other_archives_open_nothing(public: Path, tmp_path: Path) -> None:
    path, plain, content = tmp_path / "x.age", BytesIO(), public.with_suffix(".age").read_bytes()
    with tarfile.open(fileobj=plain, mode="w") as tar:  # anybody has the public key
        tar.addfile(tarfile.TarInfo("../../x"))
    forged = sealing.load_pyrage().encrypt(plain.getvalue(), [KEY.to_public()])
    cases = [(content[:at] + b"?" + content[at + 1 :], KEY) for at in (3, 40_000)]
    for data, key in [*cases, (content[:-1], KEY), (content, NEW_KEY()), (forged, KEY)]:
        path.write_bytes(data)
        with pytest.raises(BenchmarkError, match="is damaged, or not of this"):
            opened(public, key, path).__enter__()


def test_no_key_is_told_and_no_file_replaced(host: Path, public: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv(sealing.KEY_VARIABLE, f"# a comment\n{KEY}\n")
    assert str(sealing.read_key()) == str(KEY)
    for text in ("", f"{KEY}\n{KEY}\n", f"{KEY}!"):
        monkeypatch.setenv(sealing.KEY_VARIABLE, text)
        for read in (sealing.read_key, lambda: sealing.recipient(str(KEY))):
            with pytest.raises(UsageError) as caught:
                read()
            assert str(KEY)[20:40] not in str(caught.value)
    (archive := public.with_name("m.age")).touch()
    for out in (public, archive.with_suffix("")):
        assert run_main("seal", host, "--out", out, "--to", KEY.to_public()) == 2
    assert not archive.read_bytes()


COLUMNS = {"share": HIT, "median": ERROR, "mean": ERROR.model_copy(update={"average": "mean"})}


@pytest.mark.parametrize("track", ["retrieval", "matching", "reconstruction"])
def test_only_rounded_scores_are_told(track: str, host: Path, public: Path, tmp_path: Path) -> None:
    path = world.write_template(track, public, tmp_path)
    checked = CheckedSubmission(path.parent, world.submission(protocol=f"{NAME}-{track}"), path)
    archive = public.with_suffix(".age")
    answer = score_sealed(checked, "7" * 64, archive, KEY, public.parent, Run())
    whole = evaluate(path, data=host, method="M")
    shown = [column for column in whole.result.columns if column.headline]
    assert set(answer.row.scores) == {column.key for column in shown}
    for column in shown:
        parts = [part[column.key].to_numpy(float) for _, part in whole.records.groupby("scene")]
        true, told = whole.result.overall[column.key], answer.row.scores[column.key].value
        step = round_score(true, parts, column, whole.result.unit)[2]
        assert told is not None
        assert told == true or abs(told - true) <= step / 2 + 1e-12 or told == 1
    text = answer.model_dump_json()
    assert not [secret for secret in (whole.result.truth.fingerprint, SALT) if secret in text]
    assert not {*answer.row.notes, *answer.row.scenes, *answer.row.conditions, *answer.floors}


@pytest.mark.parametrize(("kind", "count"), [*product(COLUMNS, (20, 60, 300))])
def test_errors_are_right_and_one_query_changes_little(kind: str, count: int) -> None:
    column, random = COLUMNS[kind], np.random.default_rng(1)
    draws = random.random((1000, 2, count))
    values = (draws < 0.4).astype(float) if column is HIT else -np.log1p(-draws)
    means = np.median if column is ERROR else np.mean
    found = [round_score(float(means(v, axis=1).mean()), [*v], column) for v in values]
    stated = np.array([error for _, error, _ in found], float)
    # Order statistics of few queries are careful, and digits are rounded upward.
    assert 0.9 < np.sqrt(np.mean(stated**2)) / np.std(means(values, axis=2).mean(axis=1)) < 2
    values[:, 0, 0] = 1 - values[:, 0, 0] if column is HIT else random.exponential(1.0, 1000)
    others = [round_score(float(means(v, axis=1).mean()), [*v], column) for v in values]
    assert sum(one == other for one, other in zip(found, others, strict=True)) > 700


def test_a_scene_of_one_query_cannot_be_read_off_the_mean() -> None:
    others = [(np.random.default_rng(n).random(200) < 0.5).astype(float) for n in range(10)]
    both = [[*others, np.array([hit])] for hit in (0.0, 1.0)]
    assert len({round_score(float(np.mean([*map(np.mean, s)])), s, HIT)[0] for s in both}) == 1


def test_steps_by_hand() -> None:
    """Two scenes of 60: an error of up to 0.0645 each, 0.0456 of both, upward 0.05; half is 0.025.

    But 4 queries of a scene move the mean by 4 / 60 / 2 = 0.0333, upward 0.034: 15 such steps are
    0.51. The rate with 4 more queries in a scene is (0.51 x 60 + 2) / 64 = 0.509; its error is
    (0.509 x 0.491 / 60) ** 0.5 = 0.0645, of both 0.0456: 0.05.
    """
    half = np.repeat((0.0, 1.0), 30)
    assert round_score(0.5, [half, half], HIT) == (0.51, 0.05, 0.034)
    assert round_score(0.5, [np.repeat((0.0, 1.0), 5000)], HIT) == (0.5, 0.005, 0.0025)
    for value in (0.0, 1.0):
        assert round_score(value, [np.full(100, value)], HIT)[:2] == (value, 0.02)
    values = np.array([1.0, 2.0, 3.0, *[math.inf] * 5])
    assert round_score(math.inf, [values], ERROR) == (math.inf, None, 0.0)
    some = np.array([*range(1, 12), *[math.inf] * 9], float)
    value, error, step = round_score(float(np.median(some)), [some], ERROR)
    assert math.isfinite(value)
    assert (error, step > 0) == (None, True)


def line(text: str, account: int = 7) -> Try:
    """Return a try from its commit, its day and its outcome."""
    head, day, outcome = text
    said = {"s": "started", "d": "scored", "f": "failed"}[outcome]
    return Try(str(account), "made", head, said, f"2026-11-0{day}T00:00:00Z")


# Earlier tries of one account, and whether it has none left: one commit is one try, a job that
# failed is none, and c5s itself was begun before as c2s, as a fourth job.
TRIES = {"a1s": False, "a1s b2s": True, "a1s a2s a2d": False, "a1s b2s b3f": False}
TRIES |= {"a1s b2s c2s": True}


def test_a_try_beyond_the_limit_is_refused(tmp_path: Path) -> None:
    limits, later = Limits(tries=2, days=30), line("d1s")._replace(time="2026-12-01T00:00:01Z")
    for text, is_refused in TRIES.items():
        tries = [*map(line, text.split())]
        with pytest.raises(RefusedError, match="2 tries") if is_refused else nullcontext():
            check_tries(tries, line("c5s"), limits)
        check_tries(tries[:2], later, limits)
    # Two jobs at once cannot both have the last try; another account is not concerned.
    hosted = Hosted(tmp_path / "hosted.git", {".keep": b""})
    first, second = (DataBranch(tmp_path / name, str(hosted.folder)) for name in "ab")
    limits = Limits(tries=1, days=30)
    first.add_try(line("a1s"), limits)
    with pytest.raises(RefusedError, match="has had 1 try"):
        second.add_try(line("b1s"), limits)
    second.add_try(line("b1s", account=8), limits)
    assert [one.head for one in DataBranch(tmp_path / "c", str(hosted.folder)).tries()] == [*"ab"]


@pytest.fixture
def sealed(board: Board, data: Path, monkeypatch: Any) -> Board:
    """Return a board of the made benchmark whose truth is sealed; an account has two tries."""
    public = board.home / "public"
    write_raster(data / "made/dom.tif", np.full((3, 64, 64), 90, np.uint8))
    archive, _ = seal(data / "made", public / "made", KEY.to_public())
    archive.replace(board.main / "made.age")
    limits = world.BOARD.replace("[[", "[limits]\ntries = 2\ndays = 30\n[[", 1)
    (board.main / "leaderboard.toml").write_text(f'{limits}sealed = "made.age"\n')
    board.push(board.main)
    monkeypatch.setenv(sealing.KEY_VARIABLE, str(KEY))
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(public))
    monkeypatch.setattr(socket, "if_nameindex", lambda: [(1, "lo")])
    return board


def start(board: Board, found: Path, code: int = 0) -> Path:
    """Take a try, and return the findings."""
    out = found.with_name("found-try.json")
    board.step("keep", found, "--started", "--out", out, code=code)
    return out


def open_sealed(board: Board, found: Path, code: int = 0, said: str = "") -> Path:
    """Score against the truth, and return the findings."""
    out = found.with_name("found-sealed.json")
    call = ("leaderboard", "score", "--sealed", found, "--out", out, "--root", board.main)
    done = world.run(*call, "--work", found.with_name("work"), code=code)
    assert said in str(done.exception)
    return out


def test_a_sealed_truth_from_request_to_board(
    sealed: Board, perfect: Any, monkeypatch: Any
) -> None:
    board, fork = sealed, sealed.clone("ada")
    world.write_submission(fork, perfect)
    found = board.score(1, first := board.push(fork, "pull/1/head"))
    for _ in range(2):  # a job that fails gives the try back
        start(board, found)
        board.step("keep", found)
    assert "This does not count as a try" in board.comment(found)
    tried = start(board, found)
    board.step("keep", opened := open_sealed(board, found))
    assert "| `average` | 10 |" in board.comment(found, tried, opened)
    assert "records_sha256" not in opened.read_text()

    # A fault that only the truth shows is a try, or whoever finds one could ask without end.
    world.write_submission(fork, perfect, summary="Other.")
    start(board, found := board.score(1, last := board.push(fork, "pull/1/head")))
    fault = mock.Mock(side_effect=PredictionError("45.1 degrees off the truth"))
    with mock.patch.object(checks, "evaluate", fault):
        board.step("keep", opened := open_sealed(board, found, code=1), code=1)
    assert "The truth was opened" in (comment := board.comment(opened))
    assert "45.1" not in comment
    assert ",scored," in board.data_file("tries.csv").splitlines()[-1]

    # Two tries within 30 days: the next commit has none. Changed files and a network keep the
    # truth closed.
    world.write_submission(fork, perfect, summary="One more.")
    found = board.score(1, board.push(fork, "pull/1/head"))
    comment = board.comment(start(board, found, code=1))
    assert "has had 2 tries on made within 30 days" in comment
    [toml] = found.with_name("work").rglob("submission.toml")
    toml.write_text(toml.read_text().replace("CC-BY-4.0", "MIT"))
    with monkeypatch.context() as patched:
        patched.setattr("airzoo_bench.leaderboard.scoring.score_sealed", None)
        opened = open_sealed(board, found, code=1, said="not the files")
        patched.setattr(socket, "if_nameindex", lambda: [(1, "lo"), (2, "eth0")])
        open_sealed(board, found, code=1, said="while there is a network (eth0)")
    assert not opened.exists()

    # What was pushed after the scoring is not what is merged: the board says so.
    unscored = "were not scored against the sealed truth"
    board.merge(1, last)
    board.rescore(code=1, said=unscored)
    world.git(board.main, "revert", "--no-edit", "HEAD")

    # The commit that was scored gets its answer on the board, without the key.
    board.merge(1, board.hosted.move("pull/1/head", first))
    run = board.rescore() / "runs/made/retrieval/salad/1"
    assert sorted(path.name for path in run.iterdir()) == ["run.json", "submission.toml"]

    # It does not count where the truth is sealed anew.
    stated = board.home / "public/made/benchmark.toml"
    truth = json.loads((run / "run.json").read_text())["head"]["truth"]
    stated.write_text(stated.read_text().replace(truth, "0" * 64))
    board.rescore(code=1, said=unscored)
