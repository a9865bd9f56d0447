"""Files of meshes: GLB and glTF by trimesh, OBJ here; only shape is read.

trimesh takes OBJ with indices below 0, or with corners of several forms, for another mesh.
"""

from __future__ import annotations

import io
import json
from array import array
from pathlib import Path
from typing import Any, Never

import numpy as np
import trimesh

from airzoo_bench.core.errors import readable
from airzoo_bench.formats.clouds.cloud import refusal
from airzoo_bench.formats.clouds.meshes import Mesh, add_fan
from airzoo_bench.formats.clouds.rows import open_lines, quoted
from airzoo_bench.geometry.arrays import Floats, Ints

_SINGLE = np.dtype(np.float32)
_AXES = "axes as in the file: glTF takes y as up, and many exporters turn and centre the scene"
_COMPRESSED = (b"KHR_draco_mesh_compression", b"EXT_meshopt_compression", b"KHR_meshopt")


class _NoFiles:
    """Refuses to open what a mesh names, instead of a resolver."""

    def __getitem__(self, name: object) -> Never:
        raise ValueError("its data are in another file or address (uri), which is never opened")

    get = __getitem__


def open_gltf(path: Path) -> Mesh:
    """Read a GLB or glTF file: all triangles, else all points, each moved by its nodes."""
    raw = path.read_bytes()
    is_binary = raw.startswith(b"glTF")
    expected = "GLB that holds everything itself, without compression of meshes"
    with readable(path, "the glTF file cannot be read", expected=expected):
        if any(name in raw for name in _COMPRESSED):
            raise ValueError("it is compressed by an extension (Draco or meshopt)")
        # trimesh takes NaN among the transforms of nodes for none.
        text = raw[20 : 20 + int.from_bytes(raw[12:16], "little")] if is_binary else raw
        json.loads(text, parse_constant=int)  # which NaN is none of
        scene = trimesh.load_scene(
            io.BytesIO(raw),
            file_type="glb" if is_binary else "gltf",
            resolver=_NoFiles(),  # type: ignore[arg-type]
            process=False,
            maintain_order=True,
            skip_materials=True,
        )
        parts = [_part(scene, node) for node in scene.graph.nodes_geometry]
        parts = [part for part in parts if len(part[1])] or [one for one in parts if len(one[0])]
        if not parts:
            raise ValueError("its scene holds neither triangles nor points")
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [faces + start for (_, faces), start in zip(parts, starts[:-1], strict=True)]
    vertices = np.concatenate([vertices for vertices, _ in parts])
    return Mesh(path, "GLB mesh", vertices, np.concatenate(faces), (_AXES,), _SINGLE)


def _part(scene: Any, node: str) -> tuple[Floats, Ints]:
    matrix, name = scene.graph[node]
    geometry = scene.geometry[name]
    x, y, z = np.asarray(geometry.vertices, np.float64).T
    moved = [row[0] * x + row[1] * y + row[2] * z + row[3] for row in matrix[:3]]
    faces = np.asarray(getattr(geometry, "faces", np.empty((0, 3))), np.int64)
    return np.stack(moved, axis=-1), faces


def open_obj(path: Path) -> Mesh:
    """Read an OBJ file: ``v`` and ``f``; materials are never opened."""
    vertices, triangles = array("d"), array("q")
    with open_lines(path) as lines:
        for line in lines:
            kind, *words = line.split()
            try:
                if kind == "v":
                    x, y, z = map(float, words[:3])
                    vertices.extend((x, y, z))
                elif kind == "f":
                    count = len(vertices) // 3
                    add_fan(triangles, [_index(word.partition("/")[0], count) for word in words])
            except (ValueError, OverflowError) as error:
                expected = "v x y z, or f and indices of vertices from 1 (below 0: from the end)"
                raise refusal(path, f"a line is {quoted(line)}", expected=expected) from error
    if not vertices:
        raise refusal(path, "has no vertices", expected="an OBJ file with lines 'v x y z'")
    corners, faces = np.array(vertices).reshape(-1, 3), np.array(triangles).reshape(-1, 3)
    return Mesh(path, "OBJ mesh", corners, faces)


def _index(word: str, count: int) -> int:
    number = int(word)
    if number == 0 or number < -count:
        raise ValueError("no vertex has this number")
    return number - 1 if number > 0 else count + number
