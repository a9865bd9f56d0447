"""Bad sources of `prepare photos`: one message, exit code 2, and no folder left behind."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.support import (
    MAP_SIZE_M,
    Place,
    files_below,
    make_place,
    run_main,
    write_raster,
)

FLAT = np.full((1, MAP_SIZE_M, MAP_SIZE_M), 100, np.float32)
MIRRORED = [[1.0, 0, 0], [0, 1.0, 0], [0, 0, -1.0]]
STRETCHED = [[1.01, 0, 0], [0, -1.0, 0], [0, 0, -1.0]]


def turned(place: Place) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.new("RGB", (64, 48)).save(place.images / "a.jpg", exif=exif)


def renamed(place: Place) -> None:
    names = {f"IMG_{i}.jpg": image for i, image in enumerate(place.read_poses()["images"].values())}
    place.change_poses(images=names)


def unseen(place: Place) -> None:
    for name, (x, y) in place.centres.items():
        place.change_image(name, center=[x, y, 200.0])


def swapped(place: Place) -> dict[str, object]:
    return {"dom": place.dsm, "dsm": place.dom}


def no_poses_key(place: Place) -> None:
    content = place.read_poses()
    del content["images"]["b.jpg"]["R_w2c"]
    place.poses.write_text(json.dumps(content))


def no_crs(place: Place) -> None:
    content = place.read_poses()
    del content["crs"]
    place.poses.write_text(json.dumps(content))


def control_name(place: Place) -> None:
    (place.images / "a.jpg").rename(place.images / "a\x1b[2J.jpg")
    content = json.loads(place.poses.read_text())
    content["images"]["a\x1b[2J.jpg"] = content["images"].pop("a.jpg")
    place.poses.write_text(json.dumps(content))


def empty_colmap(place: Place) -> dict[str, object]:
    folder = place.poses.parent / "model"
    folder.mkdir()
    for name in ("cameras", "images", "points3D"):
        (folder / f"{name}.txt").write_text("# empty\n")
    return {"poses": folder}


def broken_colmap(place: Place) -> dict[str, object]:
    folder = place.poses.parent / "model"
    folder.mkdir()
    (folder / "cameras.bin").write_bytes(b"\x01")
    return {"poses": folder}


def over_the_sources(place: Place) -> dict[str, object]:
    (place.images.parent / "benchmark.toml").write_text("")
    return {"out": place.images.parent, "force": ""}


def options(**changes: object) -> Callable[[Place], dict[str, object]]:
    return lambda place: changes


def resolution(place: Place) -> dict[str, object]:
    from airzoo_bench.protocol.lookup import shipped_protocols

    text = shipped_protocols()["photos-retrieval"].read_text()
    path = place.poses.parent / "fine.toml"
    path.write_text(text.replace('gsd_m = "any"', "gsd_m = 0.3"))
    return {"protocol": path}


CASES: dict[str, tuple[Callable[[Place], Any], list[str]]] = {
    "no photos": (
        lambda p: [path.unlink() for path in p.images.rglob("*.jpg")],
        ["photos: holds no photo", "files ending in .jpg"],
    ),
    "no folder of photos": (options(images="nowhere"), ["nowhere: no such folder of photos"]),
    "photo is text": (
        lambda p: (p.images / "b.jpg").write_text("hello"),
        ["b.jpg: not a readable photo", "a complete .jpg", "copy it again"],
    ),
    "photo is cut off": (
        lambda p: (p.images / "b.jpg").write_bytes((p.images / "b.jpg").read_bytes()[:100]),
        ["b.jpg: not a readable photo"],
    ),
    "photo is turned": (
        turned,
        ["a.jpg: is to be shown turned (EXIF orientation 6)", "orientation 1", "exiftool"],
    ),
    "photos of one stem": (
        lambda p: (
            Image.new("RGB", (64, 48)).save(p.images / "a.png")
            or p.change_poses(
                images=p.read_poses()["images"] | {"a.png": p.read_poses()["images"]["a.jpg"]}
            )
        ),
        ["differ in their ending only: 1 of 5 (a)", "keep one of each"],
    ),
    "photo's name does not print": (
        control_name,
        [r"names that cannot become ids: 1 of 4 ('a\x1b[2J.jpg')", "rename"],
    ),
    "no pose file": (options(poses="none.json"), ["none.json: no such pose file"]),
    "poses are not JSON": (
        lambda p: p.poses.write_text("K = 3"),
        ["poses.json: not valid JSON", "line 1 column 1", "images: {name: {R_w2c, center}}"],
    ),
    "poses are not text": (
        lambda p: p.poses.write_bytes(b"\xff\xfe\x00"),
        ["poses.json: not text: byte 0 is not UTF-8"],
    ),
    "no rotation": (no_poses_key, ["poses.json: key 'images.b.jpg.R_w2c' is missing", "docs/"]),
    "NaN in a centre": (
        lambda p: p.change_image("a.jpg", center=[1.0, float("nan"), 2.0]),
        ["poses.json: key 'images.a.jpg.center.1' is nan", "finite number"],
    ),
    "centre of two numbers": (
        lambda p: p.change_image("a.jpg", center=[1.0, 2.0]),
        ["poses.json: key 'images.a.jpg.center.2' is missing"],
    ),
    "no images": (
        lambda p: p.change_poses(images={}),
        ["poses.json: key 'images' is {}", "at least 1"],
    ),
    "no camera matrix": (
        lambda p: p.change_poses(K=None),
        ["poses.json: no camera matrix for a.jpg", "'K' for the image, or one for all"],
    ),
    "singular camera": (
        lambda p: p.change_poses(K=[[64, 0, 32], [0, 0, 24], [0, 0, 1]]),
        ["poses.json: K has no positive focal length in 4 of 4 (first 3: a.jpg, b.jpg, c.jpg)"],
    ),
    "skewed camera": (
        lambda p: p.change_image("c.jpg", K=[[64, 1, 32], [0, 64, 24], [0, 0, 1]]),
        ["poses.json: K has skew in 1 of 4 (c.jpg)", "K = [fx 0 cx; 0 fy cy; 0 0 1]"],
    ),
    "camera of another size": (
        lambda p: p.change_poses(K=[[640, 0, 320], [0, 640, 240], [0, 0, 1]]),
        ["poses.json: camera matrices of another image size: 4 of 4", "64x48", "(320.0, 240.0)"],
    ),
    "two cameras and one K": (
        lambda p: Image.new("L", (640, 480)).save(p.images / "c.jpg"),
        [
            "another image size: 1 of 4 (c.jpg)",
            "photos of 2 cameras: 64x48 px: 3 (a.jpg, b.jpg, sub/d.jpg), 640x480 px: 1 (c.jpg)",
            "need a K each (in their entry of 'images'), or a benchmark for each camera",
        ],
    ),
    "not a rotation": (
        lambda p: p.change_image("b.jpg", R_w2c=STRETCHED),
        [
            "poses.json: rotation is not orthonormal in 1 of 4 (b.jpg (|R^T R - I| = 0.02))",
            "0.0001 in every",
        ],
    ),
    "reflection": (
        lambda p: p.change_image("b.jpg", R_w2c=MIRRORED),
        ["poses.json: rotation is a reflection in 1 of 4 (b.jpg (det = -1))", "det = +1", "axes"],
    ),
    "names that match no photo": (
        renamed,
        ["poses.json: none of its 4 images is among 4 photos", "such as a.jpg", "'IMG_0.jpg'"],
    ),
    "poses look up": (
        lambda p: [
            p.change_image(n, R_w2c=[[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]) for n in p.centres
        ],
        ["no photo has a tile that answers it (4 photos: no ray meets", "world-to-camera"],
    ),
    "poses elsewhere": (
        unseen,
        ["poses.json: no photo has a tile", "4 photos: the footprint meets no tile", "CRS of"],
    ),
    "CRS is not known": (no_crs, ["poses.json: the CRS of the poses is not known", "--crs EPSG"]),
    "CRS is nonsense": (
        lambda p: p.change_poses(crs="EPSG:0"),
        ["poses.json, key 'crs': unknown CRS 'EPSG:0'", "such as EPSG:4547"],
    ),
    "option CRS is nonsense": (options(crs="moon"), ["--crs moon: unknown CRS 'moon'"]),
    "CRS in degrees": (
        lambda p: p.change_poses(crs="EPSG:4326"),
        ["key 'crs': poses are in EPSG:4326 (WGS 84), which is not in metres", "UTM"],
    ),
    "CRS in feet": (
        lambda p: p.change_poses(crs="EPSG:2263"),
        ["key 'crs': poses are in EPSG:2263", "not in metres"],
    ),
    "DSM in another CRS": (
        lambda p: write_raster(p.dsm, FLAT, crs="EPSG:32632"),
        ["poses.json) and the DSM", "EPSG:32633", "EPSG:32632", "one CRS", "gdalwarp"],
    ),
    "DSM without CRS": (
        lambda p: write_raster(p.dsm, FLAT, crs=None),
        ["dsm.tif: no georeference: no CRS", "-a_srs"],
    ),
    "DSM without heights": (
        lambda p: write_raster(p.dsm, FLAT, nodata=100.0),
        ["dsm.tif: no valid height", "nodata"],
    ),
    "DSM is text": (
        lambda p: p.dsm.write_text("heights"),
        ["dsm.tif: cannot be read as a raster", "GeoTIFF"],
    ),
    "DSM is cut off": (
        lambda p: p.dsm.write_bytes(p.dsm.read_bytes()[:3000]),
        ["dsm.tif: cannot be read as a raster"],
    ),
    "map is not there": (options(dom="none.tif"), ["none.tif: no such file"]),
    "map and DSM swapped": (
        swapped,
        ["dom.tif: has 3 bands", "one band of heights", "wrong way round"],
    ),
    "map of another resolution": (
        resolution,
        ["dom.tif: has 1.000 x 1.000 m per pixel", "0.3 m, give or take 15%", "gdalwarp"],
    ),
    "COLMAP model without images": (empty_colmap, ["model: has no image with a pose"]),
    "COLMAP model broken": (
        broken_colmap,
        ["model: not a COLMAP model: rigs, ", "cameras, images", "sparse/0"],
    ),
    "name climbs": (
        options(name="../x"),
        ["--name '../x' cannot be the name of a benchmark", "letters, digits"],
    ),
    "name with slashes": (options(name="a/b"), ["--name 'a/b' cannot be"]),
    "name is empty": (options(name=""), ["--name '' cannot be"]),
    "name without end": (options(name="x" * 60), ["--name 'xxx", "at most 48"]),
    "name of a shipped protocol": (
        options(name="uav-visloc"),
        ["a second protocol uav-visloc-retrieval", "another --name"],
    ),
    "no tiles": (
        options(tile_size=0),
        ["key 'gallery.tile_sizes_px.0' is 0", "greater than or equal to 16"],
    ),
    "threshold without rule": (
        options(iou_above=0.3),
        ["key 'ground_truth': iou_above is given with rule = 'iou', and only then"],
    ),
    "rule without threshold": (
        options(rule="iou"),
        ["iou_above is given with rule = 'iou', and only then"],
    ),
    "impossible threshold": (
        options(rule="iou", iou_above=1.5),
        ["key 'ground_truth.iou_above' is 1.5", "less than 1"],
    ),
    "output is a file": (
        lambda p: {"out": p.poses, "force": ""},
        ["poses.json: is not a benchmark folder, and so is not replaced"],
    ),
    "output exists": (lambda p: {"out": p.images}, ["photos: the folder exists already"]),
    "output would replace the photos": (
        lambda p: {"out": p.images, "force": ""},
        ["photos: is not a benchmark folder, and so is not replaced"],
    ),
    "output would replace all sources": (
        over_the_sources,
        ["the folder to make holds", "which it is made from"],
    ),
    "output below a file": (
        lambda p: {"out": p.poses / "park"},
        ["poses.json: a file, not a folder"],
    ),
}


@pytest.mark.parametrize("case", list(CASES))
def test_bad_sources(
    case: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    change, fragments = CASES[case]
    place = make_place(tmp_path / "sources")
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    monkeypatch.chdir(tmp_path)
    changes = change(place)
    changes = changes if isinstance(changes, dict) else {}
    force = ["--force"] if changes.pop("force", None) is not None else []
    before = files_below(tmp_path)
    assert run_main(*place.arguments(**changes), *force) == 2
    out, message = capfd.readouterr()
    assert out == ""
    assert "Traceback" not in message
    assert "\x1b" not in message
    for fragment in fragments:
        assert fragment in message
    assert "\n  expected: " in message or "\n  fix:      " in message or "no such" in message
    assert files_below(tmp_path) == before


def test_a_map_without_georeference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from rasterio import Affine

    place = make_place(tmp_path)
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    write_raster(place.dom, FLAT, crs=None, transform=Affine.identity())
    assert run_main(*place.arguments()) == 2
    assert "dom.tif: no georeference: no geotransform\n  expected: a raster with a CRS" in (
        capsys.readouterr().err
    )
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("extra", [[], ["--copy"], ["--tiles", "files"]])
def test_stopping_leaves_nothing_half_written(
    extra: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def stop(*arguments: object) -> None:
        raise KeyboardInterrupt

    place = make_place(tmp_path / "sources")
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    monkeypatch.setattr("airzoo_bench.datasets.folder.write_benchmark_file", stop)
    before = files_below(tmp_path / "sources")
    assert run_main(*place.arguments(), *extra) == 130
    assert files_below(tmp_path / "sources") == before
    assert files_below(tmp_path / "data") == set()


def test_camera_to_world_poses_of_oblique_photos_are_noticed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Level, 60 degrees off nadir, to the north from the south of the map; taken the wrong way
    # round it looks to the south, whatever its azimuth was.
    sine, cosine = np.sin(np.radians(60)), np.cos(np.radians(60))
    rotation = np.array([[1, 0, 0], [0, -cosine, -sine], [0, sine, -cosine]])
    place = make_place(tmp_path, {"a.jpg": (128.0, 240.0)})
    place.change_image("a.jpg", R_w2c=rotation.T.tolist())
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    assert run_main(*place.arguments()) == 2
    message = capsys.readouterr().err
    assert "1 photo: the footprint meets no tile" in message
    assert "whether poses are world-to-camera" in message
    place.change_image("a.jpg", R_w2c=rotation.tolist())
    assert run_main(*place.arguments()) == 0
