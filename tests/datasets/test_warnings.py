"""What is suspect in given data is named by its code when it is prepared."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rasterio import Affine

from airzoo_bench.core.progress import silent
from airzoo_bench.datasets.content import make_content
from airzoo_bench.datasets.folder import summary_of
from airzoo_bench.datasets.geometry_checks import scenes_of_benchmark
from airzoo_bench.datasets.scene_warnings import CHECKS, scene_warnings
from airzoo_bench.datasets.surveys.survey import PHOTOS, PhotoOptions
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.results.result import read_result
from tests.datasets.support import LEVEL, NAMES, tag, write_photo
from tests.support import MAP_SIZE_M, NORTH_WEST, Place, run_main, write_raster

Change = Callable[[Place], Any]  # of a sound place; may return options


def moved(place: Place) -> None:
    for name, (x, y) in place.centres.items():
        place.change_image(name, center=[NORTH_WEST[0] + x + 40, NORTH_WEST[1] - y, 200.0])


def in_feet(place: Place) -> None:
    # 20 m are 65.6 ft: the cameras, at 200 m, still are above them.
    write_raster(place.dsm, LEVEL / 5 / 0.3048)
    tagged(NAMES, place, RelativeAltitude=180.0)


def heights(part: Any, value: float, place: Place) -> None:
    changed = LEVEL.copy()
    changed[0][part] = value
    write_raster(place.dsm, changed)


def tagged(names: tuple[str, ...], place: Place, **changes: Any) -> None:
    for name in names:
        tag(place, name, **changes)


def cloud(low: float, high: float, height: float, place: Place) -> dict[str, Any]:
    xy = np.random.default_rng(0).uniform(low, high, (500, 2)) * (1, -1) + NORTH_WEST
    path = place.dsm.with_name("cloud.npy")
    np.save(path, np.column_stack((xy, np.full(500, height))))
    return {"cloud": path}


def map_at(size: tuple[int, int], east: float, south: float, place: Place) -> None:
    grid = Affine(1, 0, NORTH_WEST[0] + east, 0, -1, NORTH_WEST[1] - south)
    write_raster(place.dom, np.full((3, *size), 9, np.uint8), transform=grid)


def camera_to_world(place: Place) -> None:
    sine, cosine = np.sin(np.radians(4)), np.cos(np.radians(4))
    for name in NAMES:
        tag(place, name, GimbalPitchDegree=-86.0)
        place.change_image(name, R_w2c=[[1, 0, 0], [0, -cosine, sine], [0, -sine, -cosine]])


def in_float32(place: Place) -> None:
    for number, (name, image) in enumerate(place.read_poses()["images"].items()):
        x, y, z = (float(np.float32(value + 0.28 + 0.4 * number)) for value in image["center"])
        place.change_image(name, center=[x, y, z])


def copies(place: Place) -> None:
    place.change_image("b.jpg", **place.read_poses()["images"]["a.jpg"])
    tag(place, "b.jpg", like="a.jpg")


# The codes of all warnings about a place, and what makes it suspect.
CASES: dict[str, tuple[str, Change]] = {
    "sound": ("", lambda place: None),
    "moved": ("datum trivial", moved),
    "lowered": ("heights", lambda place: write_raster(place.dsm, LEVEL - 27.5) and None),
    "in feet": ("heights", in_feet),
    "GPS of another datum": ("heights", lambda place: tagged(NAMES, place, up=30.0)),
    "high cloud": ("heights", partial(cloud, 10, 240, 127.5)),
    "zeros": ("surface", partial(heights, slice(20), 0.0)),
    "a hole": ("surface", partial(heights, (slice(2, 4), 3), 0.0)),
    "flat": ("surface", partial(heights, slice(None), 100.0)),
    "a tower": ("below-surface", partial(heights, (slice(54, 74), slice(54, 74)), 300.0)),
    "yaw by 178": ("turned-priors", lambda p: tagged(NAMES[1:3], p, GimbalYawDegree=178.0)),
    "yaw by 90": ("turned-priors", lambda place: tagged(NAMES, place, GimbalYawDegree=90.0)),
    "camera-to-world": ("turned-priors", camera_to_world),
    "map beside": ("map-beside-surface off-map", partial(map_at, (MAP_SIZE_M,) * 2, 180, 0)),
    "cloud beside": ("map-beside-surface", partial(cloud, 300, 400, 100.0)),
    "few tiles": ("trivial", lambda place: {"tile_size": [150]}),
    "small tiles": ("small-tiles", lambda place: {"tile_size": [32]}),
    "small map": ("trivial small-tiles off-map", partial(map_at, (88, 100), 10, 20)),
    "cut surface": ("off-map", lambda p: write_raster(p.dsm, LEVEL[:, :100, :100]) and None),
    "no gimbal": ("no-prior", lambda place: tag(place, "a.jpg", GimbalYawDegree=None)),
    "no metadata": ("no-prior", lambda place: write_photo(place.images / "a.jpg", (64, 48))),
    "in float32": ("float32", in_float32),
    "copies": ("copies", copies),
}


def test_every_code_has_a_case() -> None:
    assert {code for codes, _ in CASES.values() for code in codes.split()} == set(CHECKS)


@pytest.mark.parametrize("case", CASES)
def test_what_is_suspect_is_named(case: Any, place: Place, tmp_path: Path) -> None:
    codes, change = CASES[case]
    options = {"tile_size": [128]} | (change(place) or {})
    chosen = PhotoOptions("park", place.images, place.poses, place.dom, dsm=place.dsm, **options)
    protocols = PHOTOS.benchmark_protocols(chosen, tmp_path)
    facts = make_content(PHOTOS.read(chosen, "park", silent), protocols).facts
    assert facts is not None
    assert {code for code, _ in scene_warnings(facts)} == set(codes.split())


def test_a_missing_surface_model_is_named(place: Place, tmp_path: Path) -> None:
    chosen = PhotoOptions("park", place.images, place.poses, place.dom, plane_height=100.0)
    protocols = PHOTOS.benchmark_protocols(chosen, tmp_path)
    content = make_content(PHOTOS.read(chosen, "park", silent), protocols)
    assert "surface" in summary_of(content, protocols).without_truth["matching"]


def test_positions_that_photos_state_are_not_compared_with_a_local_frame(place, tmp_path) -> None:
    chosen = PhotoOptions("park", place.images, place.poses, place.dom)
    native = replace(PHOTOS.read(chosen, "park", silent), crs=LOCAL_CRS, dom=None)
    facts = make_content(native, PHOTOS.benchmark_protocols(chosen, tmp_path)).facts
    assert facts is not None
    assert facts.gps is None


def test_a_warning_is_printed_and_noted_in_results(place, tmp_path, capsys, monkeypatch) -> None:
    assert run_main(*place.arguments(tile_size=32)) == 0
    warned = re.findall(r"^warning: .*\[([a-z0-9-]+)\]$", capsys.readouterr().err, re.MULTILINE)
    assert warned == ["small-tiles"]
    answers, out = tmp_path / "answers.npz", tmp_path / "out"
    assert run_main("template", "park-retrieval", "--out", answers) == 0
    assert run_main("eval", "retrieval", answers, "--out", out) == 0
    assert any("small-tiles" in note for note in read_result(out / "result.json").notes)
    # A folder of photos does not hide the benchmark of its name in the data root.
    (tmp_path / "beside" / "park").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "beside")
    assert [one.name for one in scenes_of_benchmark(Path("park"))] == ["park"]
