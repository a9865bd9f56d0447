"""Predictions of the retrieval track whose gallery lies in shards."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np

from tests.hostile.inputs.case import Input
from tests.hostile.mutations import spoil_arrays, spoil_bytes, spoil_text

__all__ = ["files"]


def files(
    home: Path, name: str, ids: list[str], described: dict[str, Any], data: str
) -> list[Input]:
    """Predictions in a folder: a shard of Parquet, one of npy, and two of Zarr."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    (home / "gallery").mkdir(parents=True)
    queries = described["query_descriptors"]
    fields = {"protocol": np.array(name), "query_ids": ids, "query_descriptors": queries}
    np.savez(home / "predictions.npz", **fields)
    rows, tiles = described["gallery_descriptors"], described["gallery_ids"]
    lists = pa.FixedSizeListArray.from_arrays(pa.array(rows[:4].ravel()), 3)
    table = pa.table({"id": tiles[:4], "descriptor": lists})
    pq.write_table(table, home / "gallery/0.parquet", row_group_size=3)
    np.save(home / "gallery/1.npy", rows[4:7])
    for number, start, stop in ((1, 4, 7), (2, 7, 9), (3, 9, 11)):
        (home / f"gallery/{number}.txt").write_text("\n".join(tiles[start:stop]))
    _write_zarr(home / "gallery/2.zarr", rows[7:9], 3)
    _write_zarr(home / "gallery/3.zarr", rows[9:], 2)
    read = (("eval", "retrieval", "FOLDER"), ("check", "FOLDER"))
    return [
        Input(f"retrieval/shards {file}", home, file, spoil, read, data, 0.5)
        for file, spoil in (
            ("predictions.npz", spoil_arrays),
            ("gallery/0.parquet", spoil_bytes),
            ("gallery/1.npy", spoil_bytes),
            ("gallery/1.txt", spoil_text),
            ("gallery/2.zarr/zarr.json", spoil_text),
            ("gallery/2.zarr/c/0/0", spoil_bytes),
            ("gallery/3.zarr/.zarray", spoil_text),
            ("gallery/3.zarr/0.0", spoil_bytes),
        )
    ]


def _write_zarr(path: Path, rows: Any, version: int) -> None:
    """Write a chunk of gzip in version 3, of plain numbers in version 2."""
    shape, stated = list(rows.shape), {"zarr_format": version, "shape": list(rows.shape)}
    if version == 2:
        stated |= {"chunks": shape, "dtype": "<f4", "order": "C", "filters": None}
        stated |= {"compressor": None, "fill_value": 0}
        file, key, data = path / ".zarray", path / "0.0", rows.tobytes()
    else:
        stated |= {"data_type": "float32", "node_type": "array", "fill_value": 0}
        stated["chunk_grid"] = {"name": "regular", "configuration": {"chunk_shape": shape}}
        stated["chunk_key_encoding"] = {"name": "default"}
        stated["codecs"] = [{"name": "bytes", "configuration": {"endian": "little"}}]
        stated["codecs"].append({"name": "gzip", "configuration": {"level": 5}})
        file, key, data = path / "zarr.json", path / "c/0/0", gzip.compress(rows.tobytes(), mtime=0)
    key.parent.mkdir(parents=True)
    file.write_text(json.dumps(stated))
    key.write_bytes(data)
