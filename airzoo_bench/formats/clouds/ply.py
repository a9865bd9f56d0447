"""PLY: clouds, Gaussian splats and meshes, binary of both byte orders and text."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator
from itertools import islice, takewhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import FIX_COPY, PredictionError, readable
from airzoo_bench.core.files import atomic_write
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud, refusal
from airzoo_bench.formats.clouds.meshes import Mesh, add_fan, cut_fans
from airzoo_bench.formats.clouds.rows import Rows, open_lines, quoted
from airzoo_bench.geometry.arrays import Ints

_SPLATS = {"f_dc_0", "opacity"}
_FACE_LISTS = ("vertex_indices", "vertex_index")
_SPLAT_NOTE = "Gaussian splats: their centres are taken as points, without colours"
_ROWS = 1 << 18  # of faces that are looked at together
_FEWEST = 32  # faces
_LONGEST_HEADER = 1 << 20
_CODES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


class _Element(NamedTuple):
    """A table: of each column its type, and of one of lists the type of their lengths, else ""."""

    name: str
    rows: int
    columns: dict[str, tuple[str, str]]

    @property
    def has_lists(self) -> bool:
        return any(counter for _, counter in self.columns.values())


class _Header(NamedTuple):
    """Byte order (empty for text), elements by name, and the byte that the body begins at."""

    path: Path
    order: str
    elements: dict[str, _Element]
    size: int

    def record(self, element: _Element) -> np.dtype[Any]:
        return np.dtype([(name, self.order + kind) for name, (kind, _) in element.columns.items()])

    def cut_off(self, element: _Element) -> PredictionError:
        what = f"the file ends within its element {quoted(element.name)}, or a list in it is absurd"
        expected = f"{element.rows:,} rows, as its header says"
        return refusal(self.path, what, expected=expected, fix=FIX_COPY)


def open_ply(path: Path) -> FileCloud | Mesh:
    """Open a PLY file: a mesh where it has faces, else a cloud."""
    header = _read_header(path)
    vertex, faces = header.elements.get("vertex"), header.elements.get("face")
    if vertex is None or vertex.has_lists or not {*"xyz"} <= vertex.columns.keys():
        expected = "element vertex with properties x, y, z that are numbers"
        raise refusal(path, "has no vertices with x, y and z", expected=expected)
    start = _start_of(header, vertex)
    place = (start,) if header.order else (header.size, True, start)
    notes = (_SPLAT_NOTE,) if vertex.columns.keys() >= _SPLATS else ()
    are_last = next(reversed(header.elements.values())) is vertex
    rows = Rows(path, header.record(vertex), vertex.rows, *place)
    cloud = rows.open(f"PLY ({'binary' if header.order else 'text'})", notes, are_last=are_last)
    if faces is None or not faces.rows:
        return cloud
    found = [name for name in _FACE_LISTS if faces.columns.get(name, ("", ""))[1]]
    if not found:
        expected = "property list uchar int vertex_indices"
        raise refusal(path, "its faces have no list of vertices", expected=expected)
    piece = next(cloud.pieces(max(cloud.count, 1)), Cloud(np.empty((0, 3))))
    read = _read_faces if header.order else _read_text_faces
    triangles = read(header, faces, found[0])
    return Mesh(path, "PLY mesh", piece.points, triangles, cloud.notes, cloud.precision)


def _read_header(path: Path) -> _Header:
    with path.open("rb") as stream:
        text = stream.read(_LONGEST_HEADER)
    size = text.find(b"\n", text.find(b"end_header")) + 1
    lines = text[:size].decode("latin-1").split("\n")[:-1]
    order, elements, columns = None, dict[str, _Element](), dict[str, tuple[str, str]]()
    with readable(path, "the PLY header is wrong", expected="a header as the PLY format has it"):
        if not lines or lines[-1].strip() != "end_header":
            raise ValueError("it has no line end_header")
        for line in lines[1:-1]:
            match line.split():
                case [] | ["comment" | "obj_info", *_]:
                    continue
                case ["format", kind, "1.0"] if kind in _ORDERS:
                    order = _ORDERS[kind]
                case ["element", name, count] if re.fullmatch("[0-9]+", count):
                    if name in elements:
                        raise ValueError(f"the element {quoted(name)} is there twice")
                    columns = {}
                    elements[name] = _Element(name, int(count), columns)
                case ["property", *words] if elements and _add_column(columns, words):
                    continue
                case _:
                    raise ValueError(f"a line is {quoted(line)}")
        if order is None:
            raise ValueError("it has no line of the format")
    return _Header(path, order or "", elements, size)


def _add_column(columns: dict[str, tuple[str, str]], words: list[str]) -> bool:
    """Add a column; tell whether its words describe one."""
    is_list = len(words) == 4 and words[0] == "list"
    if not (is_list or len(words) == 2) or words[-2] not in _CODES:
        return False
    counter = _CODES.get(words[1], "f") if is_list else ""
    name = words[-1].lower() if words[-1] in ("X", "Y", "Z") else words[-1]
    if counter.startswith("f") or name in columns:
        return False
    columns[name] = (_CODES[words[-2]], counter)
    return True


def _start_of(header: _Header, element: _Element) -> int:
    """Return the byte, or in text the line of the body, that an element begins at."""
    start = header.size if header.order else 0
    for before in takewhile(lambda one: one is not element, header.elements.values()):
        if not header.order:
            start += before.rows
        else:
            start = max((end for _, end in _runs(header, before, start)), default=start)
    return start


def _read_faces(header: _Header, faces: _Element, name: str) -> Ints:
    """Read the faces of a binary file as triangles (F, 3), polygons as fans."""
    runs = _runs(header, faces, _start_of(header, faces))
    parts = [cut_fans(np.asarray(rows[name]).astype(np.int64)) for rows, _ in runs]
    return np.concatenate([np.empty((0, 3), np.int64), *parts])


def _read_text_faces(header: _Header, faces: _Element, name: str) -> Ints:
    """Read the faces of a text file: its first list has the vertices."""
    skip, triangles, found = _start_of(header, faces), array("q"), 0
    place = list(faces.columns).index(name)
    with readable(header.path, f"its {name} are wrong"):
        if any(counter for _, counter in list(faces.columns.values())[:place]):
            raise ValueError("another list is before them, as text")
        with open_lines(header.path, header.size) as lines:
            for line in islice(lines, skip, skip + faces.rows):
                found += 1
                words = line.split()[place:]
                corners = list(map(int, words[1 : int(words[0]) + 1]))
                if len(corners) != int(words[0]) or not all(0 <= one < 1 << 62 for one in corners):
                    raise ValueError(f"a line is {quoted(line)}")
                add_fan(triangles, corners)
    if found < faces.rows:
        raise header.cut_off(faces)
    return np.array(triangles).reshape(-1, 3)


def _runs(header: _Header, element: _Element, start: int) -> Iterator[tuple[NDArray[Any], int]]:
    """Yield runs of rows with lists of the same lengths, and the byte that each ends at."""
    raw = np.memmap(header.path, np.uint8, "r")
    left, ask = element.rows, _FEWEST
    while left and element.columns:
        record = _record_at(header, raw, start, element)
        room = min(left, ask, (len(raw) - start) // record.itemsize)
        if room <= 0:
            raise header.cut_off(element)
        rows = np.frombuffer(raw, record, room, start)
        same = np.ones(room, np.bool_)
        for name, (_, counter) in element.columns.items():
            if counter:
                lengths = rows[f"{name} count"]
                same &= lengths == lengths[0]
        run = room if same.all() else int(np.argmin(same))
        start += run * record.itemsize
        left -= run
        yield rows[:run], start
        ask = min(2 * run + _FEWEST, _ROWS)


def _record_at(
    header: _Header, raw: NDArray[np.uint8], place: int, element: _Element
) -> np.dtype[Any]:
    """Return the type of the row that begins at a place, its lists being as long as they are."""
    fields: list[tuple[Any, ...]] = []
    for name, (kind, counter) in element.columns.items():
        if not counter:
            fields.append((name, header.order + kind))
            continue
        length_type = np.dtype(header.order + counter)
        at = place + np.dtype(fields).itemsize
        stated = raw[at : at + length_type.itemsize].tobytes().ljust(8, b"\0")
        length = int(np.frombuffer(stated, length_type, 1)[0])
        if not 0 <= length <= len(raw):
            raise header.cut_off(element)
        fields += [(f"{name} count", length_type), (name, header.order + kind, (length,))]
    return np.dtype(fields)


def write_ply(path: Path, cloud: Cloud) -> None:
    """Write the points of a cloud, whole or not at all."""
    axes = "".join(f"property double {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(cloud)}\n{axes}end_header\n"
    with atomic_write(path) as stream:
        stream.write(head.encode("ascii"))
        stream.write(np.ascontiguousarray(cloud.points, "<f8").data)
