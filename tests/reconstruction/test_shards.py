"""Clouds in shards: the same scores as of one file, wherever shards are read."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

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
from tests.reconstruction.shard_support import in_shards, opened, points_in, write_laz
from tests.reconstruction.world import ORIGIN, made_truth, protocol


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
    used = protocol(alignment={"method": "none", "cameras": "optional"}, preparation=steps)
    shards = in_shards(tmp_path / "shards", first, 6, write_laz, ".laz")
    write_laz(shards / "tile-021.laz", np.zeros((0, 3)))
    truth = in_shards(tmp_path / "truth", second, 4, write_laz, ".laz")
    whole = score(
        InMemoryCloud(points_in(opened(shards))), InMemoryCloud(points_in(opened(truth))), used
    )
    assert (whole.record["thinned"] > 500) == (steps["voxel_m"] == 0.1)
    found = score(opened(shards), open_true_cloud(truth, LIMIT, SAMPLING), used)
    assert found.record == whole.record
    assert found.distances is not None
    assert whole.distances is not None
    np.testing.assert_array_equal(found.distances.to_truth, whole.distances.to_truth)
    np.testing.assert_array_equal(found.distances.to_prediction, whole.distances.to_prediction)


def test_an_entry_in_shards(tmp_path: Path) -> None:
    points = np.rint(surface(100, 0))
    home = tmp_path / "preds"
    in_shards(home / "harbour" / "shards", points, 3, write_laz, ".laz")
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
            np.testing.assert_allclose(points_in(found.geometry), points, atol=1e-6)
            assert found.kind == "cloud"


def test_one_scene_in_shards_is_not_stepped_over(tmp_path: Path) -> None:
    in_shards(tmp_path / "p" / "harbour" / "shards", surface(9, 0), 2, write_laz, ".laz")
    listed = open_reconstruction(tmp_path / "p", unpacked_limit_bytes=LIMIT)
    assert listed.scenes == ("harbour",)


def test_shards_beside_a_cloud_are_two_entries(tmp_path: Path) -> None:
    in_shards(tmp_path / "harbour" / "shards", surface(9, 0), 2, write_laz, ".laz")
    write_laz(tmp_path / "harbour" / "cloud.laz", surface(9, 0))
    with refused("two entries"):
        open_reconstruction(tmp_path, unpacked_limit_bytes=LIMIT)


def test_a_folder_without_shards(tmp_path: Path) -> None:
    (tmp_path / "readme.md").write_text("none")
    with refused("holds no shard"):
        shards_in(tmp_path)
