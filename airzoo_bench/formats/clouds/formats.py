"""Which reader a file is for: its first bytes decide, and its ending must agree."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.registry import resolve
from airzoo_bench.formats.clouds import arrays, xyz
from airzoo_bench.formats.clouds.cloud import FIX_COPY, Cloud, FileCloud, refusal
from airzoo_bench.formats.clouds.gzipped import Unpacked
from airzoo_bench.formats.clouds.meshes import Mesh, MeshSampling, sampled
from airzoo_bench.formats.clouds.suffixes import GZIPPED_SUFFIXES, KINDS, TEXT_SUFFIXES
from airzoo_bench.geometry.arrays import Floats

__all__ = ["open_cloud", "stem_of"]

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
_READERS = {
    "LAS or LAZ": "las:open_las",
    "npy": "arrays:open_npy",
    "text": "xyz:open_text",
    "PLY": "ply:open_ply",
    "PCD": "pcd:open_pcd",
    "GLB": "mesh_files:open_gltf",
    "glTF": "mesh_files:open_gltf",
    "STL": "mesh_files:open_stl",
    "OFF": "mesh_files:open_off",
    "OBJ": "mesh_files:open_obj",
}
_OTHERS = (
    (b"version https://git-lfs", "a Git LFS pointer, not the file itself"),
    (b"\x1f\x8b", "a gzip file"),
    (b"7z\xbc\xaf", "a 7z archive"),
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"\x89HDF", "an HDF5 file"),
    (b"ASTM-E57", "an E57 file"),
    (b"%PDF", "a PDF"),
    (b"\x80\x04\x95", "a Python pickle"),
    (b"<", "HTML or XML"),
    (b"{", "JSON"),
)
_OBJ_STARTS = (b"#", b"v ", b"v\t", b"vn ", b"vt ", b"f ", b"o ", b"g ", b"mtllib ", b"usemtl ")


def stem_of(name: str) -> str:
    """Return the name of a file without its ending, which may be of two parts: ``.ply.gz``."""
    path = Path(name)
    return path.with_suffix("").stem if name.lower().endswith(GZIPPED_SUFFIXES) else path.stem


def open_cloud(path: Path, *, limit_bytes: int, sampling: MeshSampling | None) -> FileCloud:
    """Open a cloud, or a mesh as points on its surface."""
    if not (path.is_file() and path.name.lower().endswith(GZIPPED_SUFFIXES)):
        return _open_plain(path, limit_bytes, sampling)
    unpacked = Unpacked(path)
    try:
        return unpacked.cloud(_open_plain(unpacked.path, limit_bytes, sampling))
    except PredictionError as error:
        raise unpacked.named(error) from error


def _open_plain(path: Path, limit_bytes: int, sampling: MeshSampling | None) -> FileCloud:
    opened = _open(path, _kind(path), limit_bytes)
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
    if kind == "npz or zip":
        return arrays.open_npz(path, limit_bytes)
    opened: FileCloud | Mesh = resolve(f"{__package__}.{_READERS[kind]}")(path)
    return opened


def _kind(path: Path) -> str:
    if not path.is_file():
        what = "a folder, not a file" if path.is_dir() else "no such file"
        raise refusal(path, what, expected=f"one of {KINDS}")
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
    found = _kind_by_ending(suffix, head)
    if found is None:
        raise _unknown(path, head)
    return found


def _kind_by_ending(suffix: str, head: bytes) -> str | None:
    """Return the kind of a file without first bytes of its own, by its ending and content."""
    fits = {
        ".obj": ("OBJ", _looks_like_obj(head)),
        ".pcd": ("PCD", b"FIELDS" in head),
        ".stl": ("STL", b"\0" in head or _text_mesh(head) == "STL"),
        ".off": ("OFF", _looks_like_off(head)),
        ".gltf": ("glTF", head.lstrip().startswith(b"{")),
    } | dict.fromkeys(TEXT_SUFFIXES, ("text", xyz.looks_like_text(head)))
    kind, is_so = fits.get(suffix, (None, False))
    return kind if is_so and not _looks_like_other(suffix, head) else None


def _looks_like_other(suffix: str, head: bytes) -> bool:
    """Say whether what ends as text is a mesh in text."""
    return suffix in TEXT_SUFFIXES and _text_mesh(head) is not None


def _text_mesh(head: bytes) -> str | None:
    if head.lstrip().startswith(b"solid ") and b"facet" in head:
        return "STL"
    if _looks_like_off(head):
        return "OFF"
    return "OBJ" if _looks_like_obj(head) and not head.lstrip().startswith(b"#") else None


def _looks_like_off(head: bytes) -> bool:
    lines = [line.split() for line in head.split(b"\n") if line.split()]
    words = [line[0] for line in lines if not line[0].startswith(b"#")]
    return b"\0" not in head and words[:1] in ([b"OFF"], [b"COFF"], [b"NOFF"], [b"CNOFF"])


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
    mesh = _text_mesh(head) or ("OBJ" if _looks_like_obj(head) else None)
    if impression is None and mesh is not None:
        return _misnamed(path, mesh, f"the ending .{mesh.lower()}")
    if impression is None:
        impression = f"a file that begins with the bytes {head[:8].hex(' ')}"
    return refusal(
        path,
        f"is no cloud that can be read: it looks like {impression}",
        expected=f"the content of one of {KINDS}",
        fix="write the points as binary PLY, LAZ or npz",
    )


def _vertices(mesh: Mesh) -> FileCloud:
    kind = mesh.kind.replace("mesh", "points")
    read = partial(_slices, mesh.vertices)
    return FileCloud(mesh.path, kind, len(mesh.vertices), read, mesh.precision, mesh.notes)


def _slices(vertices: Floats, points: int) -> Iterator[Cloud]:
    for start in range(0, len(vertices), points):
        yield Cloud(vertices[start : start + points])
