"""Which reader a cloud or mesh is for: the ending says so, and the first bytes must agree."""

from __future__ import annotations

import re
from pathlib import Path

from airzoo_bench.core.errors import FIX_COPY
from airzoo_bench.core.registry import resolve
from airzoo_bench.formats.clouds.cloud import ArrayPieces, FileCloud, refusal
from airzoo_bench.formats.clouds.meshes import Mesh, MeshSampling, sampled
from airzoo_bench.formats.clouds.suffixes import KINDS, TEXT_SUFFIXES

_HEAD_BYTES = 4096
_BINARY = re.compile(rb"[\x00-\x08\x0e-\x1f]")
_COMMENTS = rb"(#[^\n]*\n|\s)*"
# What the first bytes of a file look like, what it is, its endings and its reader; the first that
# fits is taken.
_LOOKS: tuple[tuple[bytes, str, tuple[str, ...], str], ...] = (
    (rb"ply[\r\n]", "PLY", (".ply",), "ply:open_ply"),
    (rb"LASF", "LAS or LAZ", (".las", ".laz"), "las:open_las"),
    (rb"\x93NUMPY", "npy", (".npy",), "cloud:open_npy"),
    (rb"PK[\x03\x05][\x04\x06]", "npz or zip", (".npz",), "cloud:open_npz"),
    (rb"glTF", "GLB", (".glb",), "mesh_files:open_gltf"),
    (_COMMENTS + rb"(VERSION|FIELDS)\s", "PCD", (".pcd",), "pcd:open_pcd"),
    (rb"version https://git-lfs", "a Git LFS pointer, not the file itself", (), ""),
    (rb"\x1f\x8b", "a gzip file, which is to be unpacked", (), ""),
    (rb"\s*<", "HTML or XML", (), ""),
    (rb"\s*\{", "glTF or JSON", (".gltf",), "mesh_files:open_gltf"),
    (rb"(\s*solid\s.*facet|C?N?OFF\s|\x89HDF|ASTM-E57)", "STL, OFF, HDF5 or E57", (), ""),
    (_COMMENTS + rb"(v[nt]?|f|[og]|s|mtllib|usemtl)\s", "OBJ", (".obj",), "mesh_files:open_obj"),
    (rb".*\d", "text", TEXT_SUFFIXES, "text:open_text"),
)


def open_cloud(path: Path, *, limit_bytes: int, sampling: MeshSampling | None) -> FileCloud:
    """Open a cloud, or a mesh as points on its surface."""
    read = resolve(f"{__package__}.{_reader_of(path)}")
    limits = (limit_bytes,) if path.suffix.lower() == ".npz" else ()
    opened: FileCloud | Mesh = read(path, *limits)
    if isinstance(opened, FileCloud):
        return opened
    if not len(opened.faces):
        kind, pieces = opened.kind.replace("mesh", "points"), ArrayPieces(opened.vertices)
        count = len(opened.vertices)
        return FileCloud(path, kind, count, pieces, opened.precision, opened.notes)
    if sampling is None:
        what = "is a mesh, and the protocol does not say how meshes are sampled"
        fix = "sample the mesh and give the points"
        raise refusal(path, what, expected="points", fix=fix)
    return sampled(opened, sampling)


def _reader_of(path: Path) -> str:
    """Return the function that reads a file, after a check of its first bytes."""
    if not path.is_file():
        what = "a folder, not a file" if path.is_dir() else "no such file"
        raise refusal(path, what, expected=f"one of {KINDS}")
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    if not head:
        raise refusal(path, "is empty", fix=FIX_COPY)
    looks = [one[1:] for one in _LOOKS if re.match(one[0], head, re.DOTALL)]
    if _BINARY.search(head):
        looks = [one for one in looks[:1] if one[0] not in ("text", "OBJ")]
    found, suffixes, reader = looks[0] if looks else ("", (), "")
    if path.suffix.lower() not in suffixes:
        unknown = f"no cloud: it begins with the bytes {head[:8].hex(' ')}"
        raise refusal(
            path,
            f"is named {path.suffix[:20]!r}, and its content is that of {found or unknown}",
            expected=f"the content of one of {KINDS}, named as what it is",
            fix="give it the ending of what it is, or write the points as PLY, LAZ or npz",
        )
    return reader
