"""Galleries written in shards, of every kind of file."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.support import MadeScene, write_predictions

zarr = pytest.importorskip("zarr")

SCENES = [MadeScene("a", [[0], [3, 4], [49]], 50), MadeScene("b", [[7], [8]], 31)]
TILES = [tile for scene in SCENES for tile in scene.tile_ids]
QUERIES = [query for scene in SCENES for query in scene.query_ids]
CUTS = [0, 20, 50, 51, 81]  # within scenes, at the end of one, of one tile

Write = Callable[[Path, np.ndarray, list[str]], None]


def write_npy(stem: Path, rows: np.ndarray, ids: list[str]) -> None:
    np.save(stem.with_suffix(".npy"), rows)
    stem.with_suffix(".txt").write_text("".join(f"{one}\n" for one in ids))


def write_npy_and_table(stem: Path, rows: np.ndarray, ids: list[str]) -> None:
    np.save(stem.with_suffix(".npy"), rows)
    pq.write_table(pa.table({"id": ids}), stem.with_suffix(".ids.parquet"))


def write_parquet(stem: Path, rows: np.ndarray, ids: list[str], **options: Any) -> None:
    lists = pa.FixedSizeListArray.from_arrays(pa.array(rows.ravel()), rows.shape[1])
    table = pa.table({"id": ids, "descriptor": lists})
    pq.write_table(table, stem.with_suffix(".parquet"), **{"row_group_size": 7} | options)


def zarr_writer(**options: Any) -> Write:
    def write(stem: Path, rows: np.ndarray, ids: list[str]) -> None:
        stem.with_suffix(".txt").write_text("\n".join(ids))
        array = zarr.create_array(
            str(stem.with_suffix(".zarr")),
            shape=rows.shape,
            dtype=rows.dtype,
            **{"chunks": (6, rows.shape[1])} | options,
        )
        array[:] = rows

    return write


KINDS: dict[str, Write] = {
    "npy": write_npy,
    "npy and table": write_npy_and_table,
    "parquet": write_parquet,
    "parquet of lists": lambda stem, rows, ids: pq.write_table(
        pa.table({"descriptor": list(rows), "id": ids}), stem.with_suffix(".parquet")
    ),
    "zarr 3": zarr_writer(),
    "zarr 3 in columns": zarr_writer(chunks=(6, 5)),
    "zarr 3 plain": zarr_writer(compressors=None),
    "zarr 3 gzip": zarr_writer(compressors=zarr.codecs.GzipCodec()),
    "zarr 3 blosc": zarr_writer(compressors=zarr.codecs.BloscCodec()),
    "zarr 2": zarr_writer(zarr_format=2),
    "zarr 2 nested": zarr_writer(
        zarr_format=2, chunk_key_encoding={"name": "v2", "separator": "/"}
    ),
}


def descriptors(dtype: str = "f4") -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.standard_normal((5, 8)).astype(dtype), rng.standard_normal((81, 8)).astype(dtype)


def write_folder(path: Path, write: Write, dtype: str = "f4") -> Path:
    queries, gallery = descriptors(dtype)
    (path / "gallery").mkdir(parents=True)
    write_predictions(
        path / "predictions.npz", "made-retrieval", query_ids=QUERIES, query_descriptors=queries
    )
    for number, (start, stop) in enumerate(pairwise(CUTS)):
        write(path / "gallery" / f"{number:03d}", gallery[start:stop], TILES[start:stop])
    return path
