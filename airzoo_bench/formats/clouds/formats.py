"""Which reader a file is for: its first bytes decide, and its ending must agree."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds import arrays, glb, las, obj, pcd, ply
from airzoo_bench.formats.clouds.cloud import FIX_COPY, Cloud, FileCloud, refusal
from airzoo_bench.formats.clouds.meshes import Mesh, MeshSampling, sampled

__all__ = ["SUFFIXES", "open_cloud"]

SUFFIXES = (".ply", ".pcd", ".las", ".laz", ".npz", ".npy", ".obj", ".glb")
"""Endings of files that can be clouds."""

_HEAD_BYTES = 4096
_MAGIC = (
    (b"ply\n", "PLY", (".ply",)),
    (b"ply\r", "PLY", (".ply",)),
    (b"LASF", "LAS or LAZ", (".las", ".laz")),
    (b"\x93NUMPY", "npy", (".npy",)),
    (b"PK\x03\x04", "npz or zip", (".npz",)),
    (b"PK\x05\x06", "npz or zip", (".npz",)),
    (b"glTF", "GLB", (".glb",)),
    (b"# .PCD", "PCD", (".pcd",)),
    (b"VERSION", "PCD", (".pcd",)),
)
_OTHERS = (
    (b"version https://git-lfs", "a Git LFS pointer, not the file itself"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"7z\xbc\xaf", "a 7z archive"),
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"\x89HDF", "an HDF5 file"),
    (b"ASTM-E57", "an E57 scan"),
    (b"%PDF", "a PDF"),
    (b"\x80\x04\x95", "a Python pickle"),
    (b"<", "HTML or XML"),
    (b"{", "JSON, perhaps glTF with its data in other files"),
)
_OBJ_STARTS = (b"#", b"v ", b"v\t", b"vn ", b"vt ", b"f ", b"o ", b"g ", b"mtllib ", b"usemtl ")


def open_cloud(path: Path, *, limit_bytes: int, sampling: MeshSampling | None) -> FileCloud:
    """Open a cloud, or a mesh as points on its surface.

    Parameters
    ----------
    path : Path
        PLY, PCD, LAS, LAZ, npz, npy, OBJ or GLB.
    limit_bytes : int
        The most that what cannot be read in pieces may take in memory.
    sampling : MeshSampling or None
        How meshes are sampled; where None, they are refused.

    Returns
    -------
    FileCloud
        Files with points only are read when the pieces are asked for.

    Raises
    ------
    PredictionError
        It is no such file, has the ending of another kind, is damaged or cut off, or a mesh that
        may not be sampled.
    """
    kind = _kind(path)
    opened = _open(path, kind, limit_bytes)
    if isinstance(opened, FileCloud):
        return opened
    if not len(opened.faces):
        return _vertices(opened)
    if sampling is None:
        raise refusal(
            path,
            "is a mesh, and the protocol does not say how meshes are sampled",
            expected="points",
            fix="sample the mesh and give the points",
        )
    return sampled(opened, sampling)


def _open(path: Path, kind: str, limit_bytes: int) -> FileCloud | Mesh:
    match kind:
        case "PLY":
            return ply.open_ply(path, limit_bytes)
        case "PCD":
            return pcd.open_pcd(path, limit_bytes)
        case "LAS or LAZ":
            return las.open_las(path)
        case "npz or zip":
            return arrays.open_npz(path, limit_bytes)
        case "npy":
            return arrays.open_npy(path)
        case "GLB":
            return glb.open_glb(path, limit_bytes)
        case _:
            return obj.open_obj(path, limit_bytes)


def _kind(path: Path) -> str:
    if not path.is_file():
        what = "a folder, not a file" if path.is_dir() else "no such file"
        raise refusal(path, what, expected=f"one of {', '.join(SUFFIXES)}")
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    if not head:
        raise refusal(path, "is empty", fix=FIX_COPY)
    suffix = path.suffix.lower()
    for magic, kind, suffixes in _MAGIC:
        if head.startswith(magic):
            if suffix not in suffixes:
                raise _misnamed(path, f"{kind}", f"the ending {' or '.join(suffixes)}")
            return kind
    if suffix == ".obj" and _looks_like_obj(head):
        return "OBJ"
    if suffix == ".pcd" and b"FIELDS" in head:
        return "PCD"
    raise _unknown(path, head)


def _looks_like_obj(head: bytes) -> bool:
    lines = [line.lstrip() for line in head.split(b"\n") if line.strip()]
    return b"\0" not in head and bool(lines) and lines[0].startswith(_OBJ_STARTS)


def _misnamed(path: Path, kind: str, expected: str) -> PredictionError:
    return refusal(
        path,
        f"is named {path.suffix[:20]!r} but its content is that of {kind}",
        expected=expected,
        fix="give it the ending of what it is",
    )


def _unknown(path: Path, head: bytes) -> PredictionError:
    impression = next((text for magic, text in _OTHERS if head.startswith(magic)), None)
    if impression is None and _looks_like_obj(head):
        return _misnamed(path, "OBJ", "the ending .obj")
    if impression is None:
        impression = f"a file that begins with the bytes {head[:8].hex(' ')}"
    return refusal(
        path,
        f"is no cloud that can be read: it looks like {impression}",
        expected=f"the content of one of {', '.join(SUFFIXES)}",
        fix="write the points as binary PLY, LAZ or npz",
    )


def _vertices(mesh: Mesh) -> FileCloud:
    kind = mesh.kind.replace("mesh", "points")
    read = partial(_slices, Cloud(mesh.vertices, mesh.colours))
    return FileCloud(mesh.path, kind, len(mesh.vertices), read, mesh.precision, mesh.notes)


def _slices(cloud: Cloud, points: int) -> Iterator[Cloud]:
    for start in range(0, len(cloud), points):
        part = slice(start, start + points)
        colours = None if cloud.colours is None else cloud.colours[part]
        yield Cloud(cloud.points[part], colours)
