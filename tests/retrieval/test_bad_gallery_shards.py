"""Shards of a gallery that are faulty, change, or unpack to more than they should."""

from __future__ import annotations

import json
import shutil
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.formats.budget import Budget
from airzoo_bench.formats.zarr import ZarrMatrix
from airzoo_bench.retrieval.descriptor_files import ParquetRows, ZarrRows
from tests.retrieval.gallery_files import (
    KINDS,
    TILES,
    write_folder,
    write_npy,
    write_parquet,
    zarr_writer,
)
from tests.support import run_main


def refusal(folder: Path, data: Path) -> str:
    with pytest.raises(PredictionError) as caught:
        evaluate(folder, data=data)
    return str(caught.value)


def double_column(path: Path) -> None:
    table = pq.read_table(path)
    pq.write_table(table.append_column("descriptor", table["descriptor"]), path)


def cut_file(path: Path, at: float = 0.6) -> None:
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * at)])


@pytest.mark.parametrize(
    ("kind", "spoil", "where", "says"),
    [
        ("npy", lambda g: cut_file(g / "001.npy"), "001.npy", "bytes are not"),
        ("parquet", lambda g: double_column(g / "001.parquet"), "001.parquet", "has 2 columns"),
        ("npy", lambda g: (g / "001.npy").unlink(), "001.txt", "a shard that is missing"),
        ("npy", lambda g: (g / "002.txt").unlink(), "002.npy", "no file of ids"),
        ("npy", lambda g: cut_file(g / "000.txt", 0.5), "000.npy", "20 rows, and 000.txt 10 ids"),
        ("npy", lambda g: (g / "x.bin").touch(), "x.bin", "is no shard"),
        ("npy", lambda g: np.save(g / "001.npy", np.ones((30, 7), "f4")), "001.npy", "7 numbers"),
        ("npy", lambda g: np.save(g / "001.npy", np.ones((30, 8), "f8")), "001.npy", "float64"),
        ("npy", lambda g: np.save(g / "001.npy", np.ones(30, "f4")), "001.npy", r"shape (30,)"),
        ("npy", lambda g: np.save(g / "001.npy", np.ones((30, 8), "i4")), "001.npy", "<i4 data"),
        ("npy", lambda g: shutil.copy(g / "000.txt", g / "000.npy"), "000.npy", "no array"),
        (
            "npy",
            lambda g: np.save(g / "001.npy", np.array([[{}]], dtype=object)),
            "001.npy",
            "pickled Python objects, never loaded",
        ),
        (
            "npy",
            lambda g: (g / "003.txt").write_text("\n".join([TILES[3], *TILES[52:]])),
            "003.npy",
            "describes 1 tile that 000.npy describes too: 1 (a/t00003)",
        ),
        ("parquet", lambda g: cut_file(g / "001.parquet"), "001.parquet", "not a readable"),
        (
            "parquet",
            lambda g: pq.write_table(pa.table({"id": TILES[20:50]}), g / "001.parquet"),
            "001.parquet",
            "column 'descriptor' is not there",
        ),
        (
            "parquet",
            lambda g: pq.write_table(
                pa.table({"id": TILES[20:50], "descriptor": [[1.0] * 8] * 29 + [[1.0] * 9]}),
                g / "001.parquet",
            ),
            "001.parquet",
            "lists of several lengths",
        ),
        (
            "parquet",
            lambda g: pq.write_table(
                pa.table(
                    {
                        "id": TILES[20:50],
                        "descriptor": pa.array(
                            [[1.0] * 8] * 28 + [[1.0] * 7] + [[1.0] * 9], pa.list_(pa.float32())
                        ),
                    }
                ),
                g / "001.parquet",
            ),
            "001.parquet",
            "lists of 7 to 9 numbers",
        ),
        (
            "zarr 3",
            lambda g: cut_file(g / "001.zarr" / "c/2/0"),
            "001.zarr/c/2/0",
            "damaged or cut",
        ),
        ("zarr 3 plain", lambda g: cut_file(g / "001.zarr/c/2/0"), "001.zarr/c/2/0", "holds 115"),
        (
            "zarr 3 blosc",
            lambda g: cut_file(g / "001.zarr/c/2/0"),
            "001.zarr/c/2/0",
            "another size",
        ),
        ("zarr 3", lambda g: (g / "001.zarr/c/2/0").unlink(), "001.zarr/c/2/0", "is missing"),
        ("zarr 3", lambda g: cut_file(g / "001.zarr/zarr.json"), "zarr.json", "not understood"),
        ("zarr 3", lambda g: shutil.rmtree(g / "001.zarr"), "001.txt", "a shard that is missing"),
        ("zarr 3", lambda g: shutil.rmtree(g), "gallery", "has 0 shards"),
    ],
)
def test_a_faulty_shard_is_named(
    kind: str,
    spoil: Callable[[Path], Any],
    where: str,
    says: str,
    shard_data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = write_folder(tmp_path / "folder", KINDS[kind])
    spoil(folder / "gallery")
    said = refusal(folder, shard_data)
    assert f"{where}: " in said.splitlines()[0]
    assert says in said.splitlines()[0]
    out = tmp_path / "out"
    assert run_main("eval", "retrieval", folder, "--data", shard_data, "--out", out) == 2
    assert not out.exists()
    assert "Traceback" not in capsys.readouterr().err


def test_the_gallery_has_one_place(shard_data: Path, tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "folder", write_npy)
    fields = dict(np.load(folder / "predictions.npz"))
    np.savez(folder / "predictions.npz", **fields, gallery_ids=np.array(TILES))
    assert "has gallery_ids, and there are shards too" in refusal(folder, shard_data)


@pytest.fixture
def traced() -> Iterator[Any]:
    tracemalloc.start()
    yield tracemalloc
    tracemalloc.stop()


@pytest.mark.parametrize("codec", ["zstd", "gzip", "zlib", "blosc"])
def test_a_chunk_never_unpacks_to_more_than_it_should(
    codec: str, traced: Any, tmp_path: Path
) -> None:
    import numcodecs

    bomb = bytes(1 << 26)
    packed = {
        "zstd": numcodecs.Zstd(),
        "gzip": numcodecs.GZip(),
        "zlib": numcodecs.Zlib(),
        "blosc": numcodecs.Blosc(),
    }[codec].encode(bomb)
    stated = {"shape": [4, 8], "chunks": [4, 8], "dtype": "<f4", "order": "C", "filters": None}
    (tmp_path / ".zarray").write_text(json.dumps(stated | {"compressor": {"id": codec}}))
    (tmp_path / "0.0").write_bytes(packed)
    rows = ZarrRows.open(tmp_path, Budget(1 << 30))
    traced.reset_peak()
    held = traced.get_traced_memory()[0]
    with pytest.raises(PredictionError, match="chunk is damaged"):
        rows.read(0, 4)
    assert traced.get_traced_memory()[1] - held < 1 << 22


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"chunks": [1 << 40, 8]}, "a band of chunks"),
        ({"chunks": [4, 1 << 47]}, "a band of chunks"),
        ({"chunks": [0, 8]}, "in chunks of"),
        ({"shape": [4, 8, 2]}, "shape"),
        ({"shape": [-4, 8]}, "shape"),
        ({"shape": [4.0, 8]}, "shape"),
        ({"dtype": "|O"}, "values of type"),
        ({"dtype": [["a", "<f4"]]}, "values of type"),
        ({"filters": [{"id": "pickle"}]}, "filters"),
        ({"order": "F"}, "columns first"),
        ({"compressor": {"id": "pickle"}}, "codec pickle"),
        ({"compressor": 3}, "not understood"),
        ({"dimension_separator": "/../../"}, "unknown names of chunks"),
    ],
)
def test_metadata_are_settled_before_a_chunk_is_opened(
    change: dict[str, Any], says: str, tmp_path: Path
) -> None:
    stated = {"shape": [4, 8], "chunks": [4, 8], "dtype": "<f4", "order": "C", "compressor": None}
    (tmp_path / ".zarray").write_text(json.dumps(stated | change))
    with pytest.raises(PredictionError, match=says):
        ZarrMatrix.open(tmp_path, Budget(1 << 30))


@pytest.mark.parametrize("kind", ["parquet", "zarr"])
def test_rows_are_read_in_bounded_memory(kind: str, traced: Any, tmp_path: Path) -> None:
    rows = np.random.default_rng(0).random((120_000, 64), np.float32)
    if kind == "parquet":
        write_parquet(tmp_path / "x", rows, ["a"] * len(rows), row_group_size=60_000)
        source: Any = ParquetRows.open(tmp_path / "x.parquet", Budget(1 << 28))
    else:
        zarr_writer(chunks=(4_000, 64))(tmp_path / "x", rows, ["a"])
        source = ZarrRows.open(tmp_path / "x.zarr", Budget(1 << 28))
    pool = pa.default_memory_pool()
    before, most = pool.bytes_allocated(), 0
    traced.reset_peak()
    held = traced.get_traced_memory()[0]
    for start, block in source.part(100, 119_000).blocks(999):
        assert np.array_equal(block, rows[100 + start : 100 + start + len(block)])
        most = max(most, pool.bytes_allocated() - before)
    # However large a row group is: 15 MB here.
    assert most < 9_000_000
    assert traced.get_traced_memory()[1] - held < 7_000_000
    runs = [(3, 5), (59_999, 60_002), (119_998, 120_000)]
    for (start, stop), found in zip(runs, source.runs(runs), strict=True):
        assert np.array_equal(found, rows[start:stop])


def test_a_row_group_beyond_the_memory_is_refused(tmp_path: Path) -> None:
    rows = np.ones((3_000, 64), np.float32)
    write_parquet(tmp_path / "x", rows, ["a"] * len(rows), row_group_size=3_000)
    with pytest.raises(PredictionError, match=r"a row group of column 'descriptor'") as caught:
        ParquetRows.open(tmp_path / "x.parquet", Budget(rows.nbytes // 2))
    assert "row_group_size" in str(caught.value)
