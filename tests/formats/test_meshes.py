"""Meshes: sampled by area, the same bytes for every block; files are read right, or refused."""

from __future__ import annotations

import copy
import hashlib
from array import array
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.formats.clouds.meshes import Mesh, MeshSampling, add_fan, cut_fans, sampled
from tests.formats.cloud_support import joined, opened, read, refused, write_ply
from tests.formats.mesh_support import (
    CUBE,
    CUBE_QUADS,
    OBJ_CUBE,
    QUAD_HEADER,
    cube_columns,
    cube_document,
    on_cube,
    quads,
    write_glb,
    write_gltf,
)

CUBE_FACES = np.concatenate([cut_fans(quad[None]) for quad in CUBE_QUADS])


def sample_mesh(vertices: Any, faces: Any, *, count: int, seed: int, block: int = 1 << 20) -> Any:
    """Sample a mesh in blocks of so many points."""
    mesh = Mesh(Path("made"), "made", vertices, faces)
    cloud = sampled(mesh, MeshSampling(seed, count, None, 1 << 20))
    return np.concatenate([piece.points for piece in cloud.pieces(block)])


def test_a_hand_worked_pair_of_triangles() -> None:
    # The areas are 1/2 and 3/2, so that a quarter of the points lies in the first triangle.
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 5], [3, 0, 5], [0, 1, 5]])
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    points = sample_mesh(vertices, faces, count=4000, seed=1)
    low = points[:, 2] == 0.0
    assert int(low.sum()) == 1000
    assert (points[:1000, 2] == 0.0).all()
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


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 300), st.integers(0, 2**64 - 1), st.integers(1, 50))
def test_blocks_do_not_matter(count: int, seed: int, block: int) -> None:
    whole = sample_mesh(CUBE, CUBE_FACES, count=count, seed=seed)
    parts = sample_mesh(CUBE, CUBE_FACES, count=count, seed=seed, block=block)
    np.testing.assert_array_equal(parts, whole)
    assert on_cube(whole)


def test_the_bytes_of_a_sample_are_fixed() -> None:
    corners = CUBE * (3.7, 2.1, 1.3) + 5_188_114.1
    points = np.concatenate([sample_mesh(corners, CUBE_FACES, count=31, seed=s) for s in range(9)])
    digest = hashlib.sha256(points.astype("<f8").tobytes()).hexdigest()
    assert digest == "b147b111fb4001e7cdf5312c39b927f2dfebdd86a6bcd3a3cfb88d36422ddc5c"
    assert (sample_mesh(CUBE, CUBE_FACES, count=10, seed=1) != points[:10]).all()


def test_faces_without_area_get_no_point() -> None:
    faces = np.concatenate([[[0, 0, 0]], CUBE_FACES[:2], [[1, 1, 2]]])
    points = sample_mesh(CUBE, faces, count=1000, seed=3)
    assert (points[:, 0] == 0.0).all()


def test_far_from_the_origin_nothing_is_lost() -> None:
    offset = np.array([2.0**22, 2.0**23, 0.0])
    near = sample_mesh(CUBE, CUBE_FACES, count=500, seed=0)
    far = sample_mesh(CUBE + offset, CUBE_FACES, count=500, seed=0)
    assert np.abs(far - offset - near).max() < 2e-9


def test_polygons_become_fans_in_their_order() -> None:
    polygons = [[0, 1, 2, 3], [4, 5], [6, 7, 8], [], [9, 10, 11, 12, 13]]
    want = [[0, 1, 2], [0, 2, 3], [6, 7, 8], [9, 10, 11], [9, 11, 12], [9, 12, 13]]
    triangles = array("q")
    for polygon in polygons:
        add_fan(triangles, polygon)
    assert np.array(triangles).reshape(-1, 3).tolist() == want


@pytest.mark.parametrize("order", ["<", ">", ""])
def test_ply_meshes(order: str, tmp_path: Path) -> None:
    columns = cube_columns()
    path = write_ply(
        tmp_path / "a.ply", columns, order, faces_header=QUAD_HEADER, faces=quads(order)
    )
    cloud = read(path)
    np.testing.assert_array_equal(cloud.points, sample_mesh(CUBE, CUBE_FACES, count=500, seed=7))
    assert "12 faces" in opened(path).notes[0]


def test_ply_of_triangles_and_quads_mixed(tmp_path: Path) -> None:
    header = "element face 4\nproperty uchar flags\nproperty list uchar uint vertex_index\n"
    header += "property float w"
    text = "1 3 0 1 3 .5\n1 3 0 3 2 .5\n2 4 4 6 7 5 .1\n3 3 0 4 5 .1\n"
    record = {3: np.dtype("u1,u1,(3,)<u4,<f4"), 4: np.dtype("u1,u1,(4,)<u4,<f4")}
    rows = [
        (1, 3, (0, 1, 3), 0),
        (1, 3, (0, 3, 2), 0),
        (2, 4, (4, 6, 7, 5), 0),
        (3, 3, (0, 4, 5), 0),
    ]
    binary = b"".join(np.array([row], record[row[1]]).tobytes() for row in rows)
    a = write_ply(tmp_path / "a.ply", cube_columns(), "", faces_header=header, faces=text.encode())
    b = write_ply(tmp_path / "b.ply", cube_columns(), "<", faces_header=header, faces=binary)
    want = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5]]
    expected = sample_mesh(CUBE, np.array(want), count=500, seed=7)
    np.testing.assert_array_equal(read(a).points, expected)
    np.testing.assert_array_equal(read(b).points, expected)


def test_obj(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(OBJ_CUBE)
    source = opened(tmp_path / "a.obj")
    assert "mtllib" in source.notes[0]
    expected = sample_mesh(CUBE, CUBE_FACES, count=500, seed=7)
    np.testing.assert_array_equal(read(tmp_path / "a.obj").points, expected)
    relative = OBJ_CUBE.replace("f 1/1/1 2//1 4 3", "f -8 -7/2 -5//3 -6")
    assert relative != OBJ_CUBE
    (tmp_path / "b.obj").write_text(relative)
    np.testing.assert_array_equal(read(tmp_path / "b.obj").points, expected)


def test_obj_keeps_the_order_of_faces_of_several_materials(tmp_path: Path) -> None:
    one = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl b\nf -3 -2 -1\n"
    (tmp_path / "a.obj").write_text(one + one.replace("v ", "v 5").replace("l b", "l a"))
    points = read(tmp_path / "a.obj").points
    assert (points[:50, 0] <= 1).all()
    assert (points[-50:, 0] >= 50).all()


def test_obj_of_points(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("# made\nv 1 2 3 1 0.5 0\nv 4 5 6 0 0 1\n")
    cloud = read(tmp_path / "a.obj")
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("v 1 2", "a line is"),
        ("v 1 2 x", "a line is"),
        ("f 1 2 x", "a line is"),
        ("f 0 1 2", "a line is"),
        ("f -3 1 2", "a line is"),
        ("f 1 2 99", "not there"),
        ("f 1 2 99999999999999999999", "a line is"),
        ("f 1 1 1", "area of 0"),
    ],
)
def test_wrong_obj(line: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(f"v 0 0 0\nv 1 0 0\n{line}\n")
    with refused(message):
        read(tmp_path / "a.obj")


def test_meshes_that_cannot_be_sampled(tmp_path: Path) -> None:
    columns = cube_columns()
    columns["x"] = columns["x"].copy()
    path = tmp_path / "a.ply"
    for value, message in (
        (np.nan, "NaN, infinite"),
        (np.inf, "NaN, inf"),
        (1e200, "absurdly far"),
    ):
        columns["x"][0] = value
        write_ply(path, columns, faces_header=QUAD_HEADER, faces=quads())
        with refused(message):
            opened(path)
    for wrong in (99, -1):
        faces = quads().replace(np.array([5], "<i4").tobytes(), np.array([wrong], "<i4").tobytes())
        write_ply(path, cube_columns(), faces_header=QUAD_HEADER, faces=faces)
        with refused("not there"):
            opened(path)


def test_how_many_points_a_mesh_gets(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    write_ply(path, cube_columns(), faces_header=QUAD_HEADER, faces=quads())
    density = MeshSampling(seed=0, count=None, per_square_unit=100.0, max_points=1000)
    assert opened(path, sampling=density).count == 600
    denser = MeshSampling(seed=0, count=None, per_square_unit=1e4, max_points=1000)
    with refused("6e\\+04 points"):
        opened(path, sampling=denser)
    with refused("does not say how meshes are sampled"):
        opened(path, sampling=None)


def test_gltf(tmp_path: Path) -> None:
    path = write_gltf(tmp_path / "a.gltf")
    assert on_cube(read(path).points, low=(10.0, 0.0, 0.0), side=2.0)
    assert "surface of 24" in opened(path).notes[-1]
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(PredictionError):
        opened(path)


def test_glb_with_the_transforms_of_its_nodes(tmp_path: Path) -> None:
    document, body = cube_document()
    cloud = read(write_glb(tmp_path / "a.glb", document, body))
    assert len(cloud) == 500
    assert on_cube(cloud.points, low=(10.0, 0.0, 0.0), side=2.0)
    half = np.sqrt(0.5)
    document["nodes"][0]["rotation"] = [0, 0, half, half]
    turned = read(write_glb(tmp_path / "a.glb", document, body))
    assert on_cube(turned.points, low=(8.0, 0.0, 0.0), side=2.0)


@pytest.mark.parametrize("suffix", ["glb", "obj", "ply"])
def test_what_trimesh_writes(suffix: str, tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=3.0)
    mesh.apply_translation([5, 6, 7])
    mesh.export(tmp_path / f"a.{suffix}")
    source = opened(tmp_path / f"a.{suffix}")
    assert f"{mesh.area:.6g}" in source.notes[-1] or suffix == "obj"
    points = joined(list(source.pieces(99))).points
    _, distance, _ = trimesh.proximity.closest_point_naive(mesh, points)
    assert distance.max() < 1e-4


def wrong_documents() -> list[tuple[str, Any]]:
    def edit(*path: Any, value: Any) -> Any:
        document = copy.deepcopy(cube_document()[0])
        place = document
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value
        return document

    damaged = "damaged or cut off"
    return [
        ("uri", edit("buffers", 0, "uri", value="http://example.org/x.bin")),
        ("uri", edit("buffers", 0, "uri", value="/etc/passwd")),
        ("compressed", edit("extensionsRequired", value=["KHR_draco_mesh_compression"])),
        (damaged, edit("nodes", 1, "children", value=[0])),
        (damaged, edit("accessors", 0, "count", value=10**15)),
        ("not there", edit("accessors", 0, "count", value=3)),
        ("neither", edit("nodes", value=[{}])),
        (damaged, edit("meshes", value=5)),
    ]


@pytest.mark.parametrize(("message", "document"), wrong_documents())
def test_wrong_glb(message: str, document: Any, tmp_path: Path) -> None:
    path = write_glb(tmp_path / "a.glb", document, cube_document()[1])
    with refused(message):
        read(path)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_file_that_is_cut_off(share: float, tmp_path: Path) -> None:
    path = write_glb(tmp_path / "a.glb", *cube_document())
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with refused("damaged or cut off"):
        opened(path)


def test_a_buffer_written_out_in_the_file_is_read(tmp_path: Path) -> None:
    o3d = load_open3d()
    box = o3d.geometry.TriangleMesh.create_box(2.0, 3.0, 4.0)
    path = tmp_path / "box.glb"
    assert o3d.io.write_triangle_mesh(str(path), box)
    assert b"data:application/octet-stream;base64," in path.read_bytes()
    extent = np.ptp(read(path, 2000).points, axis=0)
    np.testing.assert_allclose(np.sort(extent), (2, 3, 4), atol=0.1)
