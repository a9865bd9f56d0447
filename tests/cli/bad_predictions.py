"""Prediction files of the retrieval track, spoilt on purpose."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Arrays = dict[str, Any]
Make = Callable[[Path, Arrays], object]


def changed(**changes: Any) -> Make:
    """Make predictions with some fields changed; a field is left out where None."""

    def make(path: Path, arrays: Arrays) -> None:
        fields = {"protocol": "made-retrieval"} | arrays | changes
        np.savez(path, **{k: np.array(v) for k, v in fields.items() if v is not None})

    return make


def edited(field: str, edit: Callable[[Any], Any]) -> Make:
    """Make predictions with one field edited in place, or replaced by what `edit` returns."""

    def make(path: Path, arrays: Arrays) -> None:
        array = np.array(arrays[field])
        array = array.astype("<U60") if array.dtype.kind == "U" else array
        result = edit(array)
        changed(**{field: array if result is None else result})(path, arrays)

    return make


def described(**changes: Any) -> Make:
    """Make predictions by descriptors, with some fields changed."""

    def make(path: Path, arrays: Arrays) -> None:
        fields = {
            "query_ids": arrays["query_ids"],
            "ranked_ids": None,
            "query_descriptors": np.eye(10, 8, dtype=np.float32),
            "gallery_ids": arrays["gallery_ids"],
            "gallery_descriptors": np.ones((20, 8), np.float32),
        }
        changed(**(fields | changes))(path, {})

    return make


def with_nan(rows: int, bad: list[int], value: float = np.nan) -> Any:
    array = np.ones((rows, 8), np.float32)
    array[bad, 3] = value
    return array


def raw(content: bytes) -> Make:
    return lambda path, _: path.write_bytes(content)


def cut(path: Path, arrays: Arrays) -> None:
    changed()(path, arrays)
    path.write_bytes(path.read_bytes()[:-200])


def parquet(**columns: Any) -> Make:
    def make(path: Path, arrays: Arrays) -> None:
        import pandas as pd

        fields = {"query_ids": arrays["query_ids"], "ranked_ids": arrays["ranked_ids"]} | columns
        pd.DataFrame({k: v for k, v in fields.items() if v is not None}).to_parquet(
            path.with_suffix(".parquet")
        )

    return make


def prediction_file(folder: Path, make: Make, arrays: Arrays) -> Path:
    path = folder / "p.npz"
    fields = {key: arrays[key] for key in ("query_ids", "ranked_ids", "gallery_ids")}
    gallery = fields.pop("gallery_ids")
    needs_gallery = make.__qualname__.startswith("described")
    make(path, fields | ({"gallery_ids": gallery} if needs_gallery else {}))
    return path if not path.with_suffix(".parquet").exists() else path.with_suffix(".parquet")
