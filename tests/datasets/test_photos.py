"""`prepare photos` with good sources: what the folder holds, and that it can be scored."""

from __future__ import annotations

import json
import os
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from rasterio import Affine

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.photo_options import PhotoOptions
from airzoo_bench.datasets.photos import prepare_photos
from airzoo_bench.geometry.frames import to_lonlat
from airzoo_bench.protocol.lookup import load_protocol
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth
from tests.datasets.parts import hold_crops, hold_tiles
from tests.support import (
    MAP_SIZE_M,
    NORTH_WEST,
    PLACE_CRS,
    PLACE_PHOTOS,
    Place,
    files_below,
    make_place,
    photo_protocols,
    run_main,
    write_raster,
)


def prepared(
    place: Place, folder: Path, truth: dict[str, Any] | None = None, **options: Any
) -> Prepared:
    """Prepare a place with tiles of 64 px, 50 % overlap."""
    sizes = options.pop("tile_sizes_px", (64,))
    chosen = photo_protocols("park", sizes, truth)
    sources = PhotoOptions(
        "park", place.images, place.poses, place.dom, dsm=place.dsm, crs=options.pop("crs", None)
    )
    return prepare_photos(sources, chosen, PrepareSettings(folder, folder.parent, **options))


def truth_in(folder: Path) -> RetrievalTruth:
    benchmark = Benchmark.open(folder)
    return read_truth(benchmark.scene_folder("park"), "park")


def positives(truth: RetrievalTruth, query: str) -> set[str]:
    number = truth.queries["id"].tolist().index(f"park/{query}")
    return {truth.tiles["id"][t].split("/")[1] for t in truth.positives.of(number)}


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


def test_the_same_sources_give_the_same_bytes(tmp_path: Path) -> None:
    place = make_place(tmp_path)
    for name in ("one", "two"):
        prepared(place, tmp_path / name, copy=True, tiles_on_disk=True)
    assert files_below(tmp_path / "one") == files_below(tmp_path / "two")
    for path in (tmp_path / "one").rglob("*"):
        if path.is_file():
            other = tmp_path / "two" / path.relative_to(tmp_path / "one")
            assert path.read_bytes() == other.read_bytes(), path


def test_copied_data_travel_with_the_folder(tmp_path: Path) -> None:
    place = make_place(tmp_path / "sources")
    prepared(place, tmp_path / "park", copy=True)
    (tmp_path / "park").rename(tmp_path / "moved")
    benchmark = Benchmark.open(tmp_path / "moved")
    scene = benchmark.scene("park")
    for name in place.centres:
        copied = benchmark.resolve(scene.images) / name
        assert copied.read_bytes() == (place.images / name).read_bytes()
    assert scene.dsm is not None
    for kept, source in ((scene.dom, place.dom), (scene.dsm, place.dsm)):
        assert benchmark.resolve(kept).read_bytes() == source.read_bytes()
    assert str(tmp_path) not in (tmp_path / "moved" / "benchmark.toml").read_text()


def test_data_left_where_they_are(tmp_path: Path) -> None:
    place = make_place(tmp_path / "sources")
    prepared(place, tmp_path / "park")
    benchmark = Benchmark.open(tmp_path / "park")
    assert benchmark.resolve(benchmark.scene("park").images) == place.images.resolve()
    assert not (tmp_path / "park" / "data").exists()


def test_tiles_as_files_are_the_windows_of_the_map(tmp_path: Path) -> None:
    place = make_place(tmp_path)
    prepared(place, tmp_path / "park", tiles_on_disk=True)
    opened = load_benchmark(tmp_path / "park").scenes[0]
    hold_tiles(tmp_path / "park" / "scenes" / "park", opened)
    assert len(opened.tiles()) == 49


def test_crops_as_files_are_those_of_the_queries(tmp_path: Path) -> None:
    # Two names that differ by a slash only are two crops.
    place = make_place(tmp_path, {**PLACE_PHOTOS, "sub_d.jpg": (180.0, 180.0)})
    centres = np.array([*place.centres.values()]) * (1, -1) + NORTH_WEST + (2, -3)
    places = zip(place.centres, to_lonlat(PLACE_CRS, centres).tolist(), strict=True)
    rows = [f"{name},{lon},{lat},199,3,-88,0" for name, (lon, lat) in places]
    head = "image,lon,lat,altitude_m,yaw_deg,pitch_deg,roll_deg"
    (tmp_path / "priors.csv").write_text("\n".join([head, *rows]))
    out = tmp_path / "park"
    assert run_main(*place.arguments(priors=tmp_path / "priors.csv", crops="files", out=out)) == 0
    hold_crops(out / "scenes" / "park", load_benchmark(out).scenes[0])


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


def test_from_a_colmap_model(tmp_path: Path) -> None:
    import pycolmap

    place = make_place(tmp_path)
    prepared(place, tmp_path / "json")
    made = pycolmap.Reconstruction()
    made.add_camera_with_trivial_rig(
        pycolmap.Camera(
            model="SIMPLE_PINHOLE", width=64, height=48, params=[64, 32, 24], camera_id=1
        )
    )
    for number, (name, image) in enumerate(place.read_poses()["images"].items(), start=1):
        rotation, centre = np.array(image["R_w2c"]), np.array(image["center"])
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ centre)
        made.add_image_with_trivial_frame(
            pycolmap.Image(name=name, camera_id=1, image_id=number), pose
        )
    model = tmp_path / "model"
    model.mkdir()
    made.write_binary(str(model))
    from_model = Place(place.images, model, place.dom, place.dsm, place.centres)
    prepared(from_model, tmp_path / "colmap", crs="EPSG:32633")
    one, other = truth_in(tmp_path / "json"), truth_in(tmp_path / "colmap")
    for name in ("a", "b", "c", "sub/d"):
        assert positives(other, name) == positives(one, name)
    np.testing.assert_allclose(other.footprint_centres, one.footprint_centres, atol=1e-9)


def test_the_crs_may_be_given_and_spelt_otherwise(tmp_path: Path) -> None:
    place = make_place(tmp_path)
    prepared(place, tmp_path / "one")
    place.change_poses(crs="EPSG:32632")
    prepared(place, tmp_path / "two", crs="+proj=utm +zone=33 +datum=WGS84 +units=m")
    assert truth_in(tmp_path / "one").fingerprint == truth_in(tmp_path / "two").fingerprint


def test_a_folder_is_replaced_when_asked(tmp_path: Path) -> None:
    place = make_place(tmp_path / "sources")
    prepared(place, tmp_path / "park", tiles_on_disk=True)
    prepared(place, tmp_path / "park", replace=True)
    assert files_below(tmp_path) - {f"sources/{f}" for f in files_below(tmp_path / "sources")} == {
        "sources",
        "park",
        *(f"park/{name}" for name in files_below(tmp_path / "park")),
    }
    assert not (tmp_path / "park" / "scenes" / "park" / "retrieval" / "tiles").exists()


def test_from_photos_to_a_score(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    place = make_place(tmp_path)
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    assert run_main(*place.arguments()) == 0
    said = capsys.readouterr()
    assert "retrieval       4 queries" in said.out
    assert "next: airzoo-bench baseline retrieval park-retrieval" in said.err
    out = tmp_path / "t.npz"
    assert run_main("template", "park-retrieval", "--out", out, "--kind", "descriptors") == 0
    assert run_main("check", out) == 0
    assert run_main("eval", "retrieval", out, "--format", "csv") == 0
    assert "\npark,4," in capsys.readouterr().out


def test_the_protocol_in_the_folder_is_the_one_that_was_used(tmp_path: Path) -> None:
    prepared(make_place(tmp_path), tmp_path / "park", {"rule": "iou", "iou_above": 0.2})
    written = load_protocol(tmp_path / "park" / "protocols" / "park-retrieval.toml")
    assert (written.ground_truth.rule, written.ground_truth.iou_above) == ("iou", 0.2)
    Benchmark.open(tmp_path / "park").check_fits(written)
    file = tomllib.loads((tmp_path / "park" / "benchmark.toml").read_text())
    assert set(file["checksums"]) == {
        f"scenes/park/{name}"
        for name in (
            "queries.csv",
            "retrieval/tiles.parquet",
            "retrieval/dropped_tiles.csv",
            "retrieval/positives.npz",
            "retrieval/overlaps.npz",
            "retrieval/footprints.csv",
            "retrieval/excluded.csv",
        )
    }


@pytest.mark.skipif(sys.platform != "linux", reason="file names are bytes on Linux only")
def test_a_file_name_that_is_no_text(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    place = make_place(tmp_path)
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    name = os.fsdecode(b"\xff.jpg")
    (place.images / "a.jpg").rename(place.images / name)
    assert run_main(*place.arguments()) == 0
    said = capsys.readouterr()
    assert "photos without a pose, which no track asks: 1 ('\\udcff.jpg')" in said.err
    assert "retrieval       3 queries" in said.out


def test_a_real_scene(brighton: Path, tmp_path: Path) -> None:
    sources = PhotoOptions(
        "park",
        brighton / "images",
        brighton / "poses.json",
        brighton / "dom_10cm.tif",
        dsm=brighton / "dsm_10cm.tif",
    )
    result = prepare_photos(
        sources, photo_protocols("park", (512,)), PrepareSettings(tmp_path / "park", tmp_path)
    )
    truth = truth_in(tmp_path / "park")
    assert len(truth.queries) + len(truth.excluded) == 18
    assert len(truth.queries) > 0
    assert result.facts["park"].inputs.unposed == ()
    assert truth.queries["pitch_deg"].between(60, 90).all()
    assert (truth.positives.counts > 0).all()


def test_a_true_cloud_of_another_frame_is_refused(tmp_path: Path) -> None:
    place = make_place(tmp_path)
    cloud = tmp_path / "cloud.npy"
    np.save(cloud, np.random.default_rng(0).uniform(0, 100, (50, 3)))
    sources = PhotoOptions("park", place.images, place.poses, place.dom, dsm=place.dsm, cloud=cloud)
    with pytest.raises(BenchmarkError, match="in the CRS of the poses"):
        prepare_photos(
            sources, photo_protocols("park", (64,)), PrepareSettings(tmp_path / "park", tmp_path)
        )
    assert not (tmp_path / "park").exists()


def test_a_true_cloud_makes_truth_for_reconstruction(tmp_path: Path) -> None:
    place = make_place(tmp_path)
    cloud = tmp_path / "cloud.npy"
    images = json.loads(place.poses.read_text())["images"].values()
    centres = np.array([image["center"] for image in images])
    np.save(cloud, np.random.default_rng(0).uniform(-50, 50, (50, 3)) + centres.mean(axis=0))
    sources = PhotoOptions("park", place.images, place.poses, place.dom, dsm=place.dsm, cloud=cloud)
    result = prepare_photos(
        sources,
        photo_protocols("park", (64,)),
        PrepareSettings(tmp_path / "park", tmp_path, copy=True),
    )
    assert "park-reconstruction" in result.protocols
    truth = read_reconstruction(Benchmark.open(tmp_path / "park"), "park")
    assert len(truth.photos) == 4
    assert truth.cloud.read_bytes() == cloud.read_bytes()
