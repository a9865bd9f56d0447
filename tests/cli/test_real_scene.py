"""Every track on the real scene, as a user types it: prepare, baseline, check, eval, table."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.geometry.crs import geodesic_distance_m
from airzoo_bench.results.result import read_result
from airzoo_bench.retrieval.truth import read_truth
from tests.support import run_main


@pytest.fixture(scope="module")
def prepared(brighton: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from airzoo_bench.datasets.settings import PrepareSettings
    from airzoo_bench.datasets.surveys.survey import PHOTOS, PhotoOptions

    root = tmp_path_factory.mktemp("data")
    sources = PhotoOptions(
        "brighton",
        brighton / "images",
        brighton / "poses.json",
        brighton / "dom_10cm.tif",
        dsm=brighton / "dsm_10cm.tif",
        cloud=brighton / "model.laz",
        tile_size=[256, 128],
    )
    PHOTOS.prepare(sources, PrepareSettings(root / "brighton", root))
    return root


def test_every_photo_is_a_query_and_sees_its_own_place(prepared: Path) -> None:
    truth = read_truth(prepared / "brighton" / "scenes" / "brighton", "brighton")
    assert len(truth.queries) == 18
    assert truth.excluded.empty
    # About 35 m above the ground plane, nearly nadir.
    assert truth.queries["altitude_m"].between(30, 45).all()
    assert (truth.queries["pitch_deg"] > 80).all()
    # The tile that overlaps the footprint most lies about its middle: tiles have sides of 26 and
    # 13 m, footprints of some 60 and 30.
    with np.load(
        prepared / "brighton" / "scenes" / "brighton" / "retrieval" / "overlaps.npz"
    ) as overlaps:
        offsets, tiles, ratios = overlaps["offsets"], overlaps["tiles"], overlaps["overlap"]
    best = [tiles[start + ratios[start:stop].argmax()] for start, stop in pairwise(offsets)]
    middles = (truth.boxes[best, :2] + truth.boxes[best, 2:]) / 2
    assert geodesic_distance_m(truth.footprint_centres, middles).max() < 20


def test_the_true_cloud_is_perfect(prepared: Path, brighton: Path, tmp_path: Path) -> None:
    cloud = tmp_path / "brighton.laz"
    cloud.symlink_to(brighton / "model.laz")
    named = ("--protocol", "brighton-reconstruction", "--data", prepared)
    ask = ("eval", "reconstruction", cloud, *named, "--out", tmp_path / "out")
    assert run_main(*ask) == 0
    overall = read_result(tmp_path / "out" / "result.json").overall
    assert overall["f1_1m"] == overall["f1_10m"] == 1.0
