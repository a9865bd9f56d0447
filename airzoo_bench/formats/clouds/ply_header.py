"""The header of a PLY file: what elements it holds and where its body begins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.formats.clouds.cloud import FIX_COPY, refusal
from airzoo_bench.formats.clouds.text_rows import shown

__all__ = ["Element", "PlyHeader", "Property", "read_header"]

_LONGEST_HEADER = 1 << 20
_MOST_POINTS = 1 << 62
_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class Property:
    """A column of an element; `counter` is the type of a list's length, None for a number."""

    name: str
    type: str
    counter: str | None = None


@dataclass(frozen=True)
class Element:
    """A table of the file."""

    name: str
    count: int
    properties: tuple[Property, ...] = ()

    @property
    def has_lists(self) -> bool:
        """Whether its rows differ in length."""
        return any(one.counter is not None for one in self.properties)

    @property
    def names(self) -> list[str]:
        """Names of its columns, in order."""
        return [one.name for one in self.properties]

    def record(self, order: str) -> np.dtype[Any]:
        """Return the type of a row without lists, in the given byte order."""
        return np.dtype([(one.name, order + one.type) for one in self.properties])


@dataclass(frozen=True)
class PlyHeader:
    """Byte order (empty for text), elements in order, and where the body begins."""

    order: str
    elements: tuple[Element, ...]
    size: int
    lines: int

    def element(self, name: str) -> Element | None:
        """Return the element of that name."""
        return next((one for one in self.elements if one.name == name), None)


def read_header(path: Path) -> PlyHeader:
    """Read and check the header of a PLY file."""
    lines, size = _header_lines(path)
    order: str | None = None
    elements: list[Element] = []
    for number, line in enumerate(lines[1:-1], start=2):
        words = line.split()
        match words[:1]:
            case [] | ["comment"] | ["obj_info"]:
                continue
            case ["format"]:
                order = _order(path, words)
            case ["element"]:
                elements.append(_element(path, words, number))
            case ["property"] if elements:
                elements[-1] = _with_property(path, elements[-1], words, number)
            case _:
                raise refusal(
                    path,
                    f"line {number} of the header is {shown(line)}",
                    expected="format, element, property or comment",
                )
    names = [one.name for one in elements]
    if order is None or len(set(names)) < len(names):
        what = "no format line" if order is None else "an element twice"
        raise refusal(path, f"the header has {what}", expected="a PLY header", fix=FIX_COPY)
    return PlyHeader(order, tuple(elements), size, len(lines))


def _header_lines(path: Path) -> tuple[list[str], int]:
    with path.open("rb") as stream:
        lines: list[str] = []
        while stream.tell() < _LONGEST_HEADER:
            line = stream.readline(_LONGEST_HEADER)
            lines.append(line.decode("latin-1").rstrip("\r\n"))
            if lines[-1].strip() == "end_header":
                return lines, stream.tell()
            if not line:
                break
    raise refusal(path, "the PLY header has no line end_header", fix=FIX_COPY)


def _order(path: Path, words: list[str]) -> str:
    if len(words) != 3 or words[1] not in _ORDERS or words[2] != "1.0":
        raise refusal(
            path,
            f"unknown format {shown(' '.join(words[1:]))}",
            expected=f"{', '.join(_ORDERS)} 1.0",
        )
    return _ORDERS[words[1]]


def _element(path: Path, words: list[str], number: int) -> Element:
    text = words[2] if len(words) == 3 else ""
    # A number of more digits is absurd anyway, and slow to read.
    if not (text.isascii() and text.isdigit() and len(text) < 20) or int(text) > _MOST_POINTS:
        raise refusal(
            path,
            f"line {number} of the header is {shown(' '.join(words))}",
            expected="element, a name, and a count of 0 or more",
        )
    return Element(words[1], int(text))


def _with_property(path: Path, element: Element, words: list[str], number: int) -> Element:
    match words:
        case [_, "list", counter, kind, name] if (
            counter in _TYPES and kind in _TYPES and _TYPES[counter][0] != "f"
        ):
            new = Property(name, _TYPES[kind], _TYPES[counter])
        case [_, kind, name] if kind in _TYPES:
            new = Property(name, _TYPES[kind])
        case _:
            raise refusal(
                path,
                f"line {number} of the header is {shown(' '.join(words))}",
                expected="property, a type such as float or uchar (or list and two types), a name",
            )
    if name in ("X", "Y", "Z"):
        new = replace(new, name=name.lower())
    if new.name in element.names:
        raise refusal(path, f"property {shown(name)} of {shown(element.name)} stands twice")
    return Element(element.name, element.count, (*element.properties, new))
