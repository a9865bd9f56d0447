"""`prepare photos` with good sources: what the folder holds, and that it can be scored."""

from __future__ import annotations

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
from tests.support import NORTH_WEST, PLACE_CRS, PLACE_PHOTOS, Place, make_place, run_main


def prepared(place: Place, folder: Path, cloud: Path | None = None, **options: Any) -> Prepared:
    """Prepare a place with tiles of 64 px, 50 % overlap."""
    sources = (place.images, place.poses, place.dom)
    chosen = PhotoOptions("park", *sources, dsm=place.dsm, tile_size=[64], cloud=cloud)
    return PHOTOS.prepare(chosen, PrepareSettings(folder, folder.parent, **options))


def files_of(folder: Path) -> dict[str, bytes]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def test_the_same_sources_give_the_same_bytes_and_copies_travel(tmp_path: Path) -> None:
    place = make_place(tmp_path / "sources")
    for name in ("one", "two"):
        prepared(place, tmp_path / name, copy=True, tiles_on_disk=True)
    assert files_of(tmp_path / "one") == files_of(tmp_path / "two")
    (tmp_path / "one").rename(tmp_path / "moved")
    benchmark = Benchmark.open(tmp_path / "moved")
    scene = benchmark.scene("park")
    for name in place.centres:
        copied = benchmark.resolve(scene.images) / name
        assert copied.read_bytes() == (place.images / name).read_bytes()
    assert scene.dsm is not None
    for kept, source in ((scene.dom, place.dom), (scene.dsm, place.dsm)):
        assert benchmark.resolve(kept).read_bytes() == source.read_bytes()
    assert str(tmp_path) not in (tmp_path / "moved" / "benchmark.toml").read_text()


def test_tiles_and_crops_as_files_are_those_of_the_maps(tmp_path: Path) -> None:
    # Two names that differ by a slash only are two crops.
    place = make_place(tmp_path, {**PLACE_PHOTOS, "sub_d.jpg": (180.0, 180.0)})
    centres = np.array([*place.centres.values()]) * (1, -1) + NORTH_WEST + (2, -3)
    places = zip(place.centres, to_lonlat(PLACE_CRS, centres).tolist(), strict=True)
    rows = [f"{name},{lon},{lat},199,3,-88,0" for name, (lon, lat) in places]
    head = "image,lon,lat,altitude_m,yaw_deg,pitch_deg,roll_deg"
    (tmp_path / "priors.csv").write_text("\n".join([head, *rows]))
    out = tmp_path / "park"
    given = place.arguments(
        priors=tmp_path / "priors.csv", crops="files", tiles="files", tile_size=128, out=out
    )
    assert run_main(*given) == 0
    scene, home = load_benchmark(out).scenes[0], out / "scenes" / "park"
    assert len(scene.tiles()) == 9
    hold_tiles(home, scene)
    assert len(scene.crops()) == 5
    hold_crops(home, scene)


@pytest.mark.parametrize("shards", [0, 3])
def test_a_true_cloud_makes_truth_for_reconstruction(shards: int, tmp_path: Path) -> None:
    place = make_place(tmp_path)
    centre = np.mean([image["center"] for image in place.read_poses()["images"].values()], axis=0)
    points = np.random.default_rng(0).uniform(-50, 50, (50, 3)) + centre
    cloud = tmp_path / ("tiles" if shards else "cloud.npy")
    if shards:
        cloud.mkdir()
        for number, part in enumerate(np.array_split(points, shards)):
            write_laz(cloud / f"{number}.laz", part)
    else:
        np.save(cloud, points - centre)
        with pytest.raises(BenchmarkError, match="do not look at it"):
            prepared(place, tmp_path / "park", cloud)
        assert not (tmp_path / "park").exists()
        np.save(cloud, points)
    result = prepared(place, tmp_path / "park", cloud, copy=True)
    assert "park-reconstruction" in result.protocols
    truth = read_reconstruction(Benchmark.open(tmp_path / "park"), "park")
    assert len(truth.photos) == 4
    if shards:
        assert shards_in(truth.cloud) == [truth.cloud / f"{number}.laz" for number in range(3)]
    else:
        assert truth.cloud.read_bytes() == cloud.read_bytes()
