"""``check``: everything that is wrong with predictions, and exit codes that tell how."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.support import run_main, write_predictions

Arrays = dict[str, Any]
PROTOCOL = "made-retrieval"


def predict(path: Path, arrays: Arrays, **changes: Any) -> Path:
    """Write predictions with some fields changed; a field is left out where None."""
    fields = {key: arrays[key] for key in ("query_ids", "ranked_ids")}
    fields |= {"protocol": PROTOCOL} | changes
    np.savez(path, **{k: np.array(v) for k, v in fields.items() if v is not None})
    return path


def spoil(arrays: Arrays, fault: str) -> dict[str, np.ndarray]:
    """Return fields of a prediction with one fault."""
    ids, ranked = np.array(arrays["query_ids"]), np.array(arrays["ranked_ids"])[:, :4]
    scores = np.tile([4.0, 3, 2, 1], (10, 1))
    if fault == "query_ids":
        ids[1] = ids[0]
    elif fault == "twice":
        ranked[2, 0] = ranked[2, 1]
    elif fault == "west/t00000":
        ranked[3, 0] = fault
    elif fault == "empty":
        ranked[4, 2] = ""
    elif fault == "infinite":
        scores[6, 1] = np.inf
    elif fault == "order":
        scores[5] = scores[5, ::-1]
    return {"query_ids": ids, "ranked_ids": ranked, "scores": scores}


@pytest.mark.parametrize(
    ("fault", "named"),
    [
        ("query_ids", "east/q00000"),
        ("twice", "east/q00002"),
        ("west/t00000", "east/q00003"),
        ("empty", "east/q00004"),
        ("infinite", "scores"),
        ("order", "east/q00005"),
        ("none", ""),
    ],
)
def test_check_names_the_query_and_exits_1(
    fault: str,
    named: str,
    data: Path,
    tmp_path: Path,
    arrays: Arrays,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "p.npz"
    predict(path, arrays, **spoil(arrays, fault))
    assert run_main("check", path) == bool(named)
    assert named in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"", b"query,tile\n"])
def test_what_is_no_prediction_exits_2(content: bytes, data: Path, tmp_path: Path) -> None:
    (tmp_path / "p.npz").write_bytes(content)
    assert run_main("check", tmp_path / "p.npz") == 2


@pytest.mark.parametrize(
    ("fields", "options", "code"),
    [
        ({}, [], 0),
        ({"query_ids": ["east/a"] * 10}, [], 1),
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
    path = predict(tmp_path / "p.npz", arrays, **fields)
    assert run_main("check", path, *options) == code


def test_check_of_a_good_file_exits_0(
    data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    described = {
        "query_descriptors": np.eye(10, 8, dtype=np.float32),
        "gallery_ids": arrays["gallery_ids"],
        "gallery_descriptors": np.random.default_rng(0).random((20, 8), np.float32),
    }
    predict(tmp_path / "p.npz", arrays, ranked_ids=None, **described)
    table = pd.DataFrame({key: arrays[key] for key in ("query_ids", "ranked_ids")})
    table.assign(protocol=PROTOCOL).to_parquet(tmp_path / "p.parquet")
    for name in ("p.npz", "p.parquet"):
        assert run_main("check", tmp_path / name) == 0
        assert "nothing" in capsys.readouterr().out


def test_check_tells_of_missing_queries(
    data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    given = {key: arrays[key][:3] for key in ("query_ids", "ranked_ids")}
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **given)
    assert run_main("check", path) == 0
    message = capsys.readouterr().err
    assert "queries that the predictions lack, scored at their worst: 7 of 10 (first 3: " in message


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
