"""Benchmark folders: made by hand, the same bytes again, files of tiles and crops, true clouds."""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import tomli_w

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.datasets.settings import Prepared, PrepareSettings
from airzoo_bench.datasets.surveys.survey import PHOTOS, PhotoOptions
from airzoo_bench.formats.clouds.las import shards_in
from airzoo_bench.geometry.crs import to_lonlat
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from tests.datasets.support import NAMES, hold_crops, hold_tiles, tag
from tests.reconstruction.world import write_laz
from tests.support import (
    NORTH_WEST,
    PLACE_CRS,
    PLACE_PHOTOS,
    Place,
    made_once,
    make_place,
    run_main,
)

PAGE = Path(__file__).parents[2] / "docs" / "benchmark-folder.md"


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A complete folder with all tracks but reconstruction, tiles and crops as files."""

    def make(home: Path) -> None:
        place = make_place(home / "source")
        for name in NAMES:
            tag(place, name)
        more = ("--out", home / "park", "--tiles", "files", "--crops", "files")
        assert run_main(*place.arguments(tile_size=128), *more) == 0

    return made_once(tmp_path_factory, "handmade", make) / "park"


@pytest.fixture
def folder(prepared: Path, tmp_path: Path) -> Path:
    """A copy of the folder, which a test may change."""
    return Path(shutil.copytree(prepared, tmp_path / "park"))


def strip(folder: Path, *without: str) -> bytes:
    """Take entries from benchmark.toml; return what is left."""
    path = folder / "benchmark.toml"
    values = tomllib.loads(path.read_text())
    kept = {key: value for key, value in values.items() if key not in without}
    for scene in kept["scenes"]:
        scene.pop("dsm_sha256", None)
    path.write_text(tomli_w.dumps(kept))
    return path.read_bytes()


def test_missing_entries_are_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / "benchmark.toml").read_text()
    strip(folder, "schema", "name", "version", "title", "tracks", "checksums")
    assert run_main("manifest", folder) == 0
    assert "dsm_sha256 of scene park" in capsys.readouterr().err
    after = tomllib.loads((folder / "benchmark.toml").read_text())
    assert after == tomllib.loads(before) | {"by_hand": True}
    assert Benchmark.open(folder).name == "park"


def test_a_folder_that_eval_refuses_gets_no_checksums(folder: Path) -> None:
    """For reasons in tests/goldens/refusals.txt, and this one."""
    before = strip(folder, "checksums")
    shutil.rmtree(folder / "scenes" / "park" / "matching")
    assert run_main("manifest", folder) == 2
    assert (folder / "benchmark.toml").read_bytes() == before


def test_the_page_names_every_column(prepared: Path) -> None:
    named = set(re.findall(r"`([A-Za-z0-9_]+)`", PAGE.read_text()))
    readers: dict[str, Callable[[Path], Any]] = {
        ".csv": pd.read_csv,
        ".parquet": pd.read_parquet,
        ".npz": lambda path: [*np.load(path)],
    }
    files = [path for path in (prepared / "scenes").rglob("*") if path.suffix in readers]
    columns = [column for path in files for column in readers[path.suffix](path)]
    assert len(columns) > 100
    assert set(columns) <= named


# --- own photos ---


def prepare_place(
    place: Place, folder: Path, cloud: Path | None = None, **options: Any
) -> Prepared:
    """Prepare a place with tiles of 64 px, 50 % overlap."""
    sources = (place.images, place.poses, place.dom)
    chosen = PhotoOptions("park", *sources, dsm=place.dsm, tile_size=[64], cloud=cloud)
    return PHOTOS.prepare(chosen, PrepareSettings(folder, folder.parent, **options))


def test_the_same_sources_give_the_same_bytes_and_copies_travel(tmp_path: Path) -> None:
    place = make_place(tmp_path / "sources")
    for name in ("one", "two"):
        prepare_place(place, tmp_path / name, copy=True, tiles_on_disk=True)
    assert sha256_of_tree(tmp_path / "one") == sha256_of_tree(tmp_path / "two")
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
            prepare_place(place, tmp_path / "park", cloud)
        assert not (tmp_path / "park").exists()
        np.save(cloud, points)
    result = prepare_place(place, tmp_path / "park", cloud, copy=True)
    assert "park-reconstruction" in result.protocols
    truth = read_reconstruction(Benchmark.open(tmp_path / "park"), "park")
    assert len(truth.photos) == 4
    if shards:
        assert shards_in(truth.cloud) == [truth.cloud / f"{number}.laz" for number in range(3)]
    else:
        assert truth.cloud.read_bytes() == cloud.read_bytes()
