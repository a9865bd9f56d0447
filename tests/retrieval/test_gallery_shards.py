"""Predictions whose gallery lies in shards score as the one file of the same descriptors."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.engines.engine import Here
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.retrieval.reading import read_retrieval
from tests.retrieval.engine_support import Shuffled
from tests.retrieval.gallery_files import (
    KINDS,
    QUERIES,
    TILES,
    descriptors,
    write_folder,
    write_npy,
    write_parquet,
)
from tests.support import run_main, write_predictions


@pytest.mark.parametrize("dtype", ["f2", "f4", "f8"])
@pytest.mark.parametrize("kind", KINDS)
def test_shards_score_as_one_file(kind: str, dtype: str, shard_data: Path, tmp_path: Path) -> None:
    queries, gallery = descriptors(dtype)
    whole = write_predictions(
        tmp_path / "whole.npz",
        "made-retrieval",
        query_ids=QUERIES,
        query_descriptors=queries,
        gallery_ids=TILES,
        gallery_descriptors=gallery,
    )
    folder = write_folder(tmp_path / "folder", KINDS[kind], dtype)
    expected = evaluate(whole, data=shard_data)
    for resources in (Resources(), Resources(engine=Shuffled(11))):
        found = evaluate(folder, data=shard_data, resources=resources)
        pd.testing.assert_frame_equal(found.records, expected.records)


def test_the_command_line_takes_a_folder(shard_data: Path, tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "folder", write_parquet)
    assert run_main("check", folder, "--data", shard_data) == 0
    out = tmp_path / "out"
    assert run_main("eval", "retrieval", folder, "--data", shard_data, "--out", out) == 0
    assert json.loads((out / "result.json").read_text())["predictions"]["kind"] == "descriptors"


class Careless(Here):
    """Somebody copies other descriptors into the folder while the run goes on."""

    def __init__(self, shard: Path) -> None:
        self.shard, self.forgotten = shard, False

    def begin(self, run: str) -> None:
        rows = np.load(self.shard)
        np.save(self.shard, rows[::-1])
        os.utime(self.shard, ns=(0, 0))  # whatever the clock's resolution

    def forget(self) -> None:
        self.forgotten = True


def test_no_result_is_made_of_predictions_that_change(shard_data: Path, tmp_path: Path) -> None:
    """Its checksum would be that of other descriptors than those that were scored."""
    folder = write_folder(tmp_path / "folder", write_npy)
    engine = Careless(folder / "gallery" / "001.npy")
    with pytest.raises(PredictionError, match="changed while it was scored") as caught:
        evaluate(folder, data=shard_data, resources=Resources(engine=engine))
    assert "001.npy" in str(caught.value)
    assert engine.forgotten


def linked(folder: Path) -> Path:
    """Put the gallery elsewhere, as on a disk for large files, and a link in its place."""
    store = folder.with_name(f"{folder.name}-store")
    (folder / "gallery").rename(store)
    (folder / "gallery").symlink_to(store, target_is_directory=True)
    return folder


def test_a_gallery_behind_a_link_is_held_to_its_checksum(shard_data: Path, tmp_path: Path) -> None:
    """Else a run would be resumed with finished tasks of other descriptors."""
    plain = write_folder(tmp_path / "plain", write_npy)
    folder = linked(write_folder(tmp_path / "folder", write_npy))
    shard, runs, sums = folder / "gallery" / "001.npy", [], []
    for turn in (1, -1):
        np.save(shard, np.load(shard)[::turn])
        engine = Named()
        found = evaluate(folder, data=shard_data, resources=Resources(engine=engine))
        runs.append(engine.run)
        sums.append(found.result.predictions.sha256)
    assert runs[0] != runs[1]
    assert sums[0] == evaluate(plain, data=shard_data).result.predictions.sha256 != sums[1]


def test_a_gallery_behind_a_link_must_not_change_either(shard_data: Path, tmp_path: Path) -> None:
    folder = linked(write_folder(tmp_path / "folder", write_npy))
    engine = Careless(folder / "gallery" / "001.npy")
    with pytest.raises(PredictionError, match="changed while it was scored"):
        evaluate(folder, data=shard_data, resources=Resources(engine=engine))


class Named(Here):
    """Tells which run it was told to be of."""

    def begin(self, run: str) -> None:
        self.run = run


def test_a_run_with_other_memory_is_another_run(shard_data: Path, tmp_path: Path) -> None:
    """Queries are cut by it, so that a finished task may be of other queries."""
    folder = write_folder(tmp_path / "folder", write_npy)

    def run(memory_bytes: int) -> str:
        engine = Named()
        evaluate(folder, data=shard_data, resources=Resources(memory_bytes, engine=engine))
        return engine.run

    assert run(1 << 30) == run(1 << 30) != run(1 << 29)


def test_ids_of_all_shards_count_together(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "folder", write_npy)
    read_retrieval(folder, 1 << 16)
    with pytest.raises(PredictionError, match="besides"):
        read_retrieval(folder, 1 << 12)
