"""Which reader a cloud or mesh is for: the ending says so, and the first bytes must agree."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

from airzoo_bench.core.registry import resolve
from airzoo_bench.formats.clouds.cloud import FIX_COPY, ArrayPieces, FileCloud, refusal
from airzoo_bench.formats.clouds.meshes import Mesh, MeshSampling, sampled
from airzoo_bench.formats.clouds.suffixes import KINDS, TEXT_SUFFIXES

__all__ = ["open_cloud"]

_READERS = {
    ".ply": ("PLY", "ply:open_ply"),
    ".pcd": ("PCD", "pcd:open_pcd"),
    ".las": ("LAS or LAZ", "las:open_las"),
    ".laz": ("LAS or LAZ", "las:open_las"),
    ".npz": ("npz or zip", "arrays:open_npz"),
    ".npy": ("npy", "arrays:open_npy"),
    **dict.fromkeys(TEXT_SUFFIXES, ("text", "text:open_text")),
    ".obj": ("OBJ", "mesh_files:open_obj"),
    ".stl": ("STL", "mesh_files:open_stl"),
    ".gltf": ("glTF or JSON", "mesh_files:open_gltf"),
    ".glb": ("GLB", "mesh_files:open_gltf"),
}
_HEAD_BYTES = 4096
_BINARY = re.compile(rb"[\x00-\x08\x0e-\x1f]")
# What the first bytes of a file look like; the first that fits is taken.
_LOOKS = tuple(
    (re.compile(pattern, re.DOTALL), kind)
    for pattern, kind in (
        (rb"ply[\r\n]", "PLY"),
        (rb"LASF", "LAS or LAZ"),
        (rb"\x93NUMPY", "npy"),
        (rb"PK[\x03\x05][\x04\x06]", "npz or zip"),
        (rb"glTF", "GLB"),
        (rb"(#[^\n]*\n|\s)*(VERSION|FIELDS)\s", "PCD"),
        (rb"version https://git-lfs", "a Git LFS pointer, not the file itself"),
        (rb"\x1f\x8b", "a gzip file, which is to be unpacked"),
        (rb"7z\xbc\xaf", "a 7z archive"),
        (rb"\x89PNG|\xff\xd8\xff", "an image"),
        (rb"\x89HDF", "an HDF5 file"),
        (rb"ASTM-E57", "an E57 file"),
        (rb"%PDF", "a PDF"),
        (rb"\x80[\x02-\x05]", "a Python pickle"),
        (rb"\s*<", "HTML or XML"),
        (rb"\s*\{", "glTF or JSON"),
        (rb"\s*solid\s.*facet", "STL"),
        (rb"(#[^\n]*\n|\s)*C?N?OFF\s", "OFF"),
        (rb"(#[^\n]*\n|\s)*(v[nt]?|f|[og]|s|mtllib|usemtl)\s", "OBJ"),
        (rb".*\d", "text"),
    )
)


def open_cloud(path: Path, *, limit_bytes: int, sampling: MeshSampling | None) -> FileCloud:
    """Open a cloud, or a mesh as points on its surface."""
    reader = _reader(path)
    if path.suffix.lower() == ".npz":
        reader = partial(reader, limit_bytes=limit_bytes)
    opened: FileCloud | Mesh = reader(path)
    if isinstance(opened, FileCloud):
        return opened
    if not len(opened.faces):
        kind, read = opened.kind.replace("mesh", "points"), ArrayPieces(opened.vertices)
        count = len(opened.vertices)
        return FileCloud(path, kind, count, read, opened.precision, opened.notes)
    if sampling is None:
        raise refusal(
            path,
            "is a mesh, and the protocol does not say how meshes are sampled",
            expected="points",
            fix="sample the mesh and give the points",
        )
    return sampled(opened, sampling)


def _reader(path: Path) -> partial[FileCloud | Mesh]:
    """Return what reads a file, once its first bytes are those of its kind."""
    if not path.is_file():
        what = "a folder, not a file" if path.is_dir() else "no such file"
        raise refusal(path, what, expected=f"one of {KINDS}")
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    if not head:
        raise refusal(path, "is empty", fix=FIX_COPY)
    kind, reader = _READERS.get(path.suffix.lower(), ("", ""))
    found = next((what for looks, what in _LOOKS if looks.match(head)), "")
    if found in ("text", "OBJ") and _BINARY.search(head):
        found = ""
    if kind == "STL" and (not found or b"\0" in head):  # binary, which has no first bytes
        found = kind
    if found != kind or not kind:
        raise refusal(
            path,
            f"is named {path.suffix[:20]!r}, and its content is that of "
            + (found or f"no cloud: it begins with the bytes {head[:8].hex(' ')}"),
            expected=f"the content of one of {KINDS}, named as what it is",
            fix="give it the ending of what it is, or write the points as PLY, LAZ or npz",
        )
    return partial(resolve(f"{__package__}.{reader}"))
