"""Clouds as text: separators, names, counts, colours, and what is no cloud though it is numbers."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.formats.cloud_support import (
    colours_of,
    made,
    opened,
    points_of,
    read,
    refused,
    text_rows,
    write_ply,
)
from tests.formats.mesh_support import (
    CUBE,
    CUBE_TRIANGLES,
    OFF_CUBE,
    write_gltf,
    write_stl,
    write_stl_text,
)

COLUMNS = made()
XYZ = "columns, counted from 1: x y z from 1, 2, 3"
RGB = f"{XYZ}; 3 of 6 passed over"


@pytest.mark.parametrize(
    ("name", "before", "separator", "note"),
    [
        ("a.xyz", "", " ", RGB),
        ("a.txt", "# made by hand\n", "\t", RGB),
        ("a.csv", "X,Y,Z,R,G,B\n", ",", RGB),
        ("b.csv", "\ufeffx [m];y [m];z [m];red;green;blue\n", ";", RGB),
        ("c.csv", '"easting","northing","height","red","green","blue"\n', ", ", RGB),
        ("a.asc", "//X Y Z R G B\n40\n", " ", RGB),
        ("b.asc", "\n# one comment\n\n# another\n", " ", RGB),
        ("a.pts", "40\n", " ", RGB),
        ("b.pts", "\ufeff", " ", RGB),
        ("A.TXT", "", ",", RGB),
    ],
)
def test_the_same_points_whatever_the_writer(
    name: str, before: str, separator: str, note: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(before + text_rows(COLUMNS, separator), encoding="utf-8")
    cloud = read(tmp_path / name)
    np.testing.assert_array_equal(cloud.points, points_of(COLUMNS))
    assert opened(tmp_path / name).notes == (note,)


@pytest.mark.parametrize(
    ("name", "text", "columns"),
    [
        ("a.csv", "id,z,y,x\n7,3,2,1\n", "x y z from 4, 3, 2; 1 of 4 passed over"),
        ("a.xyz", "1 2 3 99\n", "x y z from 1, 2, 3; 1 of 4 passed over"),
        ("a.pts", "1 2 3 90 1 2 3\n", "x y z from 1, 2, 3; 4 of 7 passed over"),
        ("a.txt", "x y z conf\n1 2 3 2.5\n", "x y z from 1, 2, 3; confidence from 4"),
    ],
)
def test_columns_are_guessed_and_said(name: str, text: str, columns: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    cloud = read(tmp_path / name)
    assert cloud.points.tolist() == [[1, 2, 3]]
    assert opened(tmp_path / name).notes == (f"columns, counted from 1: {columns}",)
    assert (cloud.confidence is not None) == ("conf" in text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,5 2,5 3,5\n", "line 1 has decimal commas"),
        ("1.5;2;3\n1,5;2;3\n", "line 2 has decimal commas"),
        ("576661,12,5188114,33,156,05\n", "line 1 has decimal commas"),
        ("lat,lon,alt\n30.1,120.2,50\n", "none is called x, y or z"),
        ("1 2\n", "2 columns"),
        ("1 2 3\n4 5 6 7\n", "line 2 is '4 5 6 7'"),
        ("1,2,3\n4,,6\n", "line 2 is '4,,6'|line 2 is '4  6'"),
        ("1 2 3\n4 five 6\n", "line 2 is '4 five 6'"),
        ("3\n1 2 3\n4 5 6\n", "says that it holds 3 points, and holds 2"),
        ("1\n1 2 3\n4 5 6\n", "says that it holds 1 point, and holds 2"),
        ("a 1 b\n", "holds no line with a point"),
        ("nothing here\n", "is no cloud"),
        ("1 2 3\0", "is no cloud"),
        ("{1 2 3}", "JSON"),
        ("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n", "camera poses: they hold quaternions"),
        ("0 5 6 7 1 0 0 0\n1 5 6 7 1 0 0 0\n", "camera poses: they hold quaternions"),
        ("1 0 0 5 0 1 0 6 0 0 1 7\n", "camera poses: they hold rotation matrices"),
        ("3 1 0 0 5 0 1 0 6 0 0 1 7\n", "camera poses: they hold rotation matrices"),
    ],
)
def test_what_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(text)
    with refused(message):
        read(tmp_path / "a.txt")


def test_no_points_are_no_points(tmp_path: Path) -> None:
    (tmp_path / "a.pts").write_text("0\n")
    assert len(read(tmp_path / "a.pts")) == 0


@given(
    rows=st.lists(
        st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3), min_size=1, max_size=9
    ),
    separator=st.sampled_from([" ", ",", ";", "\t", " , "]),
)
def test_every_digit_is_kept(
    rows: list[tuple[float, float, float]],
    separator: str,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    path = tmp_path_factory.getbasetemp() / "digits.xyz"
    path.write_text("".join(separator.join(map(repr, row)) + "\n" for row in rows))
    np.testing.assert_array_equal(read(path).points, np.array(rows))


def test_an_array_of_six_columns(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.hstack((points_of(COLUMNS), colours_of(COLUMNS))))
    cloud = read(tmp_path / "a.npy")
    np.testing.assert_array_equal(cloud.points, points_of(COLUMNS))
    assert opened(tmp_path / "a.npy").notes == (RGB,)
    np.save(tmp_path / "c.npy", np.ones((4, 7)))
    with refused("an array of"):
        opened(tmp_path / "c.npy")


def test_upper_case_coordinates_of_ply(tmp_path: Path) -> None:
    renamed = {name.upper() if name in "xyz" else name: COLUMNS[name] for name in COLUMNS}
    for order in ("", "<"):
        cloud = read(write_ply(tmp_path / "a.ply", renamed, order))
        np.testing.assert_array_equal(cloud.points, points_of(COLUMNS))
    both = {"X": COLUMNS["x"], **COLUMNS}
    with refused("stands twice"):
        opened(write_ply(tmp_path / "b.ply", both))


def test_meshes_have_the_same_surface(tmp_path: Path) -> None:
    (tmp_path / "a.off").write_text(OFF_CUBE)
    for path in (
        tmp_path / "a.off",
        write_stl(tmp_path / "a.stl"),
        write_stl_text(tmp_path / "b.stl"),
    ):
        points = read(path).points
        assert len(points) == 500
        on_a_side = ((points == 0.0) | (points == 1.0)).any(axis=1)
        assert on_a_side.all()
        assert "6 square units" in opened(path).notes[-1]
    doubled = read(write_gltf(tmp_path / "a.gltf")).points - (10, 0, 0)
    assert ((doubled == 0.0) | (doubled == 2.0)).any(axis=1).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("OFF", "OFF BINARY"), "line 1 is none"),
        (("8 6 0", "8 600 0"), "line 18 is none"),
        (("8 6 0", "8 7 0"), "line 18 is none"),
        (("8 6 0", "8 5 0"), "line 17 is none"),
        (("4 0 1 3 2", "4 0 1 3 8"), "vertex that is not there"),
        (("4 0 1 3 2", "5 0 1 3"), "vertex that is not there"),
        (("0.0 0.0 1.0", "0.0 0.0 x"), "line 5 is none"),
        (("0.0 0.0 1.0", "0.0 0.0 nan"), "NaN"),
    ],
)
def test_wrong_off(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    (tmp_path / "a.off").write_text(OFF_CUBE.replace(*change, 1))
    with refused(message):
        opened(tmp_path / "a.off")


def test_wrong_stl(tmp_path: Path) -> None:
    whole = write_stl(tmp_path / "a.stl").read_bytes()
    more, fewer = ((len(CUBE_TRIANGLES) + n).to_bytes(4, "little") for n in (1, -1))
    nan = np.full(3, np.nan, "<f4").tobytes()
    for raw, message in (
        (whole[:-1], "damaged or cut off|ends within"),
        (whole[:80] + more + whole[84:], "damaged or cut off|ends within"),
        (whole[:80] + fewer + whole[84:], "damaged or cut off|ends within"),
        (whole[:96] + nan + whole[108:], "NaN"),
    ):
        (tmp_path / "a.stl").write_bytes(raw)
        with refused(message):
            opened(tmp_path / "a.stl")
    text = write_stl_text(tmp_path / "c.stl").read_text()
    for wrong, message in (
        (text.replace("vertex 0.0 0.0 0.0\n", "", 1), "damaged"),
        (text.replace("vertex 0.0 0.0 0.0", "vertex 0.0 0.0", 1), "damaged"),
        (text.replace("vertex 0.0 0.0 0.0", "vertex 0.0 0.0 nan", 1), "NaN"),
        (text + text[: len(text) // 2], "ends within a solid"),
    ):
        (tmp_path / "c.stl").write_text(wrong)
        with refused(message):
            opened(tmp_path / "c.stl")
    assert len(CUBE) == 8


class TestGzip:
    def packed(self, folder: Path, name: str = "a.xyz.gz") -> Path:
        (folder / name).write_bytes(gzip.compress(text_rows(COLUMNS).encode()))
        return folder / name

    def test_it_is_what_it_holds(self, tmp_path: Path) -> None:
        np.testing.assert_array_equal(read(self.packed(tmp_path)).points, points_of(COLUMNS))

    def test_it_stays_as_long_as_it_is_read_and_no_longer(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        disk = tmp_path / "disk"
        disk.mkdir()
        monkeypatch.setattr("tempfile.tempdir", str(disk))
        pieces = opened(self.packed(tmp_path)).pieces(7)
        assert sum(len(piece) for piece in pieces) == 40
        del pieces
        assert list(disk.iterdir()) == []

    def test_damage_names_the_packed_file(self, tmp_path: Path) -> None:
        path = self.packed(tmp_path)
        path.write_bytes(path.read_bytes()[:-3])
        with refused("damaged or cut off") as caught:
            opened(path)
        assert caught.value.where == str(path)
        path.write_bytes(gzip.compress(b"1 2 3\n4 x 6\n"))
        with refused("line 2 is '4 x 6'") as caught:
            read(path)
        assert caught.value.where == str(path)
        path.write_bytes(gzip.compress(gzip.compress(b"1 2 3\n")))
        with refused("a gzip file"):
            opened(path)
