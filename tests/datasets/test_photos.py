"""`prepare photos` with good sources: what the folder holds, and that it can be scored."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.datasets.settings import Prepared, PrepareSettings
from airzoo_bench.datasets.surveys.survey import PHOTOS, PhotoOptions
from airzoo_bench.formats.clouds.las import shards_in
from airzoo_bench.geometry.crs import to_lonlat
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from tests.datasets.parts import hold_crops, hold_tiles
from tests.reconstruction.support import write_laz
from tests.support import (
    NORTH_WEST,
    PLACE_CRS,
    PLACE_PHOTOS,
    Place,
    files_below,
    make_place,
    run_main,
)


def prepared(place: Place, folder: Path, **options: Any) -> Prepared:
    """Prepare a place with tiles of 64 px, 50 % overlap."""
    own = ("crs", "rule", "iou_above", "cloud")
    given = {name: options.pop(name) for name in own if name in options}
    sources = (place.images, place.poses, place.dom)
    chosen = PhotoOptions("park", *sources, dsm=place.dsm, tile_size=[64], **given)
    return PHOTOS.prepare(chosen, PrepareSettings(folder, folder.parent, **options))


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


def test_a_true_cloud_of_another_frame_is_refused(tmp_path: Path) -> None:
    place = make_place(tmp_path)
    cloud = tmp_path / "cloud.npy"
    np.save(cloud, np.random.default_rng(0).uniform(0, 100, (50, 3)))
    with pytest.raises(BenchmarkError, match="do not look at it"):
        prepared(place, tmp_path / "park", cloud=cloud)
    assert not (tmp_path / "park").exists()


@pytest.mark.parametrize("shards", [0, 3])
def test_a_true_cloud_makes_truth_for_reconstruction(shards: int, tmp_path: Path) -> None:
    place = make_place(tmp_path)
    images = json.loads(place.poses.read_text())["images"].values()
    centre = np.array([image["center"] for image in images]).mean(axis=0)
    points = np.random.default_rng(0).uniform(-50, 50, (50, 3)) + centre
    cloud = tmp_path / ("tiles" if shards else "cloud.npy")
    if shards:
        cloud.mkdir()
        for number, part in enumerate(np.array_split(points, shards)):
            write_laz(cloud / f"{number}.laz", part)
    else:
        np.save(cloud, points)
    result = prepared(place, tmp_path / "park", cloud=cloud, copy=True)
    assert "park-reconstruction" in result.protocols
    truth = read_reconstruction(Benchmark.open(tmp_path / "park"), "park")
    assert len(truth.photos) == 4
    if shards:
        assert shards_in(truth.cloud) == [truth.cloud / f"{number}.laz" for number in range(3)]
    else:
        assert truth.cloud.read_bytes() == cloud.read_bytes()
