"""Files under wrong names, files that are none, and damage of every kind."""

from __future__ import annotations

import contextlib
import gzip
import random
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from tests.formats.cloud_support import (
    colours_of,
    made,
    opened,
    points_of,
    refused,
    text_rows,
    write_las,
    write_pcd,
    write_ply,
)
from tests.formats.mesh_support import (
    OBJ_CUBE,
    OFF_CUBE,
    QUAD_HEADER,
    cube_columns,
    cube_document,
    quads,
    write_glb,
    write_gltf,
    write_stl,
    write_stl_text,
)

NAMES = (
    "little.ply", "big.ply", "text.ply", "mesh.ply", "mesh_text.ply", "ascii.pcd", "binary.pcd",
    "compressed.pcd", "a.las", "a.laz", "a7.laz", "a.npz", "small.npz", "a.npy", "a.obj", "a.glb",
    "a.gltf", "a.stl", "text.stl", "a.off", "a.csv", "a.pts", "six.npy", "a.ply.gz", "a.xyz.gz",
)  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the bytes of a valid file of every kind, by name."""
    folder, columns = tmp_path_factory.mktemp("clouds"), made()
    write_ply(folder / "little.ply", columns)
    write_ply(folder / "big.ply", columns, ">")
    write_ply(folder / "text.ply", columns, "")
    for name, order in (("mesh.ply", "<"), ("mesh_text.ply", "")):
        write_ply(
            folder / name, cube_columns(), order, faces_header=QUAD_HEADER, faces=quads(order)
        )
    write_pcd(folder / "ascii.pcd", columns, "ascii")
    write_pcd(folder / "binary.pcd", columns, "binary")
    write_pcd(folder / "compressed.pcd", columns, "binary_compressed")
    write_las(folder / "a.las", columns)
    write_las(folder / "a.laz", columns)
    write_las(folder / "a7.laz", columns, 7)
    np.savez(folder / "a.npz", points=points_of(columns), colours=colours_of(columns))
    np.savez_compressed(folder / "small.npz", points=points_of(columns))
    np.save(folder / "a.npy", points_of(columns))
    (folder / "a.obj").write_text(OBJ_CUBE)
    write_glb(folder / "a.glb", *cube_document())
    write_gltf(folder / "a.gltf")
    write_stl(folder / "a.stl")
    write_stl_text(folder / "text.stl")
    (folder / "a.off").write_text(OFF_CUBE)
    (folder / "a.csv").write_text("x,y,z,r,g,b\n" + text_rows(columns, ","))
    (folder / "a.pts").write_text("40\n" + text_rows(columns))
    np.save(folder / "six.npy", np.hstack((points_of(columns), colours_of(columns))))
    (folder / "a.ply.gz").write_bytes(gzip.compress((folder / "little.ply").read_bytes(), mtime=0))
    (folder / "a.xyz.gz").write_bytes(gzip.compress(text_rows(columns).encode(), mtime=0))
    return {name: (folder / name).read_bytes() for name in NAMES}


@pytest.mark.parametrize("name", NAMES)
def test_whole_files_are_read_twice_alike(
    name: str, whole: dict[str, bytes], tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(whole[name])
    source = opened(tmp_path / name)
    first, second = ([piece.points for piece in source.pieces(n)] for n in (9, 1000))
    np.testing.assert_array_equal(np.concatenate(first), np.concatenate(second))
    assert sum(map(len, first)) == source.count


@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_ending_is_named(name: str, whole: dict[str, bytes], tmp_path: Path) -> None:
    if name.endswith((".gz", ".csv", ".pts", ".gltf", "a.stl")):
        pytest.skip("its first bytes tell nothing of what it is")
    for suffix in (".ply", ".pcd", ".laz", ".npz", ".npy", ".obj", ".glb", ".txt"):
        kinds = {".las": ".laz"}
        if kinds.get(Path(name).suffix, Path(name).suffix) == suffix:
            continue
        (tmp_path / f"b{suffix}").write_bytes(whole[name])
        with refused("content is that of"):
            opened(tmp_path / f"b{suffix}")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\x89HDF\r\n\x1a\n", "HDF5"),
        (b"version https://git-lfs.github.com/spec/v1\noid", "Git LFS"),
        (b"<!DOCTYPE html>", "HTML"),
        (b"\x1f\x8b\x08", "gzip"),
        (b'{"asset": {"version": "2.0"}}', "JSON"),
        (b"\x80\x04\x95", "pickle"),
        (b"1 2 3\n4 5 6\n", "begins with the bytes"),
    ],
)
@pytest.mark.parametrize("name", ["a.ply", "a.npz", "a.obj", "a.dat", "a"])
def test_what_is_no_cloud(content: bytes, message: str, name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with refused(message) as caught:
        opened(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


def test_nothing_and_folders(tmp_path: Path) -> None:
    with refused("no such file"):
        opened(tmp_path / "a.ply")
    with refused("a folder"):
        opened(tmp_path)


@pytest.mark.parametrize("name", NAMES)
def test_damage_gives_a_message_or_points(
    name: str, whole: dict[str, bytes], tmp_path: Path
) -> None:
    dice = random.Random(name)
    for _ in range(12):
        raw = bytearray(whole[name])
        for _ in range(dice.randrange(1, 7)):
            place = dice.randrange(min(len(raw), dice.choice([700, len(raw)])))
            raw[place] = dice.choice([0, 255, 57, 45, 10, dice.randrange(256)])
        if dice.random() < 0.5:
            raw = raw[: dice.randrange(len(raw))]
        (tmp_path / name).write_bytes(raw)
        with contextlib.suppress(PredictionError):
            source = opened(tmp_path / name)
            assert sum(len(piece) for piece in source.pieces(4096)) == source.count


@pytest.mark.parametrize(
    ("name", "content", "left"),
    [
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
            b"property float z\nend_header\n1 2 3\n4 5 6\n7 8 9\n\n1 1 1",
            "2 lines",
        ),
        (
            "a.pcd",
            b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 2\nDATA ascii\n"
            b"1 2 3\n4 5 6\n7 8 9\n",
            "1 lines",
        ),
        (
            "a.pcd",
            b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 2\nDATA binary\n"
            + bytes(36),
            "12 bytes",
        ),
    ],
)
def test_points_that_a_header_does_not_count_are_named(
    name: str, content: bytes, left: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    (note,) = opened(tmp_path / name).notes
    assert note == f"{left} follow the 2 points that its header promises: not read"
    count = content.replace(b"vertex 2", b"vertex 4").replace(b"POINTS 2", b"POINTS 3")
    (tmp_path / name).write_bytes(count)
    assert opened(tmp_path / name).notes == ()
