"""``check``: everything that is wrong with predictions, and exit codes that tell how."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.support import run_main

Fields = dict[str, Any]
PROTOCOL = "made-retrieval"


def predict(path: Path, fields: Fields, **changes: Any) -> Path:
    """Write predictions with some fields changed; a field is left out where None."""
    kept = {"protocol": PROTOCOL} | fields | changes
    np.savez(path, **{key: np.array(value) for key, value in kept.items() if value is not None})
    return path


def changed(name: str, row: Any, value: Any) -> dict[str, Any]:
    return {"changed": (name, row, value)}


@pytest.mark.parametrize(
    ("fields", "options", "code", "named"),
    [
        ({}, [], 0, ""),
        (changed("query_ids", 1, "east/q00000"), [], 1, "east/q00000"),
        (changed("ranked_ids", (2, 0), "east/t00003"), [], 1, "east/q00002"),
        (changed("ranked_ids", (3, 0), "west/t00000"), [], 1, "east/q00003"),
        (changed("scores", (6, 1), np.inf), [], 1, "scores"),
        (changed("scores", 5, [1, 2, 3, 4]), [], 1, "east/q00005"),
        ({"query_ids": ["east/a"] * 10}, [], 1, "east/a"),
        ({"centers": np.zeros(3)}, [], 1, "centers"),
        ({"ranked_ids": np.zeros((10, 8))}, [], 1, "ranked_ids"),
        ({"protocol": "unknown"}, [], 2, "unknown"),
        ({"protocol": None}, [], 2, "--protocol"),
        ({}, ["--protocol", "unknown"], 2, "unknown"),
        ({}, ["--protocol", "airzoo-mini-matching"], 1, "map_xy"),
        ({}, ["--data", "nowhere"], 2, "--data nowhere"),
        ({}, ["--max-memory", "much"], 2, "--max-memory"),
    ],
)
def test_a_fault_is_named_with_its_exit_code(
    fields: Fields,
    options: list[str],
    code: int,
    named: str,
    data: Path,
    tmp_path: Path,
    perfect: Fields,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arrays = {key: np.array(value) for key, value in perfect.items()}
    if "changed" in fields:
        arrays["ranked_ids"] = arrays["ranked_ids"][:, :4]
        arrays["scores"] = np.tile([4.0, 3, 2, 1], (10, 1))
        name, row, value = fields["changed"]
        arrays[name][row] = value
        fields = {}
    assert run_main("check", predict(tmp_path / "p.npz", arrays, **fields), *options) == code
    assert named in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"", b"query,tile\n"])
def test_what_is_no_prediction_exits_2(content: bytes, data: Path, tmp_path: Path) -> None:
    (tmp_path / "p.npz").write_bytes(content)
    assert run_main("check", tmp_path / "p.npz") == 2


def test_good_files_of_every_kind_and_missing_queries(
    data: Path, tmp_path: Path, perfect: Fields, capsys: pytest.CaptureFixture[str]
) -> None:
    tiles = [
        f"{scene}/t{n:05d}" for scene, count in (("east", 12), ("west", 8)) for n in range(count)
    ]
    described = {
        "query_descriptors": np.eye(10, 8, dtype=np.float32),
        "gallery_ids": tiles,
        "gallery_descriptors": np.random.default_rng(0).random((20, 8), np.float32),
    }
    predict(tmp_path / "p.npz", perfect, ranked_ids=None, **described)
    pd.DataFrame(perfect).assign(protocol=PROTOCOL).to_parquet(tmp_path / "p.parquet")
    for name in ("p.npz", "p.parquet"):
        assert run_main("check", tmp_path / name) == 0
        assert "nothing" in capsys.readouterr().out
    fewer = predict(tmp_path / "p.npz", {key: value[:3] for key, value in perfect.items()})
    assert run_main("check", fewer) == 0
    assert "scored at their worst: 7 of 10 (first 3: " in capsys.readouterr().err


OF_TRACKS = {
    "retrieval": "uav-visloc-retrieval",
    "matching": "photos-matching",
    "reconstruction": "photos-reconstruction",
}


@pytest.mark.parametrize("asked", OF_TRACKS)
@pytest.mark.parametrize("own", OF_TRACKS)
def test_predictions_of_another_track_are_told_their_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], asked: str, own: str
) -> None:
    path = tmp_path / "p.npz"
    np.savez(path, protocol=OF_TRACKS[own])
    assert run_main("eval", asked, path, "--data", tmp_path) == 2
    told = f"airzoo-bench eval {own} {path}" in capsys.readouterr().err
    assert told == (asked != own)
