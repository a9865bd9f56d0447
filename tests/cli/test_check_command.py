"""``check``: everything that is wrong with predictions, and exit codes that tell how."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.cli.bad_predictions import (
    Arrays,
    Make,
    changed,
    described,
    parquet,
    prediction_file,
    raw,
)
from tests.support import run_main, write_predictions


def test_check_lists_everything_and_exits_1(
    data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    ids = np.array(arrays["query_ids"])
    ids[1] = ids[0]
    ranked = np.array(arrays["ranked_ids"])[:, :4]
    ranked[2, 0] = ranked[2, 1]
    ranked[3, 0] = "west/t00000"
    ranked[4, 2] = ""
    scores = np.tile([4.0, 3, 2, 1], (10, 1))
    scores[5] = scores[5, ::-1]
    scores[6, 1] = np.inf
    path = tmp_path / "p.npz"
    changed(query_ids=ids, ranked_ids=ranked, scores=scores)(path, {})
    assert run_main("check", path) == 1
    out, message = capsys.readouterr()
    assert out == ""
    for finding in (
        "ids more than once",
        "an empty id before a tile",
        "a tile is ranked more than once",
        "tiles of another scene are ranked for 1 of 10 queries (east/q00003); the first is",
        "NaN or infinite scores",
        "scores are not in order for 2 of 10 queries (east/q00005",
    ):
        assert message.count(finding) == 1, finding


@pytest.mark.parametrize(
    ("make", "code"),
    [(raw(b""), 2), (raw(b"query,tile\n"), 2), (changed(query_ids=np.array(["east/a"] * 10)), 1)],
)
def test_check_tells_what_is_wrong_from_what_is_no_prediction(
    make: Make, code: int, data: Path, tmp_path: Path, arrays: Arrays
) -> None:
    assert run_main("check", prediction_file(tmp_path, make, arrays)) == code


@pytest.mark.parametrize(
    ("fields", "options", "code"),
    [
        ({}, [], 0),
        ({"centers": np.zeros(3)}, [], 1),
        ({"ranked_ids": "east/t00000"}, [], 1),
        ({"ranked_ids": np.zeros((10, 8))}, [], 1),
        ({"query_ids": None}, [], 1),
        ({"protocol": np.zeros(3)}, [], 1),
        ({"protocol": "a/b.toml"}, [], 1),
        ({"protocol": "unknown"}, [], 2),
        ({"protocol": None}, [], 2),
        ({}, ["--protocol", "unknown"], 2),
        ({}, ["--protocol", "airzoo-mini-matching"], 1),
        ({}, ["--data", "nowhere"], 2),
        ({}, ["--max-memory", "much"], 2),
    ],
)
def test_exit_codes_of_check(
    fields: Arrays, options: list[str], code: int, data: Path, tmp_path: Path, arrays: Arrays
) -> None:
    path = prediction_file(tmp_path, changed(**fields), arrays)
    assert run_main("check", path, *options) == code


def test_check_of_a_good_file_exits_0(
    data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    for make in (changed(), described(), parquet(protocol="made-retrieval")):
        assert run_main("check", prediction_file(tmp_path, make, arrays)) == 0
    changed()(tmp_path / "p.npz", {k: arrays[k] for k in ("query_ids", "ranked_ids")})
    assert run_main("check", tmp_path / "p.npz") == 0
    assert "nothing wrong was found" in capsys.readouterr().out


def test_check_tells_of_missing_queries_and_of_an_absent_benchmark(
    data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    given = {key: arrays[key][:3] for key in ("query_ids", "ranked_ids")}
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **given)
    assert run_main("check", path) == 0
    message = capsys.readouterr().err
    assert "queries that the predictions lack, scored at their worst: 7 of 10 (first 3: " in message
    protocol = data / "made" / "protocols" / "made-retrieval.toml"
    assert run_main("check", path, "--protocol", protocol, "--data", tmp_path) == 0
    assert "predictions were not compared with the benchmark" in capsys.readouterr().err


OF_TRACKS = {
    "retrieval": ("uav-visloc-retrieval", ["p.npz", "p.parquet"]),
    "matching": ("photos-matching", ["p.npz"]),  # a .txt may be a cloud
    "reconstruction": ("photos-reconstruction", ["p.npz", "p.ply", "p.laz", "p.zip", "p"]),
}
"""A protocol of each track, and what its predictions come as; names without ending are folders."""


@pytest.mark.parametrize("asked", OF_TRACKS)
@pytest.mark.parametrize("own", OF_TRACKS)
def test_predictions_of_another_track_are_told_their_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], asked: str, own: str
) -> None:
    protocol, names = OF_TRACKS[own]
    for name in names:
        path = tmp_path / name
        if path.suffix == ".npz":
            np.savez(path, protocol=protocol)
        elif path.suffix:
            path.write_text("ply")
        else:
            path.mkdir()
            (path / "protocol.txt").write_text(protocol)
        assert run_main("eval", asked, path, "--data", tmp_path) == 2
        told = f"airzoo-bench eval {own} {path}" in capsys.readouterr().err
        assert told == (asked != own), name
