"""Retrieval on workers of Dask: the records of one process, byte for byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.engines.cluster import local_cluster
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.retrieval import descriptor_search
from tests.retrieval.gallery_files import KINDS, write_folder
from tests.support import run_main


@pytest.mark.parametrize("workers", [1, 2])
def test_records_are_the_same_bytes(
    workers: int, shard_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(descriptor_search, "_SHARD_BYTES", 1 << 9)  # 16 rows
    folders = {
        kind: write_folder(tmp_path / kind, KINDS[kind]) for kind in ("npy", "parquet", "zarr 3")
    }
    expected = evaluate(folders["npy"], data=shard_data).records.to_csv()
    with local_cluster(workers, 1 << 30) as engine:
        for folder in folders.values():
            found = evaluate(folder, data=shard_data, resources=Resources(engine=engine))
            assert found.records.to_csv() == expected


def test_a_shard_cut_off_on_a_worker_is_one_message(
    shard_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "folder", KINDS["zarr 3"])
    chunk = folder / "gallery/001.zarr/c/1/0"
    chunk.write_bytes(chunk.read_bytes()[:-9])
    out = tmp_path / "out"
    arguments = ("--data", shard_data, "--out", out, "--engine", "dask", "--jobs", "1")
    assert run_main("eval", "retrieval", folder, *arguments) == 2
    said = capsys.readouterr().err
    assert "001.zarr/c/1/0: the chunk is damaged or cut off" in said.replace("\n", "")
    assert "Traceback" not in said
    assert not out.exists()


def test_nan_in_a_shard_is_named_as_in_one_piece(shard_data: Path, tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "folder", KINDS["npy"])
    rows = np.load(folder / "gallery/001.npy")
    rows[7] = np.nan
    np.save(folder / "gallery/001.npy", rows)
    with local_cluster(1, 1 << 30) as engine:
        for resources in (Resources(), Resources(engine=engine)):
            with pytest.raises(Exception, match=r"1 of 50 \(a/t00027\)"):
                evaluate(folder, data=shard_data, resources=resources)
