"""Clouds in shards: the same scores as of one file, wherever shards are read, and bad shards."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from airzoo_bench.core.errors import BenchmarkError, PredictionError
from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.formats.clouds.shards import shards_in
from airzoo_bench.reconstruction import scenes
from airzoo_bench.reconstruction.cloud_sources import InMemoryCloud
from airzoo_bench.reconstruction.reading import open_reconstruction
from airzoo_bench.reconstruction.scenes import score_geometry
from airzoo_bench.reconstruction.scoring import ScoredScene
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.true_cloud import open_true_cloud
from tests.formats.cloud_support import LIMIT, SAMPLING, refused
from tests.reconstruction.cloud_support import surface
from tests.reconstruction.shard_support import (
    in_shards,
    opened,
    points_in,
    write_laz,
    write_parquet,
)
from tests.reconstruction.world import ORIGIN, made_truth, protocol


@pytest.mark.parametrize("suffix", [".parquet", ".laz", ".las"])
def test_shards_are_one_cloud(suffix: str, tmp_path: Path) -> None:
    points = np.rint(surface(1000, 0) * 1000.0) * 1e-3
    write = write_parquet if suffix == ".parquet" else write_laz
    cloud = opened(in_shards(tmp_path / "shards", points, 7, write, suffix))
    assert cloud.count == 1000
    np.testing.assert_array_equal(points_in(cloud), points)
    assert [len(piece) for piece in cloud.pieces(300)] == [300, 300, 300, 100]
    assert cloud.kind == f"{suffix.strip('.').upper()} in 7 shards".replace("PARQUET", "Parquet")


def score(predicted: Any, true: Any, used: ReconstructionProtocol) -> ScoredScene:
    resources = Run(memory_bytes=0)
    return score_geometry(predicted, None, made_truth("yard"), true, used, resources)


PREPARATIONS: list[dict[str, Any]] = [
    {"crop": "none", "voxel_m": "none"},
    {"crop": "covered", "voxel_m": "none"},
    {"crop": "box", "voxel_m": 0.1},
    {"crop": "box", "voxel_m": "none", "region": "observed", "observed_cell_m": 2.0},
    {"crop": "covered", "voxel_m": 0.1},
]


@pytest.mark.parametrize("steps", PREPARATIONS)
@pytest.mark.parametrize("block", [300, 1 << 20])
def test_shards_score_what_one_cloud_scores(
    steps: dict[str, Any], block: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scenes, "_LEAST_BLOCK", block)
    first, second = (
        some - 50.0 + ORIGIN for some in (surface(2000, 0, far=0.05), surface(1500, 1))
    )
    first = np.vstack((first, first[::3] + 0.01, first[::7] + 0.003))  # shards share voxels
    first[::50] = np.nan
    used = protocol(alignment={"method": "none", "cameras": "optional"}, preparation=steps)
    whole = score(InMemoryCloud(first), InMemoryCloud(second), used)
    assert (whole.record["thinned"] > 500) == (steps["voxel_m"] == 0.1)
    shards = in_shards(tmp_path / "shards", first, 6, write_parquet, ".parquet")
    write_parquet(shards / "tile-021.parquet", np.zeros((0, 3)))
    truth = in_shards(tmp_path / "truth", second, 4, write_parquet, ".parquet")
    found = score(opened(shards), open_true_cloud(truth, LIMIT, SAMPLING), used)
    assert found.record == whole.record
    assert found.distances is not None
    assert whole.distances is not None
    np.testing.assert_array_equal(found.distances.to_truth, whole.distances.to_truth)
    np.testing.assert_array_equal(found.distances.to_prediction, whole.distances.to_prediction)


def test_an_entry_in_shards(tmp_path: Path) -> None:
    points = surface(100, 0)
    home = tmp_path / "preds"
    in_shards(home / "harbour" / "shards", points, 3, write_parquet, ".parquet")
    write_laz(home / "school.laz", points)
    (home / "harbour" / "notes.txt").write_text("made by hand")
    pack = tmp_path / "preds.zip"
    with zipfile.ZipFile(pack, "w") as archive:
        for path in sorted(home.rglob("*.*")):
            archive.write(path, path.relative_to(home))
    for path in (home, pack):
        listed = open_reconstruction(path, unpacked_limit_bytes=LIMIT)
        assert listed.scenes == ("harbour", "school")
        assert listed.unknown_files == ("harbour/notes.txt",)
        with listed.opened("harbour", limit_bytes=LIMIT, sampling=None) as found:
            assert isinstance(found.geometry, FileCloud)
            np.testing.assert_array_equal(points_in(found.geometry), points)
            assert found.kind == "cloud"


def test_one_scene_in_shards_is_not_stepped_over(tmp_path: Path) -> None:
    in_shards(tmp_path / "p" / "harbour" / "shards", surface(9, 0), 2, write_parquet, ".parquet")
    listed = open_reconstruction(tmp_path / "p", unpacked_limit_bytes=LIMIT)
    assert listed.scenes == ("harbour",)


def test_shards_beside_a_cloud_are_two_entries(tmp_path: Path) -> None:
    in_shards(tmp_path / "harbour" / "shards", surface(9, 0), 2, write_parquet, ".parquet")
    write_laz(tmp_path / "harbour" / "cloud.laz", surface(9, 0))
    with refused("two entries"):
        open_reconstruction(tmp_path, unpacked_limit_bytes=LIMIT)


def test_shards_of_other_scales_are_fine_and_of_another_crs_are_not(tmp_path: Path) -> None:
    points = np.rint(surface(10, 0))
    write_laz(tmp_path / "a.laz", points, crs="EPSG:32633")
    write_laz(tmp_path / "b.laz", points, crs="EPSG:32633", scale=0.5)
    write_laz(tmp_path / "c.laz", points)
    np.testing.assert_array_equal(points_in(opened(tmp_path)), np.tile(points, (3, 1)))
    write_laz(tmp_path / "d.laz", points, crs="EPSG:32632")
    with refused("states another CRS than a.laz") as caught:
        opened(tmp_path)
    assert "d.laz" in str(caught.value)


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def with_nulls(path: Path) -> None:
    write_parquet(path, np.zeros((2, 3)), x=pa.array([1.0, None]))


def without_heights(path: Path) -> None:
    pq.write_table(pa.table({"x": [1.0], "y": [2.0]}), path)


def of_text(path: Path) -> None:
    write_parquet(path, np.zeros((2, 3)), z=["a", "b"])


@pytest.mark.parametrize("suffix", [".parquet", ".laz", ".las"])
@pytest.mark.parametrize("spoil", [truncated, emptied])
def test_a_spoilt_shard_is_named(
    suffix: str, spoil: Callable[[Path], None], tmp_path: Path
) -> None:
    write = write_parquet if suffix == ".parquet" else write_laz
    folder = in_shards(tmp_path / "shards", surface(300, 0), 3, write, suffix)
    spoil(folder / f"tile-01{suffix}")
    with pytest.raises(PredictionError, match=r"tile-01") as caught:
        points_in(opened(folder))
    assert "\n" in str(caught.value)
    with pytest.raises(BenchmarkError, match=r"tile-01.*true cloud cannot be read"):
        open_true_cloud(folder, LIMIT, SAMPLING)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (with_nulls, "has nulls among its coordinates"),
        (without_heights, "has the columns x double, y double"),
        (of_text, "z string"),
    ],
)
def test_parquet_of_other_content(
    spoil: Callable[[Path], None], message: str, tmp_path: Path
) -> None:
    spoil(tmp_path / "a.parquet")
    with refused(message):
        points_in(opened(tmp_path))


@pytest.mark.parametrize(
    ("copy", "says"),
    [
        ("tile-00 (1).laz", "holds what tile-00"),
        ("tile-00.las", "has the name of tile-00.la"),
    ],
)
def test_no_shard_counts_twice(copy: str, says: str, tmp_path: Path) -> None:
    """As a file manager copies a file, and as a converter leaves the original beside its own."""
    folder = in_shards(tmp_path / "shards", surface(300, 0), 2, write_laz, ".laz")
    empty = np.zeros((0, 3))
    for name in ("a.parquet", "b.parquet"):
        write_parquet(folder / name, empty)
    assert opened(folder).count == 300
    if "(1)" in copy:
        (folder / copy).write_bytes((folder / "tile-00.laz").read_bytes())
    else:
        write_laz(folder / copy, surface(150, 0))
    with pytest.raises(PredictionError, match=re.escape(says)):
        opened(folder)


def test_a_shard_that_goes_away_while_the_run_takes(tmp_path: Path) -> None:
    folder = in_shards(tmp_path / "shards", surface(300, 0), 3, write_parquet, ".parquet")
    cloud = opened(folder)
    (folder / "tile-02.parquet").unlink()
    with refused("is not there any more") as caught:
        points_in(cloud)
    assert "tile-02" in str(caught.value)


def test_a_folder_without_shards(tmp_path: Path) -> None:
    (tmp_path / "readme.md").write_text("none")
    with refused("holds no shard"):
        shards_in(tmp_path)
