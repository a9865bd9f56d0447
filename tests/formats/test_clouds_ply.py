"""PLY clouds: what is read, and that wrong ones are refused with one message."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.formats.cloud_support import (
    made,
    opened,
    points_of,
    read,
    refused,
    write_ply,
)
from tests.formats.mesh_support import QUAD_HEADER, quads


@pytest.mark.parametrize("order", ["<", ">", ""])
@pytest.mark.parametrize("points", [1, 7, 40, 1000])
def test_every_byte_order_gives_all_columns(order: str, points: int, tmp_path: Path) -> None:
    columns = made()
    cloud = read(write_ply(tmp_path / "a.ply", columns, order), points)
    np.testing.assert_array_equal(cloud.points, points_of(columns))
    np.testing.assert_array_equal(cloud.confidence, columns["confidence"])
    assert cloud.points.dtype == np.float64


def test_open3d_reads_the_same(tmp_path: Path) -> None:
    from airzoo_bench.core.optional_imports import load_open3d

    o3d = load_open3d()
    columns = made(200)
    path = write_ply(tmp_path / "a.ply", columns)
    theirs = o3d.io.read_point_cloud(str(path))
    cloud = read(path)
    np.testing.assert_array_equal(cloud.points, np.asarray(theirs.points))
    # Open3D writes six digits into text, so that only near points come back.
    near = theirs.translate(-cloud.points.mean(axis=0))
    for ascii_ in (False, True):
        o3d.io.write_point_cloud(str(tmp_path / "b.ply"), near, write_ascii=ascii_)
        again = read(tmp_path / "b.ply")
        np.testing.assert_allclose(again.points, np.asarray(near.points), rtol=0, atol=1e-4)


def test_elements_before_the_points_are_stepped_over(tmp_path: Path) -> None:
    columns = made(5)
    header = "element camera 2\nproperty float f\nelement odd 2\nproperty list uchar short n"
    before = np.array([1, 2], "<f4").tobytes() + b"\x01\x00\x00" + b"\x02\x00\x00\x00\x00"
    path = write_ply(tmp_path / "a.ply", columns, before=before, before_header=header)
    np.testing.assert_array_equal(read(path).points, points_of(columns))
    path = write_ply(
        tmp_path / "b.ply", columns, "", before=b"1\n2\n1 0\n2 0 0\n", before_header=header
    )
    np.testing.assert_array_equal(read(path).points, points_of(columns))


def test_far_coordinates_keep_every_bit(tmp_path: Path) -> None:
    columns = made()
    for axis in "xyz":
        columns[axis] = columns[axis] + 2.0**-20
    for order in ("<", ""):
        path = write_ply(tmp_path / "a.ply", columns, order)
        np.testing.assert_array_equal(read(path).points, points_of(columns))


def test_digits_of_a_text_are_kept_whatever_its_type(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "a.ply", made(), "")
    path.write_text(path.read_text().replace("property double", "property float"))
    np.testing.assert_array_equal(read(path).points, points_of(made()))


def test_nan_and_infinity_pass_through(tmp_path: Path) -> None:
    columns = made(4)
    columns["x"][:3] = np.nan, np.inf, -np.inf
    for order in ("<", ">", ""):
        cloud = read(write_ply(tmp_path / "a.ply", columns, order))
        np.testing.assert_array_equal(cloud.points, points_of(columns))


def test_gaussian_splats_give_their_centres_and_say_so(tmp_path: Path) -> None:
    columns = {name: made()[name] for name in "xyz"}
    splats = columns | {n: np.zeros(40, "f4") for n in ("f_dc_0", "f_dc_1", "f_dc_2", "opacity")}
    path = write_ply(tmp_path / "a.ply", splats)
    assert "Gaussian" in opened(path).notes[0]
    cloud = read(path)
    np.testing.assert_array_equal(cloud.points, points_of(columns))


def test_no_points_and_no_faces_are_an_empty_cloud(tmp_path: Path) -> None:
    columns = {name: column[:0] for name, column in made().items()}
    for order in ("<", ""):
        assert opened(write_ply(tmp_path / "a.ply", columns, order)).count == 0
        assert len(read(tmp_path / "a.ply")) == 0
    faceless = "element face 0\nproperty list uchar int vertex_indices"
    path = write_ply(tmp_path / "b.ply", made(), faces_header=faceless)
    assert opened(path).kind == "PLY (binary)"


@pytest.mark.parametrize("order", ["<", ">", ""])
@pytest.mark.parametrize("promised", [41, 10**6, 10**12, 1 << 62])
def test_more_points_promised_than_held(order: str, promised: int, tmp_path: Path) -> None:
    path = write_ply(tmp_path / "a.ply", made(), order, promised=promised)
    with refused(r"promises|ends at line"):
        read(path)


@pytest.mark.parametrize("cut", [1, 40, 700])
def test_cut_off(cut: int, tmp_path: Path) -> None:
    for order in ("<", ""):
        path = write_ply(tmp_path / "a.ply", made(), order)
        path.write_bytes(path.read_bytes()[:-cut])
        if order or cut > 1:
            with refused(r"promises|ends at|line"):
                read(path)


@pytest.mark.parametrize(
    ("line", "wrong", "message"),
    [
        ("element vertex 40", "element vertex -1", "line 4 of the header"),
        ("element vertex 40", "element vertex 1e9", "line 4 of the header"),
        ("element vertex 40", f"element vertex {'9' * 5000}", "line 4 of the header"),
        ("property double x", "property quad x", "line 5 of the header"),
        ("property double x", "property list float double x", "line 5 of the header"),
        ("property double x", "property double y", "stands twice"),
        ("property double x", "property double u", "lack x, y or z"),
        ("property double x", "property list uchar double x", "hold lists"),
        ("comment made", "element vertex 3", "twice"),
        ("comment made", "\x1b[2J", "header is"),
        ("format binary_little_endian 1.0", "format utf8 1.0", "format utf8"),
        ("format binary_little_endian 1.0", "comment none", "no format"),
        ("end_header", "end", "no line end_header"),
    ],
)
def test_wrong_headers(line: str, wrong: str, message: str, tmp_path: Path) -> None:
    path = write_ply(tmp_path / "a.ply", made())
    path.write_bytes(path.read_bytes().replace(line.encode(), wrong.encode(), 1))
    with refused(message) as caught:
        opened(path)
    assert "\x1b" not in str(caught.value)
    assert str(path) in str(caught.value)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("wrong", ["1.0 2.0 x", "1 2", "1 2 3 4", "1,2,3", "1 2 1.#QNAN"])
def test_a_bad_row_of_text_is_named_by_its_line(wrong: str, tmp_path: Path) -> None:
    columns = {name: made()[name] for name in "xyz"}
    path = write_ply(tmp_path / "a.ply", columns, "")
    lines = path.read_text().splitlines()
    # The header has 8 lines; a blank line between the points counts as a line, not as a point.
    lines[20] = wrong
    lines.insert(15, "  ")
    path.write_text("\n".join(lines))
    with refused("line 22 is"):
        read(path, 9)


def test_an_endless_line_is_not_read_to_its_end(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "a.ply", made(), "")
    path.write_bytes(
        path.read_bytes().split(b"end_header\n")[0] + b"end_header\n" + b"1" * (3 << 20)
    )
    with refused("endless"):
        read(path)


def test_a_list_of_absurd_length(tmp_path: Path) -> None:
    header = QUAD_HEADER.replace("uchar", "int")
    for length in (-1, 2**31 - 1):
        body = np.array([length], "<i4").tobytes() + quads()
        path = write_ply(tmp_path / "a.ply", made(), faces_header=header, faces=body)
        with refused("length"):
            read(path)
    text = b"99999999999999999999 1 2 3\n" * 6
    path = write_ply(tmp_path / "b.ply", made(), "", faces_header=header, faces=text)
    with refused("face"):
        read(path)
