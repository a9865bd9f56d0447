"""Surveys through the command line: exact predictions score perfect, wrong ones nothing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench import evaluate
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.geometry.crs import to_lonlat
from tests.datasets.surveys.colmap_models import colmap_matrix_layout
from tests.datasets.surveys.dji_folders import dji_layout
from tests.datasets.surveys.odm_projects import odm_layout
from tests.datasets.surveys.pose_tables import gimbal_table
from tests.datasets.surveys.survey import (
    CENTRE,
    CRS,
    FOCAL,
    NAMES,
    PHOTO,
    PINHOLE,
    Made,
    make_survey,
    prior_file,
)
from tests.support import run_main

LAYOUTS = {
    "poses": gimbal_table,
    "odm": odm_layout,
    "dji": dji_layout,
    "colmap": colmap_matrix_layout,
}


def prepared(arguments: list[object], out: Path) -> Path:
    named = ["--name", "place", "--tile-size", 64, "--out", out]
    assert run_main("prepare", *arguments, *named) == 0
    return out


def anchors(made: Made, row: int) -> np.ndarray:
    """Return the four anchor points on the ground in degrees, by a pinhole worked out here."""
    share = np.array([(1, 1), (15, 1), (15, 15), (1, 15)]) / 16
    pixels = share * PHOTO - CENTRE
    rays = np.column_stack((pixels / FOCAL, np.ones(4))) @ made.rotation[row]
    heights = 100.5 - made.centres[row, 2]
    ground = made.centres[row] + rays * (heights / rays[:, 2:])
    return to_lonlat(CRS, ground[:, :2])


def predictions(path: Path, folder: Path, made: Made, *, turned: bool = False) -> Path:
    """Rank the tiles that hold an anchor, first those that hold fewest; or those that hold none."""
    tiles = pd.read_parquet(folder / "scenes/place/retrieval/tiles.parquet")
    boxes = tiles[["lon_min", "lat_min", "lon_max", "lat_max"]].to_numpy()
    ids, rows = [], []
    for row, name in enumerate(NAMES):
        lon, lat = anchors(made, row).T[:, :, None]
        held = (lon >= boxes[:, 0]) & (lon <= boxes[:, 2]) & (lat >= boxes[:, 1])
        count = (held & (lat <= boxes[:, 3])).sum(axis=0)
        answers = tiles["id"][count == 0 if turned else count > 0].tolist()
        ids.append(f"place/{Path(name).stem}")
        rows.append((answers + [""] * 5)[:5])
    np.savez(path, protocol="place-retrieval", query_ids=ids, ranked_ids=np.array(rows))
    return path


@pytest.mark.parametrize("layout", LAYOUTS)
def test_exact_predictions_score_perfect(layout: str, tmp_path: Path) -> None:
    made = make_survey(tmp_path / "a b 测区", PINHOLE)
    folder = prepared(LAYOUTS[layout](made), tmp_path / "out")

    scores = evaluate(predictions(tmp_path / "p.npz", folder, made), data=folder).overall
    wrong = predictions(tmp_path / "w.npz", folder, made, turned=True)

    assert {scores[key] for key in ("recall@1", "recall@5", "ap@5")} == {1.0}
    assert evaluate(wrong, data=folder).overall["recall@5"] == 0.0


@pytest.mark.parametrize("layout", LAYOUTS)
def test_sides_of_tiles_may_be_in_metres(
    layout: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = make_survey(tmp_path / "place")
    out = tmp_path / "out"
    named = ("--name", "place", "--tile-size-m", 63.8, "--out", out)

    assert run_main("prepare", *LAYOUTS[layout](made), *named) == 0

    assert "tiles of 63.8 m are 64 px of the map, at 1 m per pixel" in capsys.readouterr().err
    assert Benchmark.open(out).file.tracks["retrieval"]["gallery"]["tile_sizes_px"] == [64]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_exact_poses_score_perfect_in_matching(layout: str, tmp_path: Path) -> None:
    """Priors are 4 m off; poses off by 7 m and 1.5 degrees score what they should."""
    made = make_survey(tmp_path / "place", PINHOLE)
    arguments = [*LAYOUTS[layout](made), "--priors", prior_file(made, 5e-5)]
    folder = prepared(arguments, tmp_path / "out")

    exact = matching(tmp_path / "p.npz", folder, made.rotation, made.centres)
    turn = Rotation.from_euler("z", 1.5, degrees=True).as_matrix()
    off = matching(
        tmp_path / "w.npz", folder, turn @ made.rotation, made.centres + np.array((0, 7, 0))
    )

    rotations = layout != "dji"  # a gimbal's are not trusted
    assert (exact["within_1m"], exact.get("within_1m_1deg")) == (1.0, 1.0 if rotations else None)
    assert (off["within_5m"], off["within_10m"]) == (0.0, 1.0)
    assert off["error_m"] == pytest.approx(7.0, abs=0.01)
    if rotations:
        assert (off["within_10m_1deg"], off["within_20m_2deg"]) == (0.0, 1.0)


def matching(
    path: Path, folder: Path, rotations: np.ndarray, centres: np.ndarray
) -> Mapping[str, float]:
    ids = [f"place/{Path(name).stem}" for name in NAMES]
    np.savez(path, protocol="place-matching", query_ids=ids, rotations=rotations, centres=centres)
    return evaluate(path, data=folder).overall


def test_it_is_named_after_the_source(tmp_path: Path, data: Path) -> None:
    made = make_survey(tmp_path / "made")

    assert run_main("prepare", *odm_layout(made), "--tile-size", 64) == 0

    assert (data / "project" / "protocols" / "project-retrieval.toml").is_file()
    assert (data / "project" / "benchmark.toml").is_file()


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_plane_may_be_the_ground(layout: str, tmp_path: Path) -> None:
    made = make_survey(tmp_path / "place", PINHOLE)
    arguments = LAYOUTS[layout](made)
    if "--dsm" in arguments:
        place = arguments.index("--dsm")
        arguments = [*arguments[:place], *arguments[place + 2 :]]
    else:
        (made.folder / "project/odm_dem/dsm.tif").unlink()

    folder = prepared([*arguments, "--plane-height", 100.5], tmp_path / "out")

    assert (folder / "scenes/place/retrieval").is_dir()
    assert not (folder / "scenes/place/matching").exists()
    scores = evaluate(predictions(tmp_path / "p.npz", folder, made), data=folder).overall
    assert {scores[key] for key in ("recall@1", "recall@5", "ap@5")} == {1.0}
