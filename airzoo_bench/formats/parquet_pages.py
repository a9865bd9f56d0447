"""What the pages of a parquet file state that they hold, found without unpacking any.

Arrow takes the memory that a page asks for before anyone can look at it, and a page of a few bytes
may state one value a billion times. The headers are in Thrift's compact protocol, whose few rules
stand here (https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md), with
the fields of https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift.
"""

from __future__ import annotations

import mmap
from collections.abc import Collection
from pathlib import Path
from typing import Any

__all__ = ["claimed_bytes"]

_MAGIC = b"PAR1"
_LARGEST_FOOTER = 1 << 22
_MOST_PAGES = 1 << 18
_DEEPEST = 16
_LONGEST_NAME = 256
_BYTES_A_VALUE = 12  # as an index into a dictionary, and what says which list it is in
_DELTA_BYTE_ARRAY = 7
_ROW_GROUPS, _COLUMNS, _GROUP_ROWS, _META = 4, 1, 3, 3
_NAME, _VALUES, _CODEC_BYTES = 3, 5, 7
_DATA_START, _DICTIONARY_START = 9, 11
_PLAIN_BYTES, _PACKED_BYTES, _KINDS_OF_PAGE = 2, 3, {5: 2, 7: 2, 8: 4}
_DOUBLE, _BINARY, _LISTS, _STRUCT = 7, 8, (9, 10), 12

Struct = dict[int, Any]


def claimed_bytes(path: Path, passed_over: Collection[str] = ()) -> int:
    """Return how much memory the pages of a file ask for when they are read."""
    with path.open("rb") as stream:
        size = stream.seek(0, 2)
        if size < 12:
            raise ValueError("it is cut off")
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as body:
            footer = int.from_bytes(body[-8:-4], "little")
            if body[-4:] != _MAGIC or not 0 < footer <= min(size - 12, _LARGEST_FOOTER):
                raise ValueError("its footer is damaged, cut off or absurdly long")
            data = _Compact(body, size - 8 - footer, size - 8).struct()
            groups = _structs(data.get(_ROW_GROUPS))
            chunks = [one for group in groups for one in _chunks(body, group, size)]
    return sum(asked for column, asked in chunks if column not in passed_over)


def _chunks(body: mmap.mmap, group: Struct, size: int) -> list[tuple[str, int]]:
    """Return the outermost name of each column of a row group, and the bytes it asks for."""
    _whole(group.get(_GROUP_ROWS, 0))
    columns = _structs(group.get(_COLUMNS))
    return [_chunk(body, _struct(column.get(_META)), size) for column in columns]


def _chunk(body: mmap.mmap, meta: Struct, size: int) -> tuple[str, int]:
    _whole(meta.get(_VALUES, 0))
    starts = [_whole(meta[key]) for key in (_DATA_START, _DICTIONARY_START) if meta.get(key)]
    place = min(starts, default=-1)
    end = place + _whole(meta.get(_CODEC_BYTES))
    if not 0 < place <= end <= size:
        raise ValueError("a column lies outside the file")
    pages: list[int] = []
    while place < end and len(pages) < _MOST_PAGES:
        reader = _Compact(body, place, end)
        page = reader.struct()
        pages.append(_page_bytes(page))
        place = reader.place + _whole(page.get(_PACKED_BYTES))
    if place != end:
        raise ValueError("the pages of a column do not fit it")
    name = meta.get(_NAME)
    column = name[0] if isinstance(name, list) and name and isinstance(name[0], bytes) else b""
    return column.decode("utf-8", "replace"), sum(pages)


def _page_bytes(page: Struct) -> int:
    stated = _whole(page.get(_PLAIN_BYTES))
    for kind, encoding in _KINDS_OF_PAGE.items():
        if kind in page:
            head = _struct(page[kind])
            if head.get(encoding) == _DELTA_BYTE_ARRAY:
                # Each text may repeat all of the one before: nothing bounds what they unpack to.
                raise ValueError("its texts are in the encoding DELTA_BYTE_ARRAY, write PLAIN")
            stated += _whole(head.get(1)) * _BYTES_A_VALUE
    return stated


def _whole(value: object) -> int:
    if not isinstance(value, int) or value < 0:
        raise ValueError("a size in it is damaged")
    return value


def _struct(value: object) -> Struct:
    if not isinstance(value, dict):
        raise ValueError("its metadata are damaged")
    return value


def _structs(value: object) -> list[Struct]:
    return [_struct(one) for one in value] if isinstance(value, list) else []


class _Compact:
    """Values of Thrift's compact protocol, from a place on and not beyond an end."""

    def __init__(self, body: mmap.mmap, place: int, end: int) -> None:
        self.place = place
        self._body, self._end, self._depth = body, end, 0

    def struct(self) -> Struct:
        """Return the fields of a struct by their numbers."""
        fields: Struct = {}
        number = 0
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ValueError("its metadata are nested too deep")
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._signed()
            fields[number] = self._value(head & 0x0F)
        self._depth -= 1
        return fields

    def _value(self, kind: int) -> Any:
        if kind in (1, 2):
            return kind == 1
        return self._element(kind)

    def _element(self, kind: int) -> Any:
        if kind in (1, 2, 3):
            return self._byte()
        if kind in (4, 5, 6):
            return self._signed()
        if kind in (_DOUBLE, _BINARY):
            return self._bytes(8 if kind == _DOUBLE else self._unsigned())
        if kind in _LISTS:
            return self._list()
        if kind == _STRUCT:
            return self.struct()
        raise ValueError("its metadata are damaged")

    def _list(self) -> list[Any]:
        head = self._byte()
        count = head >> 4 if head >> 4 < 15 else self._unsigned()
        if count > self._end - self.place:
            raise ValueError("its metadata are cut off")
        return [self._element(head & 0x0F) for _ in range(count)]

    def _byte(self) -> int:
        if self.place >= self._end:
            raise ValueError("its metadata are cut off")
        self.place += 1
        return self._body[self.place - 1]

    def _bytes(self, count: int) -> bytes:
        if count > self._end - self.place:
            raise ValueError("its metadata are cut off")
        self.place += count
        return self._body[self.place - count : self.place - count + min(count, _LONGEST_NAME)]

    def _unsigned(self) -> int:
        value = 0
        for shift in range(0, 70, 7):
            byte = self._byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise ValueError("a number in its metadata is damaged")

    def _signed(self) -> int:
        value = self._unsigned()
        return (value >> 1) ^ -(value & 1)
