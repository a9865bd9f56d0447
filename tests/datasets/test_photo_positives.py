"""Which tiles answer own photos, by every rule, and what becomes of photos that none answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from rasterio import Affine

from airzoo_bench.core.errors import BenchmarkError
from tests.datasets.prepared_photos import positives, prepared, truth_in
from tests.support import MAP_SIZE_M, NORTH_WEST, Place, make_place, write_raster


def expected_positives(x: float, y: float) -> set[str]:
    """Return the tiles that hold an anchor, in metres from the map's corner.

    A photo of 64 x 48 px with f = 64 px sees 100 m x 75 m from 100 m above the ground; anchors lie
    7/16 of that to either side of its centre.
    """
    anchors = [(x + sx * 43.75, y + sy * 32.8125) for sx in (-1, 1) for sy in (-1, 1)]
    starts = range(0, MAP_SIZE_M - 63, 32)
    return {
        f"64_{row:05d}_{column:05d}"
        for row, top in enumerate(starts)
        for column, left in enumerate(starts)
        if any(left <= u <= left + 64 and top <= v <= top + 64 for u, v in anchors)
    }


def test_the_truth_is_that_of_the_geometry(tmp_path: Path) -> None:
    place = make_place(tmp_path)
    result = prepared(place, tmp_path / "park")
    truth = truth_in(tmp_path / "park")
    assert result.folder == tmp_path / "park"
    assert truth.queries["id"].tolist() == ["park/a", "park/b", "park/c", "park/sub/d"]
    assert len(truth.tiles) == 49
    for name, centre in place.centres.items():
        assert positives(truth, name.removesuffix(".jpg")) == expected_positives(*centre), name
    np.testing.assert_allclose(truth.queries["altitude_m"], 100.0)
    np.testing.assert_allclose(truth.queries["pitch_deg"], 90.0)
    assert truth.excluded.empty
    assert result.facts["park"].inputs.unposed == ()


def outside(folder: Path) -> Place:
    place = make_place(
        folder, {"a.jpg": (64.0, 64.0), "far.jpg": (5000.0, 64.0), "up.jpg": (64, 64)}
    )
    place.change_image("up.jpg", R_w2c=[[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    Image.new("RGB", (64, 48)).save(place.images / "unposed.jpg")
    return place


def test_photos_that_nothing_answers_are_listed_with_the_reason(tmp_path: Path) -> None:
    result = prepared(outside(tmp_path), tmp_path / "park")
    truth = truth_in(tmp_path / "park")
    assert truth.queries["id"].tolist() == ["park/a"]
    listed = pd.read_csv(tmp_path / "park" / "scenes" / "park" / "retrieval" / "excluded.csv")
    assert listed.to_dict("records") == [
        {"id": "park/far", "image": "far.jpg", "reason": "the footprint meets no tile"},
        {"id": "park/unposed", "image": "unposed.jpg", "reason": "no pose"},
        {"id": "park/up", "image": "up.jpg", "reason": "no ray meets the ground"},
    ]
    assert result.facts["park"].inputs.unposed == ("unposed.jpg",)
    assert truth_in(tmp_path / "park").without_ground_point == 1


def test_or_counted_as_a_miss(tmp_path: Path) -> None:
    prepared(outside(tmp_path), tmp_path / "park", {"without_positive": "miss"})
    truth = truth_in(tmp_path / "park")
    assert truth.queries["id"].tolist() == ["park/a", "park/far", "park/up"]
    assert [len(truth.positives.of(q)) for q in range(3)] == [9, 0, 0]
    assert truth.excluded["reason"].tolist() == ["no pose"]
    assert np.isnan(truth.footprint_centres[2]).all()


def test_the_dsm_rule_sees_a_hill(tmp_path: Path) -> None:
    # A plateau of 150 m in the north-west: from 200 m, photo a sees half as much of it.
    place = make_place(tmp_path)
    heights = np.full((1, MAP_SIZE_M, MAP_SIZE_M), 100, np.float32)
    heights[0, :128, :128] = 150
    write_raster(place.dsm, heights)
    prepared(place, tmp_path / "plane")
    prepared(place, tmp_path / "dsm", {"rule": "dsm"})
    plane, dsm = truth_in(tmp_path / "plane"), truth_in(tmp_path / "dsm")
    columns = ["anchor0_lon", "anchor1_lon"]
    width = {
        name: np.ptp(truth.footprints.set_index("id").loc["park/a", columns].to_numpy(float))
        for name, truth in (("plane", plane), ("dsm", dsm))
    }
    assert width["dsm"] == pytest.approx(width["plane"] / 2, rel=1e-4)
    assert positives(dsm, "sub/d") == positives(plane, "sub/d")
    assert positives(dsm, "a") != positives(plane, "a")


def test_the_iou_rule(tmp_path: Path) -> None:
    # 87.5 m x 65.6 m of footprint and 64 m tiles: the middle one has an IoU of 4096 / 5742.
    place = make_place(tmp_path, {"a.jpg": (64.0, 64.0)})
    middle = {"64_00001_00001"}
    prepared(place, tmp_path / "high", {"rule": "iou", "iou_above": 0.71})
    assert positives(truth_in(tmp_path / "high"), "a") == middle
    prepared(place, tmp_path / "low", {"rule": "iou", "iou_above": 0.1})
    assert positives(truth_in(tmp_path / "low"), "a") > middle
    with pytest.raises(BenchmarkError, match="no photo has a tile that answers it") as refused:
        prepared(place, tmp_path / "none", {"rule": "iou", "iou_above": 0.72})
    assert "1 photo: no tile overlaps by more than 0.72: the best by 0.713 (a.jpg)" in str(
        refused.value
    )
    assert refused.value.fix is not None
    assert refused.value.fix.startswith("lower --iou-above below 0.713, or choose a --tile-size")
    assert "CRS" not in refused.value.fix
    assert not (tmp_path / "none").exists()


def refusal(place: Place, folder: Path, rules: dict[str, Any]) -> BenchmarkError:
    with pytest.raises(BenchmarkError, match="no photo has a tile that answers it") as refused:
        prepared(place, folder, rules)
    return refused.value


def test_overlaps_below_the_threshold_are_one_reason(tmp_path: Path) -> None:
    place = make_place(tmp_path, {"a.jpg": (64, 70), "b.jpg": (64, 64), "c.jpg": (70, 75)})
    found = refusal(place, tmp_path / "park", {"rule": "iou", "iou_above": 0.9})
    reason = "3 photos: no tile overlaps by more than 0.9: the best by 0.713 (b.jpg)"
    assert f"answers it ({reason}); cameras" in str(found)


def test_footprints_around_the_map_are_told_to_take_a_larger_one(tmp_path: Path) -> None:
    place = make_place(tmp_path, {"a.jpg": (128.0, 128.0)})
    x, y = NORTH_WEST
    place.change_image("a.jpg", center=[x + 128, y - 128, 1000.0])
    found = refusal(place, tmp_path / "park", {})
    assert "(1 photo: the footprint overlaps tiles, but none of its 4 points lies in one)" in str(
        found
    )
    assert found.fix is not None
    assert found.fix.startswith("take a map that is larger than the footprints, or --rule iou")


def test_a_map_smaller_than_a_tile_is_one_tile(tmp_path: Path) -> None:
    place = make_place(tmp_path)
    prepared(place, tmp_path / "park", tile_sizes_px=(1024, 512))
    truth = truth_in(tmp_path / "park")
    assert truth.tiles["id"].tolist() == ["park/1024_00000_00000", "park/512_00000_00000"]
    assert truth.tiles[["width", "height"]].to_numpy().tolist() == [[256, 256]] * 2
    assert truth.positives.counts.tolist() == [2] * 4


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3857"])
def test_a_map_in_another_crs(crs: str, tmp_path: Path) -> None:
    from pyproj import Transformer

    place = make_place(tmp_path)
    to = Transformer.from_crs("EPSG:32633", crs, always_xy=True)
    west, north = to.transform(*NORTH_WEST)
    east, south = to.transform(NORTH_WEST[0] + MAP_SIZE_M, NORTH_WEST[1] - MAP_SIZE_M)
    pixel = ((east - west) / MAP_SIZE_M, (south - north) / MAP_SIZE_M)
    ground = np.zeros((3, MAP_SIZE_M, MAP_SIZE_M), np.uint8)
    prepared(place, tmp_path / "utm")
    write_raster(
        place.dom, ground, crs=crs, transform=Affine(pixel[0], 0, west, 0, pixel[1], north)
    )
    prepared(place, tmp_path / "other")
    one, other = truth_in(tmp_path / "utm"), truth_in(tmp_path / "other")
    np.testing.assert_allclose(other.boxes, one.boxes, atol=2e-6)  # 20 cm; convergence is small
    for name in ("a", "b", "c", "sub/d"):
        assert positives(other, name) == positives(one, name)
