"""``check``: what is wrong with predictions, by exit codes; notes on odd reconstructions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.reconstruction.world import PROTOCOL as WORLD_PROTOCOL
from tests.reconstruction.world import World, make_world, predict_clouds, save, true_points
from tests.support import run_main

Fields = dict[str, Any]
PROTOCOL = "made-retrieval"


def predict(path: Path, fields: Fields, **changes: Any) -> Path:
    """Write predictions with some fields changed; a field is left out where None."""
    kept = {"protocol": PROTOCOL} | fields | changes
    np.savez(path, **{key: np.array(value) for key, value in kept.items() if value is not None})
    return path


@pytest.mark.parametrize(
    ("fields", "options", "code", "named"),
    [
        ({}, [], 0, ""),
        (("query_ids", 1, "east/q00000"), [], 1, "east/q00000"),
        (("ranked_ids", (2, 0), "east/t00003"), [], 1, "east/q00002"),
        (("ranked_ids", (3, 0), "west/t00000"), [], 1, "east/q00003"),
        (("scores", (6, 1), np.inf), [], 1, "scores"),
        (("scores", 5, [1, 2, 3, 4]), [], 1, "east/q00005"),
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
    fields: Any,
    options: list[str],
    code: int,
    named: str,
    data: Path,
    tmp_path: Path,
    perfect: Fields,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arrays = {key: np.array(value) for key, value in perfect.items()}
    if isinstance(fields, tuple):
        arrays["ranked_ids"] = arrays["ranked_ids"][:, :4]
        arrays["scores"] = np.tile([4.0, 3, 2, 1], (10, 1))
        name, row, value = fields
        arrays[name][row], fields = value, {}
    assert run_main("check", predict(tmp_path / "p.npz", arrays, **fields), *options) == code
    assert named in capsys.readouterr().err


def test_good_files_of_every_kind_and_missing_queries(
    data: Path, tmp_path: Path, perfect: Fields, capsys: pytest.CaptureFixture[str]
) -> None:
    for content in (b"", b"query,tile\n"):
        (tmp_path / "p.npz").write_bytes(content)
        assert run_main("check", tmp_path / "p.npz") == 2
    counts = (("east", 12), ("west", 8))
    described = {
        "query_descriptors": np.eye(10, 8, dtype=np.float32),
        "gallery_ids": [f"{scene}/t{n:05d}" for scene, count in counts for n in range(count)],
        "gallery_descriptors": np.random.default_rng(0).random((20, 8), np.float32),
    }
    predict(tmp_path / "p.npz", perfect, ranked_ids=None, **described)
    pd.DataFrame(perfect).assign(protocol=PROTOCOL).to_parquet(tmp_path / "p.parquet")
    for name in ("p.npz", "p.parquet"):
        assert run_main("check", tmp_path / name) == 0
        assert "nothing" in capsys.readouterr().out
    fewer = predict(tmp_path / "p.npz", {key: value[:3] for key, value in perfect.items()})
    assert run_main("check", fewer) == 0
    assert "7 of 10 (first 3: " in capsys.readouterr().err


def test_predictions_of_another_track_are_told_their_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    protocols = ("uav-visloc-retrieval", "photos-matching", "photos-reconstruction")
    tracks, path = [one.rpartition("-")[2] for one in protocols], tmp_path / "p.npz"
    for own, protocol in zip(tracks, protocols, strict=True):
        np.savez(path, protocol=protocol)
        for asked in tracks:
            assert run_main("eval", asked, path, "--data", tmp_path) == 2
            told = f"airzoo-bench eval {own} {path}" in capsys.readouterr().err
            assert told == (asked != own)


# --- odd reconstructions ---


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world"))


def odd(world: World, folder: Path, kind: str) -> Path:
    """Predict true clouds or exact depth maps, of which some are odd."""
    if kind == "views":
        extrinsics = world.cameras("yard")["extrinsics"].copy()
        extrinsics[4:] = np.nan
        fields = world.views("yard") | {"extrinsics": extrinsics}
        del fields["image_names"]
        save(folder / "yard.npz", fields)
        save(folder / "lot.npz", world.views("lot"))
        (folder / "protocol.txt").write_text(WORLD_PROTOCOL)
        return folder
    points: dict[str, Any] = {scene: true_points(scene) for scene in ("yard", "lot")}
    if kind == "points":
        strange = [[np.nan, 0, 0], [np.inf, 0, 0], [1e200, 0, 0]]
        points["yard"] = np.concatenate([points["yard"], strange])
    if kind == "axes":
        points["lot"] = points["lot"][:0]
    predict_clouds(world, folder, points, True)
    if kind == "points":
        (folder / "lot.ply").rename(folder / "plaza.ply")
        (folder / "readme.md").write_text("hi")
    elif kind == "names":
        (folder / "yard.ply").rename(folder / "yrad.ply")
    elif kind == "axes":
        axes = np.diag((1.0, -1, -1)) @ world.cameras("yard")["extrinsics"]
        save(folder / "yard.cameras.npz", world.cameras("yard") | {"extrinsics": axes})
    return folder


@pytest.mark.parametrize(
    ("kind", "fragments"),
    [
        ("nothing", []),
        ("points", ["scene yard", "3 points", "plaza", "readme.md", "worst: 1 (lot)"]),
        ("names", ["yrad (did you mean 'yard'?)", "1 (yard)"]),
        ("axes", ["scene yard", "OpenGL axes", "scene lot", "no point is left"]),
        ("views", ["scene yard", "2 of 6 photos", "image_names"]),
    ],
)
def test_notes_of_eval_and_of_check(
    kind: str,
    fragments: list[str],
    world: World,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(world.root))
    (tmp_path / "p").mkdir()
    path = odd(world, tmp_path / "p", kind)
    assert run_main("eval", "reconstruction", path, "--out", tmp_path / "out") == 0
    notes = json.loads((tmp_path / "out" / "result.json").read_text())["notes"]
    assert bool(notes) == bool(fragments)
    for fragment in fragments:
        assert any(fragment in note for note in notes), notes
    capsys.readouterr()
    assert run_main("check", path) == 0
    said = capsys.readouterr().err
    assert [one for one in notes if one not in said and "no point is left" not in one] == []
