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
from airzoo_bench.results.result import ScoreColumn
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
        seal(host, found, KEY.to_public())
    return found


def archive_of(public: Path) -> Path:
    return public.with_name(f"{public.name}.age")


# --- the public folder ---

# Where each file is: in public as it was ("same") or cut, or only in the archive. A file that is
# not in the table fails: another track's files are sealed until somebody thinks about them.
CUT = "benchmark.toml scenes/*/queries.csv scenes/*/retrieval/tiles.parquet "
CUT += "scenes/*/reconstruction/photos.csv data/*/images/a.png"  # which has metadata
SAME = "protocols/*.toml data/*/images/*.png data/*/d[os]m.tif scenes/*/retrieval/tiles/* "
SAME += "scenes/*/retrieval/dropped_tiles.csv scenes/*/matching/crops.csv "
SAME += "scenes/*/matching/map.json scenes/*/matching/crops/*"
SEALED = "prepared.json scenes/*/retrieval/positives.npz scenes/*/retrieval/overlaps.npz "
SEALED += "scenes/*/retrieval/footprints.csv scenes/*/*/excluded.csv data/*/cloud.ply"
TABLE = {
    pattern: what
    for what, patterns in {"cut": CUT, "same": SAME, "sealed": SEALED}.items()
    for pattern in patterns.split()
}


def test_every_file_that_prepare_writes_is_public_by_the_table_and_tells_no_truth(
    host: Path, public: Path
) -> None:
    prepared, shown, hidden = world.files_of(host), world.files_of(public), []
    for name, content in prepared.items():
        expected = next(what for pattern, what in TABLE.items() if fnmatchcase(name, pattern))
        there = "same" if shown.get(name) == content else "cut" if name in shown else "sealed"
        assert there == expected, name
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


def test_truth_that_methods_are_given_and_data_outside_are_not_sealed(
    host: Path, public: Path, tmp_path: Path
) -> None:
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


# --- keys and archives ---


def opened(public: Path, key: Any = KEY, archive: Path | None = None) -> dict[str, bytes]:
    with opened_truth(public, archive or archive_of(public), key) as truth:
        assert truth.stat().st_mode & 0o077 == 0
        Benchmark.open(truth)
        return world.files_of(truth)


def test_opened_is_what_was_sealed_and_goes(host: Path, public: Path) -> None:
    whole, found = world.files_of(host), opened(public)
    assert whole.keys() == found.keys()
    other = {name for name in whole if found[name] != whole[name]}
    assert other == {f"data/{NAME}/images/a.png"}  # it had metadata
    for error in (UserError("x"), KeyboardInterrupt(), SystemExit(143)):
        with suppress(type(error)), opened_truth(public, archive_of(public), KEY) as truth:
            raise error
        assert not truth.exists()


def test_other_archives_open_nothing(public: Path, tmp_path: Path) -> None:
    path, content, plain = tmp_path / "x.age", archive_of(public).read_bytes(), BytesIO()
    with tarfile.open(fileobj=plain, mode="w") as tar:  # anybody has the public key
        tar.addfile(tarfile.TarInfo("../../x"))
    forged = sealing.load_pyrage().encrypt(plain.getvalue(), [KEY.to_public()])
    cases = [(content[:at] + b"?" + content[at + 1 :], KEY) for at in (3, 40_000)]
    for data, key in [*cases, (content[:-1], KEY), (content, NEW_KEY()), (forged, KEY)]:
        path.write_bytes(data)
        with pytest.raises(BenchmarkError, match="is damaged, or not of this"):
            opened(public, key, path)


def test_faults_of_keys_repeat_no_key_and_the_command_replaces_nothing(
    host: Path, public: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(sealing.KEY_VARIABLE, f"# a comment\n{KEY}\n")
    assert str(sealing.read_key()) == str(KEY)
    for text in ("", f"{KEY}\n{KEY}\n", f"{KEY}!"):
        monkeypatch.setenv(sealing.KEY_VARIABLE, text)
        for read in (sealing.read_key, lambda: sealing.recipient(str(KEY))):
            with pytest.raises(UsageError) as caught:
                read()
            assert str(KEY)[20:40] not in str(caught.value)
    call = ("seal", host, "--out", tmp_path / "m", "--to", KEY.to_public())
    assert run_main(*call) == 0
    assert opened(tmp_path / "m")
    shutil.rmtree(tmp_path / "m")
    assert run_main(*call) == 2


# --- the answer ---

MEAN = ERROR.model_copy(update={"average": "mean"})
COLUMNS = {"share": HIT, "median": ERROR, "mean": MEAN}


@pytest.mark.parametrize("track", ["retrieval", "matching", "reconstruction"])
def test_only_rounded_overall_scores_are_told(
    track: str, host: Path, public: Path, tmp_path: Path
) -> None:
    path = world.write_template(track, public, tmp_path)
    checked = CheckedSubmission(path.parent, world.submission(protocol=f"{NAME}-{track}"), path)
    answer = score_sealed(checked, "7" * 64, archive_of(public), KEY, public.parent, Run())
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


@pytest.mark.parametrize("kind", COLUMNS)
@pytest.mark.parametrize("count", [20, 300])
def test_errors_are_those_of_repeated_samples(kind: str, count: int) -> None:
    column, draws = COLUMNS[kind], np.random.default_rng(1).random((1000, 2, count))
    values = (draws < 0.4).astype(float) if column is HIT else -np.log1p(-draws)
    means = (np.median if column is ERROR else np.mean)(values, axis=2).mean(axis=1)
    found = [
        round_score(float(mean), [*row], column) for mean, row in zip(means, values, strict=True)
    ]
    stated = np.array([error for _, error, _ in found], float)
    # Order statistics of few queries are careful, and digits are rounded upward.
    assert 0.9 < np.sqrt(np.mean(stated**2)) / np.std(means) < 2


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


@pytest.mark.parametrize("column", [HIT, ERROR], ids=["share", "median"])
def test_one_query_mostly_changes_nothing(column: ScoreColumn) -> None:
    random, same, average = np.random.default_rng(3), 0, np.median if column is ERROR else np.mean
    for _ in range(400):
        rate, values = random.uniform(0.1, 0.9), random.exponential(1.0, 60)
        values = (random.random(60) < rate).astype(float) if column is HIT else values
        other, place = values.copy(), random.integers(60)
        other[place] = 1.0 - other[place] if column is HIT else random.exponential(1.0)
        one, two = (round_score(float(average(v)), [v], column) for v in (values, other))
        same += one == two
    assert same >= 400 * 0.7
    # Nor can a scene of one query be read off the mean.
    others = [(random.random(200) < 0.5).astype(float) for _ in range(10)]
    both = [[*others, np.array([hit])] for hit in (0.0, 1.0)]
    assert len({round_score(float(np.mean([*map(np.mean, s)])), s, HIT)[0] for s in both}) == 1


# --- tries ---


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


# --- the steps of CI ---


@pytest.fixture
def sealed_board(board: Board, data: Path, monkeypatch: pytest.MonkeyPatch) -> Board:
    """Return a board of the made benchmark whose truth is sealed; an account has one try."""
    public = board.home / "public"
    write_raster(data / "made/dom.tif", np.full((3, 64, 64), 90, np.uint8))
    archive, _ = seal(data / "made", public / "made", KEY.to_public())
    archive.replace(board.main / "made.age")
    limits = world.BOARD.replace("[[", "[limits]\ntries = 1\ndays = 30\n[[", 1)
    (board.main / "leaderboard.toml").write_text(f'{limits}sealed = "made.age"\n')
    board.push_main("A sealed board")
    monkeypatch.setenv(sealing.KEY_VARIABLE, str(KEY))
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(public))
    monkeypatch.setattr(socket, "if_nameindex", lambda: [(1, "lo")])
    return board


def propose(board: Board, arrays: Any, *more: str) -> Path:
    """Submit, and play the job that checks it; return the folder of its files."""
    fork = board.home / "ada"
    board.submit(fork if fork.exists() else board.clone("ada"), arrays, "Salad", *more)
    work = board.score(1, board.propose(fork, 1))
    assert json.loads((work / "found-score.json").read_text())["kind"] == "sealed"
    return work


def open_sealed(board: Board, work: Path, code: int = 0) -> str:
    files = ("--work", work / "work", "--out", work / "found-sealed.json")
    call = ("leaderboard", "score", "--sealed", work / "found-score.json", *files)
    return str(world.run(*call, "--root", board.main, code=code).exception)


def test_a_sealed_submission_from_pull_request_to_board(sealed_board: Board, perfect: Any) -> None:
    board, work = sealed_board, propose(sealed_board, perfect)
    head = world.git(fork := board.home / "ada", "rev-parse", "HEAD")
    artifacts = [work / name for name in ("found-score.json", "try.json", "found-sealed.json")]
    board.step("keep", artifacts[0], "--started", "--out", artifacts[1])
    open_sealed(board, work)
    board.step("keep", artifacts[2])
    assert "| `average` | 10 |" in board.comment(*artifacts)
    assert "records_sha256" not in artifacts[2].read_text()

    # One try within 30 days: the next commit has none, and its truth is not opened.
    other, refused = propose(board, perfect, "--force", "--set", "summary=Other."), work / "r.json"
    board.step("keep", other / "found-score.json", "--started", "--out", refused, code=1)
    assert "has had 1 try on made within 30 days" in board.comment(refused)

    # What was pushed after the scoring is not what is merged: the board says so.
    board.merge(1, world.git(fork, "rev-parse", "HEAD"))
    board.rescore(code=1, said="were not scored against the sealed truth before they were merged")
    world.git(board.main, "revert", "--no-edit", "HEAD")
    world.git(board.main, "push", "--quiet", "origin", "HEAD:main")

    # The commit that was scored gets its answer on the board, without the key.
    board.hosted.pull(1, head)
    board.merge(1, head)
    files = board.rescore() / "runs/made/retrieval/salad/1"
    assert sorted(path.name for path in files.iterdir()) == ["run.json", "submission.toml"]

    # It does not count where the truth is sealed anew.
    public = board.home / "public/made/benchmark.toml"
    truth = json.loads((files / "run.json").read_text())["head"]["truth"]
    public.write_text(public.read_text().replace(truth, "0" * 64))
    board.rescore(code=1, said="were not scored against the sealed truth")


def test_what_only_the_truth_shows_is_a_try_and_a_failed_job_is_none(
    sealed_board: Board, perfect: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Were it given back, whoever finds such a fault could ask the truth without end."""
    board, work = sealed_board, propose(sealed_board, perfect)
    found, opened = work / "found-score.json", work / "found-sealed.json"
    for started in (["--started"], [], ["--started"], []):  # the job failed: it comes back
        board.step("keep", found, *started)
    assert "This does not count as a try" in board.comment(found)

    def fail(*_: Any, **__: Any) -> None:
        raise PredictionError("45.1 degrees off the truth")

    board.step("keep", found, "--started")
    with monkeypatch.context() as patched:
        patched.setattr(checks, "evaluate", fail)
        open_sealed(board, work, code=1)
    comment = board.comment(opened)
    assert "The truth was opened" in comment
    assert "45.1" not in comment
    board.step("keep", opened, code=1)
    assert ",scored," in board.data_file("tries.csv").splitlines()[-1]

    # Changed files and a network keep the truth closed.
    monkeypatch.setattr("airzoo_bench.leaderboard.scoring.score_sealed", None)
    opened.unlink()
    [toml] = (work / "work").rglob("submission.toml")
    toml.write_text(toml.read_text().replace("CC-BY-4.0", "MIT"))
    assert "not the files" in open_sealed(board, work, code=1)
    monkeypatch.setattr(socket, "if_nameindex", lambda: [(1, "lo"), (2, "eth0")])
    assert "while there is a network (eth0)" in open_sealed(board, work, code=1)
    assert not opened.exists()
