"""Templates of pages, and data of their scripts: arrays and texts, deflated and in base64.

Values of queries are codes into the texts of the different values, in their order, so that the
script sorts by codes and shows texts.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
import zlib
from collections.abc import Callable, Sequence
from importlib import resources
from typing import Any

import jinja2
import numpy as np
from numpy.typing import NDArray

# What could end a script element, begin a comment in it, or end a line of it.
_NOT_IN_SCRIPT = {ord(c): f"\\u{ord(c):04x}" for c in "<>&\u2028\u2029"}


def read_part(name: str) -> str:
    """Read a template, style or script of the report."""
    return (resources.files("airzoo_bench.report") / "html" / name).read_text(encoding="utf-8")


TEMPLATES = jinja2.Environment(
    loader=jinja2.FunctionLoader(read_part),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
TEMPLATES.filters |= {"zip": zip, "numbered": enumerate}


class Blobs:
    """The blobs of a page, each a text in base64, and pictures that several parts show."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.pictures: dict[str, int] = {}

    def _add(self, content: bytes, kind: str) -> dict[str, Any]:
        self.texts.append(base64.b64encode(zlib.compress(content, 6)).decode())
        return {"blob": len(self.texts) - 1, "type": kind}

    def picture(self, address: str) -> int:
        """Keep a picture once, and return its number."""
        return self.pictures.setdefault(address, len(self.pictures))

    def array(self, values: NDArray[Any]) -> dict[str, Any]:
        """Pack an array of integers in the smallest type that holds it."""
        kinds = ("<u1", "<u2", "<i2", "<i4")
        kind = next(kind for kind in kinds if (values.astype(kind) == values).all())
        return self._add(values.astype(kind).tobytes(), kind)

    def json(self, value: Any) -> dict[str, Any]:
        """Pack anything that JSON holds."""
        return self._add(_dump(value).encode(), "json")

    def codes(
        self, values: NDArray[Any], texts: Callable[[list[Any]], Sequence[str]]
    ) -> dict[str, Any]:
        """Pack values as codes into the different texts that are written for them."""
        different, codes = np.unique(values, return_inverse=True)
        written = list(texts(different.tolist()))
        return {"texts": self.json(written), "codes": self.array(codes.ravel())}


def _json_value(value: Any) -> Any:
    """Return what JSON can hold: NaN is null, an infinite number the text ``inf`` or ``-inf``."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None if math.isnan(value) else str(value)
    if isinstance(value, dict):
        return {str(key): _json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_json_value(item) for item in value]
    return _json_value(value.tolist()) if isinstance(value, np.ndarray) else value


def _dump(value: Any) -> str:
    return json.dumps(_json_value(value), ensure_ascii=False, separators=(",", ":"))


def page_json(value: Any) -> str:
    """Serialise for a script element: nothing in it can end the element."""
    return _dump(value).translate(_NOT_IN_SCRIPT)


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
