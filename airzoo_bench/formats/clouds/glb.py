"""glTF 2, as GLB or as text (``.gltf``): triangles and points with the transforms of their nodes.

Only what lies in the file itself is read: a buffer elsewhere (``uri``) is refused, one that is
written out in the file is not; images and materials are never looked at.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import FIX_COPY, as_colours, refusal
from airzoo_bench.formats.clouds.glb_accessors import Accessors, item, numbers_of
from airzoo_bench.formats.clouds.meshes import Mesh, check_memory
from airzoo_bench.geometry.arrays import Floats, Ints

__all__ = ["open_glb"]

_JSON, _BIN = 0x4E4F534A, 0x004E4942
_LARGEST_JSON = 1 << 28  # with a buffer written out in it, as Open3D does
_DEEPEST = 64
_MOST_NODES = 1 << 15
_AXES = "axes as in the file: glTF takes y as up, and many exporters turn and centre the scene"
_POINTS, _TRIANGLES, _STRIP, _FAN = 0, 4, 5, 6
_REFUSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")


def open_glb(path: Path, limit_bytes: int) -> Mesh:
    """Read a GLB or glTF file: all triangles and points of its scene, each moved by its nodes."""
    document, body = _chunks(path, limit_bytes)
    used = [name for name in _REFUSED if name in str(document.get("extensionsRequired", ""))]
    if used:
        raise refusal(
            path,
            f"is compressed by {', '.join(used)}, which is not read here",
            expected="GLB without compression of meshes",
            fix="export it again without compression, or as PLY",
        )
    try:
        accessors = Accessors(path, document, body)
        parts = _parts(path, document, accessors, limit_bytes)
    except (AttributeError, KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
        raise _damaged(path, str(error)[:100]) from error
    triangles = [part for part in parts if len(part[1])]
    return _joined(path, triangles or parts)


def _joined(path: Path, parts: list[tuple[Floats, Ints, NDArray[np.uint8] | None]]) -> Mesh:
    if not parts:
        raise refusal(path, "holds neither triangles nor points", expected="a mesh in its scene")
    starts = np.cumsum([0] + [len(vertices) for vertices, _, _ in parts])
    faces = [faces + start for (_, faces, _), start in zip(parts, starts[:-1], strict=True)]
    coloured = [colours for _, _, colours in parts if colours is not None]
    return Mesh(
        path,
        "GLB mesh",
        np.concatenate([vertices for vertices, _, _ in parts]),
        np.concatenate(faces),
        np.concatenate(coloured) if len(coloured) == len(parts) else None,
        (_AXES,),
        np.dtype(np.float32),
    )


def _chunks(path: Path, limit_bytes: int) -> tuple[dict[str, Any], bytes]:
    """Return the JSON part and the binary part, which is empty where the file is text."""
    size = path.stat().st_size
    if size > limit_bytes:
        raise refusal(
            path,
            f"a glTF file of {size:,} bytes cannot be read in pieces",
            expected=f"at most {limit_bytes:,} bytes",
            fix="raise --max-memory, or give points as PLY",
        )
    raw = path.read_bytes()
    if not raw.startswith(b"glTF"):
        if size > _LARGEST_JSON:
            raise _large_json(path, size)
        return _document(path, raw), b""
    words = np.frombuffer(raw[:20].ljust(20, b"\0"), "<u4").tolist()
    if _LARGEST_JSON < words[3] <= size:
        raise _large_json(path, words[3])
    if words[1] != 2 or words[2] > size or words[4] != _JSON or words[3] > size:
        raise _damaged(path, "its head is not of glTF 2, or it is cut off")
    text, rest = raw[20 : 20 + words[3]], raw[20 + words[3] : words[2]]
    length, kind = np.frombuffer(rest[:8].ljust(8, b"\0"), "<u4").tolist()
    if length > max(len(rest) - 8, 0):
        raise _damaged(path, "its binary part is cut off")
    return _document(path, text), rest[8 : 8 + length] if kind == _BIN else b""


def _large_json(path: Path, size: int) -> PredictionError:
    return refusal(
        path,
        f"its JSON part has {size:,} bytes",
        expected=f"at most {_LARGEST_JSON:,}, with the numbers in the binary part",
        fix="export it with a binary buffer, or give a PLY",
    )


def _document(path: Path, text: bytes) -> dict[str, Any]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise _damaged(path, "its JSON part cannot be read") from error
    if not isinstance(document, dict):
        raise _damaged(path, "its JSON part is no object")
    return document


def _parts(
    path: Path, document: dict[str, Any], accessors: Accessors, limit_bytes: int
) -> list[tuple[Floats, Ints, NDArray[np.uint8] | None]]:
    parts, vertices, faces = [], 0, 0
    for mesh, matrix in _placed_meshes(path, document):
        for primitive in item(document, "meshes", mesh)["primitives"]:
            part = _primitive(accessors, primitive, matrix)
            if part is None:
                continue
            parts.append(part)
            vertices, faces = vertices + len(part[0]), faces + len(part[1])
            check_memory(path, vertices, faces, limit_bytes)
    return parts


def _placed_meshes(path: Path, document: dict[str, Any]) -> list[tuple[int, Floats]]:
    """Meshes of the scene with the matrix (4, 4) that places each in the world."""
    scenes = document.get("scenes")
    if scenes:
        roots = item(document, "scenes", document.get("scene", 0)).get("nodes", [])
    else:
        below = {child for node in document.get("nodes", []) for child in node.get("children", [])}
        roots = [node for node in range(len(document.get("nodes", []))) if node not in below]
    placed: list[tuple[int, Floats]] = []
    waiting = [(root, np.eye(4), 0) for root in reversed(roots)]
    visited = 0
    while waiting:
        number, above, depth = waiting.pop()
        visited += 1
        if depth > _DEEPEST or visited > _MOST_NODES:
            raise _damaged(path, "its nodes are too many or contain themselves")
        node = item(document, "nodes", number)
        matrix = above @ _matrix(node)
        if "mesh" in node:
            placed.append((node["mesh"], matrix))
        waiting += [(child, matrix, depth + 1) for child in reversed(node.get("children", []))]
    return placed


def _matrix(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return numbers_of(node["matrix"], 16).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = numbers_of(node.get("rotation", (0, 0, 0, 1)), 4)
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix[:3, :3] = rotation * numbers_of(node.get("scale", (1, 1, 1)), 3)
    matrix[:3, 3] = numbers_of(node.get("translation", (0, 0, 0)), 3)
    return matrix


def _primitive(
    accessors: Accessors, primitive: dict[str, Any], matrix: Floats
) -> tuple[Floats, Ints, NDArray[np.uint8] | None] | None:
    mode = primitive.get("mode", _TRIANGLES)
    if mode not in (_POINTS, _TRIANGLES, _STRIP, _FAN):
        return None
    attributes = primitive["attributes"]
    local = accessors.read(attributes["POSITION"], "VEC3").astype(np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        x, y, z = local.T
        moved = [row[0] * x + row[1] * y + row[2] * z + row[3] for row in matrix[:3]]
    colours = None
    if "COLOR_0" in attributes:
        colours = as_colours(*accessors.read(attributes["COLOR_0"], "VEC3", "VEC4").T[:3])
        if len(colours) != len(local):
            raise ValueError("colours and positions differ in number")
    indices = np.arange(len(local))
    if "indices" in primitive:
        indices = accessors.read(primitive["indices"], "SCALAR")[:, 0].astype(np.int64)
    return np.stack(moved, axis=-1), _faces(indices, mode), colours


def _faces(indices: Ints, mode: int) -> Ints:
    if mode == _POINTS or len(indices) < 3:
        return np.empty((0, 3), np.int64)
    if mode == _TRIANGLES:
        if len(indices) % 3:
            raise ValueError("indices that are not three a triangle")
        return indices.reshape(-1, 3)
    first = indices[:-2] if mode == _STRIP else np.full(len(indices) - 2, indices[0])
    return np.stack((first, indices[1:-1], indices[2:]), axis=-1)


def _damaged(path: Path, reason: str) -> PredictionError:
    readable = "".join(letter for letter in reason if letter.isprintable())
    return refusal(path, f"the {path.suffix[1:].upper()} file is damaged: {readable}", fix=FIX_COPY)
