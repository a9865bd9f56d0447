"""Meshes: sampled by area, the same bytes for every block; files are read right, or refused."""

from __future__ import annotations

import base64
import copy
import hashlib
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import MeshSampling
from airzoo_bench.formats.clouds.meshes import Mesh, cloud_of_mesh, cut_fans
from tests.formats.cloud_support import opened, read, refused, write_ply

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
FACES = np.concatenate([cut_fans(quad[None]) for quad in QUADS])
COLUMNS = dict(zip("xyz", CUBE.T, strict=True))
QUAD_HEADER = "element face 6\nproperty list uchar int vertex_indices"
BINARY_QUADS = {
    order: b"".join(struct.pack(f"{order}B4i", 4, *quad) for quad in QUADS.tolist())
    for order in "<>"
}
TEXT_QUADS = "".join(f"4 {' '.join(map(str, quad))}\n" for quad in QUADS.tolist()).encode()
OBJ = "mtllib /etc/passwd\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in CUBE.tolist()) + "s off\n"
OBJ += "".join("f {}/1/1 {}//1 {} {}\n".format(*(quad + 1)) for quad in QUADS)


def on_cube(points: Any, low: Any = 0.0, side: float = 1.0) -> bool:
    local = (points - low) / side
    inside = (local >= -1e-9).all() and (local <= 1 + 1e-9).all()
    return bool(inside and (np.minimum(np.abs(local), np.abs(local - 1)).min(axis=1) < 1e-6).all())


def sample_mesh(vertices: Any, faces: Any, *, count: int, seed: int, block: int = 1 << 20) -> Any:
    """Sample a mesh in blocks of so many points."""
    mesh = Mesh(Path("made"), "made", vertices, faces)
    cloud = cloud_of_mesh(mesh, MeshSampling(seed, count, None, 1 << 20))
    return np.concatenate([piece.points for piece in cloud.pieces(block)])


SAMPLE = sample_mesh(CUBE, FACES, count=500, seed=7)


def test_a_hand_worked_pair_of_triangles() -> None:
    # The areas are 1/2 and 3/2, so that a quarter of the points lies in the first triangle.
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 5], [3, 0, 5], [0, 1, 5]])
    points = sample_mesh(vertices, np.array([[0, 1, 2], [3, 4, 5]]), count=4000, seed=1)
    low = points[:, 2] == 0.0
    assert int(low.sum()) == 1000
    assert low[:1000].all()
    assert (points[low, 0] + points[low, 1] <= 1.0 + 1e-12).all()
    assert (points[~low, 0] / 3 + points[~low, 1] <= 1.0 + 1e-12).all()
    # The mean of a triangle is the mean of its corners.
    np.testing.assert_allclose(points[low].mean(axis=0), [1 / 3, 1 / 3, 0], atol=0.02)
    np.testing.assert_allclose(points[~low].mean(axis=0), [1, 1 / 3, 5], atol=0.05)


def test_points_are_uniform_on_the_surface() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3)
    points = sample_mesh(np.array(mesh.vertices), np.array(mesh.faces), count=20_000, seed=5)
    # On the unit sphere z is uniform (Archimedes): second moment 1/3, and no face is preferred.
    np.testing.assert_allclose((points**2).mean(axis=0), 1 / 3, atol=0.01)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=0.01)
    assert len(np.unique(points, axis=0)) == 20_000


@given(st.integers(1, 300), st.integers(0, 2**64 - 1), st.integers(1, 50))
def test_blocks_do_not_matter(count: Any, seed: Any, block: Any) -> None:
    whole = sample_mesh(CUBE, FACES, count=count, seed=seed)
    parts = sample_mesh(CUBE, FACES, count=count, seed=seed, block=block)
    np.testing.assert_array_equal(parts, whole)
    assert on_cube(whole)


def test_the_bytes_of_a_sample_are_fixed() -> None:
    corners = CUBE * (3.7, 2.1, 1.3) + 5_188_114.1
    points = np.concatenate([sample_mesh(corners, FACES, count=31, seed=s) for s in range(9)])
    digest = hashlib.sha256(points.astype("<f8").tobytes()).hexdigest()
    assert digest == "b147b111fb4001e7cdf5312c39b927f2dfebdd86a6bcd3a3cfb88d36422ddc5c"


def test_faces_without_area_get_no_point_and_far_ones_lose_nothing() -> None:
    faces = np.concatenate([[[0, 0, 0]], FACES[:2], [[1, 1, 2]]])
    assert (sample_mesh(CUBE, faces, count=1000, seed=3)[:, 0] == 0.0).all()
    offset = np.array([2.0**22, 2.0**23, 0.0])
    far = sample_mesh(CUBE + offset, FACES, count=500, seed=7)
    assert np.abs(far - offset - SAMPLE).max() < 2e-9


@pytest.mark.parametrize("order", ["<", ">", ""])
def test_ply_meshes(order: str, tmp_path: Path) -> None:
    faces = BINARY_QUADS.get(order, TEXT_QUADS)
    path = write_ply(tmp_path / "a.ply", COLUMNS, order, faces_header=QUAD_HEADER, faces=faces)
    np.testing.assert_array_equal(read(path).points, SAMPLE)
    assert "12 faces" in opened(path).notes[0]


def test_ply_of_triangles_and_quads_mixed(tmp_path: Path) -> None:
    header = "element face 4\nproperty uchar flags\nproperty list uchar uint vertex_index\n"
    header += "property float w"
    polygons = [(0, 1, 3), (0, 3, 2), (4, 6, 7, 5), (0, 4, 5)]
    text = "".join(f"1 {len(p)} {' '.join(map(str, p))} .5\n" for p in polygons).encode()
    binary = b"".join(struct.pack(f"<BB{len(p)}If", 1, len(p), *p, 0.5) for p in polygons)
    want = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5]])
    expected = sample_mesh(CUBE, want, count=500, seed=7)
    for order, faces in (("", text), ("<", binary)):
        path = write_ply(tmp_path / "a.ply", COLUMNS, order, faces_header=header, faces=faces)
        np.testing.assert_array_equal(read(path).points, expected)
        path.write_bytes(path.read_bytes()[:-9])
        with pytest.raises(PredictionError):
            read(path)


def test_obj(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    for text in (OBJ, OBJ.replace("f 1/1/1 2//1 4 3", "f -8 -7/2 -5//3 -6")):
        path.write_text(text)
        np.testing.assert_array_equal(read(path).points, SAMPLE)
    path.write_text("# made\nv 1 2 3 1 0.5 0\nv 4 5 6 0 0 1\n")
    assert read(path).points.tolist() == [[1, 2, 3], [4, 5, 6]]
    one = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl b\nf -3 -2 -1\n"
    path.write_text(one + one.replace("v ", "v 5").replace("l b", "l a"))
    points = read(path).points  # faces of several materials stay in their order
    assert (points[:50, 0] <= 1).all()
    assert (points[-50:, 0] >= 50).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200, 99, -1])
def test_meshes_that_cannot_be_sampled(value: float, tmp_path: Path) -> None:
    columns, faces = COLUMNS | {"x": COLUMNS["x"].copy()}, BINARY_QUADS["<"]
    if value in (99, -1):
        faces = faces.replace(struct.pack("<i", 5), struct.pack("<i", value))
    else:
        columns["x"][0] = value
    with refused("not there" if value in (99, -1) else "NaN, infinite or absurdly far"):
        opened(write_ply(tmp_path / "a.ply", columns, faces_header=QUAD_HEADER, faces=faces))


def test_how_many_points_a_mesh_gets(tmp_path: Path) -> None:
    faces = {"faces_header": QUAD_HEADER, "faces": BINARY_QUADS["<"]}
    path = write_ply(tmp_path / "a.ply", COLUMNS, **faces)
    density = MeshSampling(seed=0, count=None, per_square_unit=100.0, max_points=1000)
    assert opened(path, sampling=density).count == 600
    denser = MeshSampling(seed=0, count=None, per_square_unit=1e4, max_points=1000)
    for sampling, message in ((denser, "6e\\+04 points"), (None, "how meshes are sampled")):
        with refused(message):
            opened(path, sampling=sampling)


@pytest.mark.parametrize("suffix", ["glb", "obj", "ply"])
def test_what_trimesh_writes(suffix: str, tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=3.0)
    mesh.apply_translation([5, 6, 7])
    mesh.export(tmp_path / f"a.{suffix}")
    points = read(tmp_path / f"a.{suffix}", 99).points
    _, distance, _ = trimesh.proximity.closest_point_naive(mesh, points)
    assert distance.max() < 1e-4


BODY = CUBE.astype("<f4").tobytes() + FACES.astype("<u2").tobytes()
DOCUMENT: dict[str, Any] = {
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


def edited(*path: Any, value: Any) -> dict[str, Any]:
    document = place = copy.deepcopy(DOCUMENT)
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return document


def write_glb(path: Path, document: dict[str, Any]) -> Path:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(BODY), 0x004E4942) + BODY
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
    return path


def test_gltf_with_the_transforms_of_its_nodes(tmp_path: Path) -> None:
    uri = "data:application/octet-stream;base64," + base64.b64encode(BODY).decode()
    (tmp_path / "a.gltf").write_text(json.dumps(edited("buffers", 0, "uri", value=uri)))
    for path in (tmp_path / "a.gltf", write_glb(tmp_path / "a.glb", DOCUMENT)):
        assert on_cube(read(path).points, low=(10.0, 0.0, 0.0), side=2.0)
        assert "surface of 24" in opened(path).notes[-1]
    half = np.sqrt(0.5)
    turned = edited("nodes", 0, "rotation", value=[0, 0, half, half])
    points = read(write_glb(tmp_path / "a.glb", turned)).points
    assert on_cube(points, low=(8.0, 0.0, 0.0), side=2.0)


@pytest.mark.parametrize(
    "document",
    [
        edited("buffers", 0, "uri", value="http://example.org/x.bin"),
        edited("buffers", 0, "uri", value="/etc/passwd"),
        edited("extensionsRequired", value=["KHR_draco_mesh_compression"]),
        edited("nodes", 1, "children", value=[0]),
        edited("nodes", 0, "translation", value=[float("nan"), 0, 0]),
        edited("accessors", 0, "count", value=10**15),
        edited("accessors", 0, "count", value=3),
        edited("nodes", value=[{}]),
        edited("meshes", value=5),
    ],
)
def test_wrong_glb(document: Any, tmp_path: Path) -> None:
    with pytest.raises(PredictionError):
        read(write_glb(tmp_path / "a.glb", document))
    whole = write_glb(tmp_path / "a.glb", DOCUMENT).read_bytes()
    for share in (0.1, 0.5, 0.99):
        (tmp_path / "a.glb").write_bytes(whole[: int(len(whole) * share)])
        with pytest.raises(PredictionError):
            opened(tmp_path / "a.glb")
