"""Files of meshes, written by hand so that they may be wrong."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
CUBE_QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
QUAD_HEADER = "element face 6\nproperty list uchar int vertex_indices"


def cube_columns() -> dict[str, NDArray[Any]]:
    return dict(zip("xyz", CUBE.T, strict=True))


def quads(order: str = "<") -> bytes:
    """Faces of the cube, as a PLY body."""
    if not order:
        return "".join(f"4 {' '.join(map(str, quad))}\n" for quad in CUBE_QUADS.tolist()).encode()
    return b"".join(struct.pack(f"{order}B4i", 4, *quad) for quad in CUBE_QUADS.tolist())


def write_glb(
    path: Path, document: dict[str, Any], body: bytes = b"", *, length: int | None = None
) -> Path:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body += b"\0" * (-len(body) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(body), 0x004E4942) + body
    total = 12 + len(chunks) if length is None else length
    path.write_bytes(b"glTF" + struct.pack("<II", 2, total) + chunks)
    return path


def cube_document() -> tuple[dict[str, Any], bytes]:
    """Return a document of the cube, float32 and uint16, and its binary part."""
    positions = CUBE.astype("<f4").tobytes()
    triangles = np.concatenate([CUBE_QUADS[:, [0, 1, 2]], CUBE_QUADS[:, [0, 2, 3]]]).astype("<u2")
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1], "translation": [10, 0, 0]}, {"mesh": 0, "scale": [2, 2, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 96},
            {"buffer": 0, "byteOffset": 96, "byteLength": 72},
        ],
        "buffers": [{"byteLength": 168}],
    }
    return document, positions + triangles.tobytes()


OBJ_CUBE = (
    "mtllib /etc/passwd\n"
    + "".join("v {} {} {}\n".format(*corner) for corner in CUBE.tolist())
    + "vn 0 0 1\ns off\n"
    + "".join(
        "f {}/1/1 {}//1 {} {}\n".format(*(index + 1 for index in quad))
        for quad in CUBE_QUADS.tolist()
    )
)


def write_gltf(path: Path) -> Path:
    """Write the cube as text, its numbers in base64."""
    document, body = cube_document()
    uri = "data:application/octet-stream;base64," + base64.b64encode(body).decode()
    document["buffers"][0]["uri"] = uri
    path.write_text(json.dumps(document))
    return path


def on_cube(points: Any, low: Any = 0.0, side: float = 1.0) -> bool:
    local = (points - low) / side
    inside = (local >= -1e-9).all() and (local <= 1 + 1e-9).all()
    return bool(inside and (np.minimum(np.abs(local), np.abs(local - 1)).min(axis=1) < 1e-6).all())
