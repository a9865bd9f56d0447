"""Arrays inside a GLB file, each checked against the bytes that are there."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.formats.clouds.cloud import refusal
from airzoo_bench.geometry.arrays import Floats

__all__ = ["Accessors", "item", "numbers_of"]

_TYPES = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


def item(document: dict[str, Any], key: str, index: Any) -> dict[str, Any]:
    """Return an entry of a list of the document."""
    entries = document.get(key, [])
    if not isinstance(index, int) or not 0 <= index < len(entries):
        raise ValueError(f"no {key} of that number")
    entry = entries[index]
    if not isinstance(entry, dict):
        raise ValueError(f"an entry of {key} is no object")
    return entry


def numbers_of(values: Any, count: int) -> Floats:
    """Return a number of finite numbers of the document."""
    numbers = np.array(values, np.float64)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise ValueError(f"a transform is not {count} finite numbers")
    return numbers


class Accessors:
    """The arrays of a document whose one buffer is the file's binary part.

    Raises
    ------
    PredictionError
        A buffer lies outside of the file.
    """

    def __init__(self, path: Path, document: dict[str, Any], body: bytes) -> None:
        self._document = document
        buffers = document.get("buffers", [])
        embedded = _embedded(buffers)
        self._body = body if embedded is None else embedded
        if embedded is None and any("uri" in buffer for buffer in buffers):
            raise refusal(
                path,
                "its data lie in another file or address (uri), which is never opened",
                expected="a GLB file that holds everything itself",
                fix="export it as one binary file",
            )

    def read(self, index: Any, *shapes: str) -> NDArray[Any]:
        """Return an array (N, width)."""
        entry = item(self._document, "accessors", index)
        if entry.get("type") not in shapes or entry.get("componentType") not in _TYPES:
            raise ValueError("an array of another type or shape")
        if "sparse" in entry or "bufferView" not in entry:
            raise ValueError("a sparse or empty array")
        view = item(self._document, "bufferViews", entry["bufferView"])
        kind = np.dtype("<" + _TYPES[entry["componentType"]])
        width = _WIDTHS[entry["type"]]
        count, first = _whole(entry["count"]), _whole(entry.get("byteOffset", 0))
        start, length = _whole(view.get("byteOffset", 0)), _whole(view["byteLength"])
        step = _whole(view.get("byteStride", 0)) or width * kind.itemsize
        needed = first + step * (count - 1) + width * kind.itemsize if count else 0
        if view.get("buffer") != 0 or start + length > len(self._body) or needed > length:
            raise ValueError("an array that reaches beyond the file")
        return np.ndarray((count, width), kind, self._body, start + first, (step, kind.itemsize))


def _whole(value: Any) -> int:
    if not isinstance(value, int) or value < 0:
        raise ValueError("a size that is not a whole number of 0 or more")
    return value


def _embedded(buffers: list[dict[str, Any]]) -> bytes | None:
    """Return the one buffer that is written out in the JSON part, as Open3D does; or None."""
    uri = buffers[0].get("uri") if len(buffers) == 1 else None
    if not isinstance(uri, str) or not uri.startswith("data:"):
        return None
    head, _, text = uri.partition(",")
    if not head.endswith(";base64"):
        return None
    return base64.b64decode(text, validate=True)
