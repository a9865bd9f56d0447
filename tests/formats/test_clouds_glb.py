"""GLB and glTF: transforms, buffers, and documents that are wrong."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.formats.clouds.meshes import MeshSampling
from tests.formats.cloud_support import joined, opened, read, refused
from tests.formats.mesh_support import CUBE, cube_document, on_cube, write_glb


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


def test_glb_of_points(tmp_path: Path) -> None:
    document, body = cube_document()
    document["meshes"][0]["primitives"] = [{"mode": 0, "attributes": {"POSITION": 0}}]
    document["nodes"] = [{"mesh": 0}]
    cloud = read(write_glb(tmp_path / "a.glb", document, body))
    np.testing.assert_array_equal(cloud.points, CUBE)


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
        (damaged, edit("buffers", 0, "uri", value="data:application/octet-stream;base64,AAAA")),
        ("compressed", edit("extensionsRequired", value=["KHR_draco_mesh_compression"])),
        (damaged, edit("nodes", 1, "children", value=[0])),
        (damaged, edit("nodes", 0, "children", value=[7])),
        (damaged, edit("nodes", 0, "scale", value=[1, 2])),
        (damaged, edit("nodes", 0, "translation", value=[1, 2, float("nan")])),
        (damaged, edit("nodes", 0, "matrix", value="x")),
        (damaged, edit("accessors", 0, "count", value=10**15)),
        ("not there", edit("accessors", 0, "count", value=-1)),
        (damaged, edit("accessors", 0, "count", value=1.5)),
        (damaged, edit("accessors", 0, "byteOffset", value=90)),
        (damaged, edit("bufferViews", 0, "byteLength", value=10**9)),
        (damaged, edit("bufferViews", 0, "byteStride", value=10**9)),
        (damaged, edit("bufferViews", 0, "buffer", value=1)),
        (damaged, edit("accessors", 1, "count", value=35)),
        ("not there", edit("accessors", 0, "count", value=3)),
        ("neither", edit("nodes", value=[{}])),
        (damaged, edit("meshes", value=5)),
        (damaged, edit("scenes", value=[[1]])),
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


def test_a_corner_that_is_nan(tmp_path: Path) -> None:
    document, body = cube_document()
    path = write_glb(tmp_path / "a.glb", document, np.float32(np.nan).tobytes() + body[4:])
    with refused("NaN"):
        opened(path)


def test_a_buffer_written_out_in_the_file_is_read(tmp_path: Path) -> None:
    o3d = load_open3d()
    box = o3d.geometry.TriangleMesh.create_box(2.0, 3.0, 4.0)
    path = tmp_path / "box.glb"
    assert o3d.io.write_triangle_mesh(str(path), box)
    assert b"data:application/octet-stream;base64," in path.read_bytes()
    cloud = open_cloud(path, limit_bytes=1 << 24, sampling=MeshSampling(0, 1000, None, 1000))
    (piece,) = cloud.pieces(2000)
    np.testing.assert_allclose(np.sort(np.ptp(piece.points, axis=0)), (2, 3, 4), atol=0.05)


def test_a_buffer_that_is_no_base64_is_damaged(tmp_path: Path) -> None:
    o3d = load_open3d()
    path = tmp_path / "box.glb"
    o3d.io.write_triangle_mesh(str(path), o3d.geometry.TriangleMesh.create_box())
    head, body = path.read_bytes().split(b";base64,")
    path.write_bytes(head + b";base64,*" + body[1:])
    with pytest.raises(PredictionError, match="is damaged"):
        open_cloud(path, limit_bytes=1 << 24, sampling=MeshSampling(0, 10, None, 10))
