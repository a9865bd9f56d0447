"""Numbers and texts, packed for the page's script to unpack.

A blob is deflated and written in base64. Values of queries are codes into a list of the
different values, which are rounded to four digits where there are many.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats

__all__ = ["Blobs", "data_uri", "json_value", "page_json", "rounded"]

_LEVEL = 6
_DIGITS = 4
_FEW = 256
_MANY = 65_536
_LEAST = 1e-140
# What could end a script element, begin a comment in it, or end a line of it.
_NOT_IN_SCRIPT = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028"}


class Blobs:
    """The blobs of a page, each a text in base64."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def add(self, content: bytes) -> int:
        """Pack bytes and return the blob's number."""
        self.texts.append(base64.b64encode(zlib.compress(content, _LEVEL)).decode())
        return len(self.texts) - 1

    def array(self, values: NDArray[Any]) -> dict[str, Any]:
        """Pack an array of integers in the smallest type that holds it."""
        kind = _smallest_type(values)
        blob = self.add(np.ascontiguousarray(values, kind).tobytes())
        return {"blob": blob, "type": kind}

    def json(self, value: Any) -> dict[str, Any]:
        """Pack anything that JSON holds."""
        text = json.dumps(json_value(value), ensure_ascii=False, separators=(",", ":"))
        return {"blob": self.add(text.encode()), "type": "json"}

    def numbers(self, values: Floats, texts: Callable[[Floats], list[str]]) -> dict[str, Any]:
        """Pack numbers as codes of their different values, NaN for none."""
        different, codes = np.unique(values, return_inverse=True)
        if len(different) > _FEW:
            for digits in range(_DIGITS, 0, -1):
                different, codes = np.unique(rounded(values, digits), return_inverse=True)
                if len(different) <= _MANY:
                    break
        return {
            "values": different.tolist(),
            "texts": self.json(texts(different)),
            "codes": self.array(codes.ravel()),
        }

    def texts_of(self, values: Iterable[str]) -> dict[str, Any]:
        """Pack texts as codes of their different values."""
        different, codes = np.unique(np.array(list(values), dtype=object), return_inverse=True)
        return {"values": different.tolist(), "codes": self.array(codes)}


def _smallest_type(values: NDArray[Any]) -> str:
    low, high = (int(values.min()), int(values.max())) if values.size else (0, 0)
    for kind in ("u1", "u2", "i2"):
        limits = np.iinfo(kind)
        if limits.min <= low and high <= limits.max:
            return f"<{kind}"
    return "<i4"


def rounded(values: Floats, digits: int) -> Floats:
    """Round to significant digits; 0, NaN, infinite and extreme values stay."""
    values = np.asarray(values, np.float64)
    size = np.abs(values)
    counted = (size > _LEAST) & (size < 1 / _LEAST)
    ordinary = np.where(counted, values, 1.0)
    places = digits - 1 - np.floor(np.log10(np.abs(ordinary)))
    # Only scaled by whole powers of ten, so that equal digits are equal numbers.
    up, down = 10.0 ** np.maximum(places, 0), 10.0 ** np.maximum(-places, 0)
    found: Floats = np.where(counted, np.round(ordinary * up / down) * down / up, values)
    return found


def json_value(value: Any) -> Any:
    """Return what JSON can hold: NaN is null, an infinite number the text ``inf`` or ``-inf``."""
    if isinstance(value, float):
        if math.isfinite(value):
            return value
        return None if math.isnan(value) else ("inf" if value > 0 else "-inf")
    if isinstance(value, dict):
        return {str(key): json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(item) for item in value]
    return json_value(value.tolist()) if isinstance(value, np.ndarray) else value


def page_json(value: Any) -> str:
    """Serialise for a script element: nothing in it can end the element."""
    text = json.dumps(json_value(value), ensure_ascii=False, separators=(",", ":"))
    for character, escape in _NOT_IN_SCRIPT.items():
        text = text.replace(character, escape)
    return text.replace("\u2029", "\\u2029")


def data_uri(content: bytes, kind: str) -> str:
    """Return content as a ``data:`` address."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
