"""What `prepare photos` prints of sound scenes: their figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rasterio import Affine

from airzoo_bench.benchmark.queries import SceneInputs
from airzoo_bench.datasets.scene_facts import _share_inside
from airzoo_bench.geometry.crs import from_lonlat
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.protocol.lookup import shipped_protocols
from tests.support import MAP_SIZE_M, Place, run_main, write_raster


def test_a_sound_scene_says_its_figures_and_no_warning(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main(*place.arguments(tile_size=96, rule="iou", iou_above=0.39)) == 0
    said = capsys.readouterr()
    assert "warning" not in said.err
    for line in (
        "photos          4, 100.0 m above the surface (100.0 m above take-off by their metad",
        "poses           2.1 m from the photos' GPS, -2.0 m in height (medians)",
        "priors          4, off by 2.9 m; yaw 0.0, pitch 1.0, rotation 1.0 degrees",
        "map             256 x 256 px, 1 m per pixel; 100% of the photos' corners lie on it",
        "surface         100% of its pixels have a height, 99.5 to 100.0 m, median 100.0 m",
        "crops           18% of the map each on average, at most 18%",
        "chance          a random tile is a right answer in 10.0% of cases",
    ):
        assert f"  {line}" in said.out


def test_empty_tiles_are_counted(place: Place, capsys: pytest.CaptureFixture[str]) -> None:
    colours = np.full((3, MAP_SIZE_M, MAP_SIZE_M), 9, np.uint8)
    colours[:, :100, :100] = 0
    write_raster(place.dom, colours, nodata=0)
    assert run_main(*place.arguments()) == 0
    # Of tiles of 64 px every 32 px, those that begin at 0 and 32 both ways end before 100.
    assert "of cases; 4 tiles without valid pixels left out" in capsys.readouterr().out


def test_tiles_below_a_threshold_are_not_called_empty(
    place: Place, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    colours = np.full((3, MAP_SIZE_M, MAP_SIZE_M), 9, np.uint8)
    colours[:, :100, :100] = 0
    write_raster(place.dom, colours, nodata=0)
    shipped = shipped_protocols()["photos-retrieval"].read_text()
    half = tmp_path / "half.toml"
    half.write_text(shipped.replace("least_valid_share = 0.0", "least_valid_share = 0.5"))
    assert run_main(*place.arguments(protocol=half)) == 0
    # Those that begin at 0, 32 or 64 both ways, but for the last of these.
    assert "; 8 tiles with less than 50% of valid pixels left out" in capsys.readouterr().out
    predictions = tmp_path / "p.npz"
    assert run_main("template", "park-retrieval", "--out", predictions) == 0
    for command in (("eval", "retrieval"), ("check",)):
        assert run_main(*command, predictions) == 0
        said = capsys.readouterr()
        assert "8 tiles with less than 50% of valid pixels are in no gallery" in said.out + said.err
    filled = dict(np.load(predictions))
    filled["ranked_ids"] = filled["ranked_ids"].astype("U40")
    filled["ranked_ids"][0, 0] = "park/64_00001_00002"
    np.savez(predictions, **filled)
    assert run_main("check", predictions) == 1
    said = capsys.readouterr()
    fix = "leave this tile out: 43.8% of its pixels are valid, and dropped_tiles.csv lists it"
    assert fix in said.out + said.err


def test_corners_lie_on_a_map_across_the_180th_meridian(tmp_path: Path) -> None:
    pixels = np.zeros((3, 20, 20), np.uint8)
    transform = Affine(0.001, 0, 179.99, 0, -0.001, 50.01)
    write_raster(tmp_path / "dom.tif", pixels, crs="EPSG:4326", transform=transform)
    lonlat = np.array([(179.995, 50.0), (-179.995, 50.0), (-179.9, 50.0)])
    corners = from_lonlat("EPSG:32601", lonlat)
    inputs = SceneInputs("s", pd.DataFrame({"id": ["a"]}), "EPSG:32601", None, None, 0.0)

    assert _share_inside(corners[None], inputs, open_info(tmp_path / "dom.tif")) == 2 / 3
