"""Data of the page's script: arrays and texts, deflated and written in base64.

Values of queries are codes into the texts of the different values, in their order, so that the
script sorts by codes and shows texts. They are rounded to four digits where there are many.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
import zlib
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats

_DIGITS = 4
_FEW, _MANY = 256, 65_536
# What could end a script element, begin a comment in it, or end a line of it.
_NOT_IN_SCRIPT = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028"}


class Blobs:
    """The blobs of a page, each a text in base64, and pictures that several parts show."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.pictures: list[str] = []

    def add(self, content: bytes, kind: str) -> dict[str, Any]:
        """Pack bytes, and return what the script unpacks them by."""
        self.texts.append(base64.b64encode(zlib.compress(content, 6)).decode())
        return {"blob": len(self.texts) - 1, "type": kind}

    def picture(self, address: str) -> int:
        """Keep a picture once, and return its number."""
        if address not in self.pictures:
            self.pictures.append(address)
        return self.pictures.index(address)

    def array(self, values: NDArray[Any]) -> dict[str, Any]:
        """Pack an array of integers in the smallest type that holds it."""
        kind = _smallest_type(values)
        return self.add(np.ascontiguousarray(values, kind).tobytes(), kind)

    def json(self, value: Any) -> dict[str, Any]:
        """Pack anything that JSON holds."""
        text = json.dumps(json_value(value), ensure_ascii=False, separators=(",", ":"))
        return self.add(text.encode(), "json")

    def numbers(self, values: Floats, texts: Callable[[Floats], list[str]]) -> dict[str, Any]:
        """Pack numbers as codes into the texts of their different values, which ascend.

        The last of them is ``missing`` where there are values that are NaN.
        """
        different, codes = np.unique(values, return_inverse=True)
        for digits in range(_DIGITS, 0, -1) if len(different) > _FEW else ():
            rounded, places = np.unique(_round(different, digits), return_inverse=True)
            if len(rounded) <= _MANY:
                different, codes = rounded, places[codes]
                break
        last = len(different) - 1
        missing = last if len(different) and np.isnan(different[-1]) else -1
        codes = codes.ravel()
        return {"texts": self.json(texts(different)), "codes": self.array(codes)} | {
            "missing": missing
        }

    def words(self, values: Iterable[str]) -> dict[str, Any]:
        """Pack words as codes into the different ones."""
        codes, different = pd.factorize(np.array(list(values), dtype=object), sort=True)
        return {"texts": self.json(different), "codes": self.array(codes), "missing": -1}


def _round(values: Floats, digits: int) -> Floats:
    """Round to significant digits; infinite values and NaN stay."""
    known = np.isfinite(values) & (values != 0)
    sizes = np.floor(np.log10(np.abs(values), out=np.zeros_like(values), where=known))
    steps, whole = 10.0 ** np.abs(digits - 1 - sizes), sizes >= digits - 1
    safe = np.where(known, values, 0.0)
    short = np.where(whole, np.rint(safe / steps) * steps, np.rint(safe * steps) / steps)
    return np.where(known, short, values)


def _smallest_type(values: NDArray[Any]) -> str:
    low, high = (int(values.min()), int(values.max())) if values.size else (0, 0)
    for kind in ("u1", "u2", "i2"):
        limits = np.iinfo(kind)
        if limits.min <= low and high <= limits.max:
            return f"<{kind}"
    return "<i4"


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


def content_policy(script: str, style: str) -> str:
    """Return the policy of a page: only this script and style, by their hashes, and no loading."""
    scripts = _hash(script) if script else "'none'"
    return (
        f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {scripts}; "
        "base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"
