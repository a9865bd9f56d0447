"""Every format of clouds: what writers wrote comes back, and what a file lies about is refused.

Wrong texts and headers are in tests/goldens/refusals.txt.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.formats.clouds.las import open_shards
from airzoo_bench.formats.clouds.rows import unpack_lzf
from tests.formats.cloud_support import (
    COLOURS,
    WRITERS,
    Columns,
    joined,
    made,
    opened,
    points_of,
    read,
    refused,
    text_rows,
    write_las,
    write_ply,
)

COLUMNS = made()
POINTS = points_of(COLUMNS)
COLOURED = {name: COLUMNS[name] for name in ("x", "y", "z", *COLOURS)}
LAS = [name for name in WRITERS if name.startswith("format")]


FORMATS = pytest.mark.parametrize("name", WRITERS)


def write(path: Path, columns: Columns) -> Path:
    WRITERS[path.name](path, columns)
    return path


@FORMATS
def test_every_point_comes_back_in_any_pieces(name, tmp_path) -> None:
    path = write(tmp_path / name, COLUMNS)
    for points in (1, 7, 40, 1000):
        cloud = read(path, points)
        expected = np.asarray(laspy.read(path).xyz) if name in LAS else POINTS
        np.testing.assert_array_equal(cloud.points, expected)
        np.testing.assert_allclose(cloud.points, POINTS, rtol=0, atol=6e-4)
        if path.suffix in (".ply", ".npz"):
            np.testing.assert_array_equal(cloud.confidence, COLUMNS["confidence"])
        else:
            assert cloud.confidence is None


@FORMATS
def test_no_points_are_no_points_and_nan_is_nan(name, tmp_path) -> None:
    path = write(tmp_path / name, {key: column[:0] for key, column in COLUMNS.items()})
    assert opened(path).count == len(read(path)) == 0
    if name not in LAS:
        columns = made(4)
        columns["x"][:3] = np.nan, np.inf, -np.inf
        np.testing.assert_array_equal(read(write(path, columns)).points, points_of(columns))


@FORMATS
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
def test_a_file_that_is_cut_off_is_refused(name, share, tmp_path) -> None:
    path = write(tmp_path / name, made(300))
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with pytest.raises(PredictionError):
        read(path)


def state_count(path: Path, count: int) -> Path:
    """Write another number of points into the header of a file of 300."""
    raw = bytearray(path.read_bytes())
    if path.suffix in (".las", ".laz"):
        struct.pack_into("<I", raw, 107, count)
        if raw[25] >= 4:
            struct.pack_into("<Q", raw, 247, count)
    else:
        mark = {".ply": b"end_header", ".pcd": b"DATA", ".pts": b"\n", ".npy": b"}"}[path.suffix]
        head, end, body = bytes(raw).partition(mark)
        raw = bytearray(re.sub(rb"\b300\b", str(count).encode(), head) + end + body)
    path.write_bytes(raw)
    return path


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "a.npz"])
def test_a_header_that_counts_wrong_is_refused_or_said(name, tmp_path) -> None:
    path = tmp_path / name
    for count in (301, 320, 900, *([] if name == "a.npy" else [60_000, 4 * 10**9])):
        with pytest.raises(PredictionError):
            read(state_count(write(path, made(300)), count))
    said = len(opened(write(path, made(300))).notes)
    state_count(path, 100)
    if name in ("a.npy", "a.pts", "binary_compressed.pcd"):
        with pytest.raises(PredictionError):
            opened(path)
    elif name in ("format0.laz", "format3.laz"):  # which do not count the last chunk's points
        assert len(read(path)) == 100
    else:
        assert "follow the 100 points" in opened(path).notes[said]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\x89HDF\r\n\x1a\n", "HDF5"),
        (b"version https://git-lfs.github.com/spec/v1\noid", "Git LFS"),
        (b"<!DOCTYPE html>", "HTML"),
        (b"\x1f\x8b\x08", "gzip"),
        (b'{"asset": {"version": "2.0"}}', "JSON"),
        (b"\0\1\2", "begins with the bytes"),
        (b"OFF\n8 6 0\n1 2 3\n", "OFF"),
        (b"ply\n", "PLY"),
        (b"LASF", "LAS"),
    ],
)
def test_what_is_no_cloud_or_wrongly_named(content: bytes, message: str, tmp_path: Path) -> None:
    for name in ("a.pcd", "a.npz", "a.obj", "a.txt", "a.dat"):
        (tmp_path / name).write_bytes(content)
        with refused(message) as caught:
            opened(tmp_path / name)
        assert str(tmp_path / name) in str(caught.value)


def test_open3d_and_we_read_each_other(tmp_path: Path) -> None:
    o3d = load_open3d()
    theirs = o3d.io.read_point_cloud(str(write_ply(tmp_path / "a.ply", COLUMNS)))
    np.testing.assert_array_equal(np.asarray(theirs.points), POINTS)
    # Rows that repeat give the compression something to do, copies that overlap among them.
    near = np.repeat(np.random.default_rng(1).random((50, 3)).round(2), 30, 0)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(near))
    for suffix in ("ply", "pcd"):
        for as_text in (False, True):
            path = tmp_path / f"b.{suffix}"
            o3d.io.write_point_cloud(str(path), cloud, write_ascii=as_text, compressed=not as_text)
            np.testing.assert_allclose(read(path, 400).points, near, rtol=0, atol=1e-6)


def test_lzf_by_hand() -> None:
    assert unpack_lzf(b"\x02abc", 3) == b"abc"
    # Three literals, then a copy of 2 + 2 from 3 back, then a long one of 7 + 1 + 2 from 1 back.
    assert unpack_lzf(b"\x02abc\x40\x02\xe0\x01\x00", 17) == b"abcabca" + b"a" * 10
    for damaged in (b"\x02ab", b"\x20\x00", b"\x02abc\x40", b"\x02abc\x02abc", b"\x02abc\xe0"):
        with pytest.raises((IndexError, ValueError)):
            unpack_lzf(damaged, 3)


def test_kinds_of_ply(tmp_path: Path) -> None:
    path, xyz = tmp_path / "a.ply", {name: COLUMNS[name] for name in "xyz"}
    header = "element camera 2\nproperty float f\nelement odd 2\nproperty list uchar short n"
    before = struct.pack("<ffBhBhh", 1, 2, 1, 0, 2, 0, 0)
    for order, some in (("<", before), ("", b"1\n2\n1 0\n2 0 0\n")):
        write_ply(path, COLUMNS, order, before=some, before_header=header)
        np.testing.assert_array_equal(read(path).points, POINTS)
    splats = xyz | {n: np.zeros(40, "f4") for n in ("f_dc_0", "f_dc_1", "f_dc_2", "opacity")}
    assert "Gaussian" in opened(write_ply(path, splats)).notes[0]
    faceless = "element face 0\nproperty list uchar int vertex_indices"
    assert opened(write_ply(path, xyz, faces_header=faceless)).kind == "PLY (binary)"
    write_ply(path, {name.upper(): xyz[name] for name in xyz})
    np.testing.assert_array_equal(read(path).points, POINTS)
    # Text of a float property may have more digits than float32: all are kept.
    write_ply(path, COLUMNS, "")
    path.write_text(path.read_text().replace("property double", "property float"))
    np.testing.assert_array_equal(read(path).points, POINTS)


def test_padding_and_repeated_fields_of_pcd(tmp_path: Path) -> None:
    record = np.dtype([("x", "<f4"), ("_", "V4"), ("y", "<f4"), ("h", "<f4", 3), ("z", "<f4")])
    rows = np.zeros(3, record)
    rows["x"], rows["y"], rows["z"] = [1, 2, 3], [4, 5, 6], [7, 8, 9]
    head = (
        "VERSION .7\nFIELDS x _ y h z\nSIZE 4 1 4 4 4\nTYPE F U F F F\nCOUNT 1 4 1 3 1\n"
        "WIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA binary\n"
    )
    (tmp_path / "a.pcd").write_bytes(head.encode() + rows.tobytes())
    assert read(tmp_path / "a.pcd").points.tolist() == [[1, 4, 7], [2, 5, 8], [3, 6, 9]]


def test_what_follows_the_points_of_a_las_file_is_no_point(tmp_path: Path) -> None:
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.x, las.y, las.z = np.random.default_rng(0).integers(0, 900, (3, 300)) / 4.0
    las.evlrs = laspy.vlrs.vlrlist.VLRList()
    las.evlrs.append(laspy.VLR("someone", 1, "", b"x" * 5000))
    las.write(tmp_path / "a.las")
    assert opened(tmp_path / "a.las").notes == ()


def test_the_real_cloud(brighton: Path) -> None:
    path = brighton / "model.laz"
    np.testing.assert_array_equal(read(path, 50_001).points, np.asarray(laspy.read(path).xyz))


def test_shards_are_one_cloud_and_none_counts_twice(tmp_path: Path) -> None:
    names = ("a.las", "b.laz", "c.las")
    paths = [write_las(tmp_path / name, made(50, seed)) for seed, name in enumerate(names)]
    cloud = joined(open_shards(tmp_path, paths), 40)
    np.testing.assert_array_equal(cloud.points, np.concatenate([read(p).points for p in paths]))
    with refused("would count twice"):
        open_shards(tmp_path, [*paths, write_las(tmp_path / "a.laz", made(50))])


@pytest.mark.parametrize(
    ("name", "before", "separator"),
    [
        ("a.xyz", "", " "),
        ("a.txt", "# made by hand\n", "\t"),
        ("a.csv", "X,Y,Z,R,G,B\n", ","),
        ("b.csv", "\ufeffx [m];y [m];z [m];red;green;blue\n", ";"),
        ("c.csv", '"easting","northing","height","red","green","blue"\n', ", "),
        ("a.asc", "//X Y Z R G B\n40\n", " "),
        ("b.asc", "\n# one comment\n\n# another\n", " "),
        ("b.pts", "\ufeff", " "),
        ("A.TXT", "", ","),
    ],
)
def test_text_gives_the_same_points_whatever_the_writer(name, before, separator, tmp_path) -> None:
    (tmp_path / name).write_text(before + text_rows(COLOURED, separator), encoding="utf-8")
    np.testing.assert_array_equal(read(tmp_path / name).points, POINTS)
    (note,) = opened(tmp_path / name).notes
    assert note.endswith("x y z from 1, 2, 3; 3 of 6 passed over")


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("id,z,y,x\n7,3,2,1\n", "x y z from 4, 3, 2; 1 of 4 passed over"),
        ("1 2 3 90 1 2 3\n", "x y z from 1, 2, 3; 4 of 7 passed over"),
        ("x y z conf\n1 2 3 2.5\n", "x y z from 1, 2, 3; confidence from 4"),
    ],
)
def test_columns_of_text_are_guessed_and_said(text: str, columns: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(text)
    cloud = read(tmp_path / "a.txt")
    assert cloud.points.tolist() == [[1, 2, 3]]
    assert opened(tmp_path / "a.txt").notes[0].endswith(columns)
    assert (cloud.confidence is not None) == ("conf" in text)


@given(
    rows=st.lists(
        st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3), min_size=1, max_size=9
    ),
    separator=st.sampled_from([" ", ",", ";", "\t", " , "]),
)
def test_every_digit_of_text_is_kept(rows, separator, tmp_path_factory) -> None:
    path = tmp_path_factory.getbasetemp() / "digits.xyz"
    path.write_text("".join(separator.join(map(repr, row)) + "\n" for row in rows))
    np.testing.assert_array_equal(read(path).points, np.array(rows))


def test_an_npy_of_six_columns(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.hstack((POINTS, POINTS)))
    np.testing.assert_array_equal(read(tmp_path / "a.npy").points, POINTS)
    assert "3 columns passed over" in opened(tmp_path / "a.npy").notes[0]
    np.save(tmp_path / "a.npy", np.ones((4, 7)))
    with refused("an array of"):
        opened(tmp_path / "a.npy")
