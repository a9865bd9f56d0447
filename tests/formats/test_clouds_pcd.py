"""PCD clouds, in all three ways of storing them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.pcd import _decompress
from tests.formats.cloud_support import (
    made,
    opened,
    points_of,
    read,
    refused,
    write_pcd,
)

KINDS = ("ascii", "binary", "binary_compressed")


@pytest.mark.parametrize("data", KINDS)
def test_every_kind_gives_points(data: str, tmp_path: Path) -> None:
    columns = made()
    cloud = read(write_pcd(tmp_path / "a.pcd", columns, data))
    np.testing.assert_array_equal(cloud.points, points_of(columns))


@pytest.mark.parametrize("ascii_", [True, False])
@pytest.mark.parametrize("compressed", [True, False])
def test_what_open3d_writes(ascii_: bool, compressed: bool, tmp_path: Path) -> None:
    from airzoo_bench.core.optional_imports import load_open3d

    o3d = load_open3d()
    random = np.random.default_rng(1)
    cloud = o3d.geometry.PointCloud()
    # Rows that repeat give the compression something to do, copies that overlap among them.
    cloud.points = o3d.utility.Vector3dVector(np.repeat(random.random((50, 3)).round(2), 30, 0))
    colours = random.integers(0, 256, (1500, 3))
    cloud.colors = o3d.utility.Vector3dVector(colours / 255.0)
    path = tmp_path / "a.pcd"
    assert o3d.io.write_point_cloud(str(path), cloud, write_ascii=ascii_, compressed=compressed)
    ours = read(path, 400)
    np.testing.assert_allclose(ours.points, np.asarray(cloud.points), rtol=0, atol=1e-6)


def test_lzf_by_hand() -> None:
    assert _decompress(b"\x02abc", 3) == b"abc"
    # Three literals, then a copy of 2 + 2 from 3 back, then a long one of 7 + 1 + 2 from 1 back.
    assert _decompress(b"\x02abc\x40\x02\xe0\x01\x00", 17) == b"abcabca" + b"a" * 10
    for damaged in (b"\x02ab", b"\x20\x00", b"\x02abc\x40", b"\x02abc\x02abc", b"\x02abc\xe0"):
        assert _decompress(damaged, 3) is None


@pytest.mark.parametrize("data", KINDS)
@pytest.mark.parametrize("promised", [41, 10**9, 10**17])
def test_more_points_promised_than_held(data: str, promised: int, tmp_path: Path) -> None:
    changes = {"POINTS": str(promised), "WIDTH": str(promised)}
    with pytest.raises(PredictionError):
        read(write_pcd(tmp_path / "a.pcd", made(), data, **changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"FIELDS": "x y q rgb"}, "lack x, y or z"),
        ({"FIELDS": "x y z x"}, "field 'x'"),
        ({"FIELDS": "x y z"}, "differ in length"),
        ({"SIZE": "8 8 8 3"}, "of 3 bytes"),
        ({"TYPE": "F F F Q"}, "type 'Q'"),
        ({"COUNT": "1 1 1 0"}, "0 times"),
        ({"COUNT": "1 1 1 99999999"}, "times"),
        ({"POINTS": "-5"}, "counts of 0 or more"),
        ({"WIDTH": "39"}, "WIDTH times HEIGHT"),
        ({"DATA": "zip"}, "DATA 'zip'"),
    ],
)
def test_wrong_headers(changes: dict[str, str], message: str, tmp_path: Path) -> None:
    path = write_pcd(tmp_path / "a.pcd", made(), "binary")
    text = path.read_bytes()
    for key, value in changes.items():
        old = next(line for line in text.split(b"\n") if line.startswith(key.encode()))
        text = text.replace(old, f"{key} {value}".encode(), 1)
    path.write_bytes(text)
    with refused(message):
        opened(path)


def test_a_bad_row_is_named_by_its_line(tmp_path: Path) -> None:
    path = write_pcd(tmp_path / "a.pcd", made(), "ascii")
    lines = path.read_text().splitlines()
    lines[13] = "1 2 3 red"
    path.write_text("\n".join(lines))
    with refused("line 14 is '1 2 3 red'"):
        read(path)


def test_padding_and_repeated_fields(tmp_path: Path) -> None:
    record = np.dtype([("x", "<f4"), ("_", "V4"), ("y", "<f4"), ("h", "<f4", 3), ("z", "<f4")])
    rows = np.zeros(3, record)
    rows["x"], rows["y"], rows["z"] = [1, 2, 3], [4, 5, 6], [7, 8, 9]
    head = (
        "VERSION .7\nFIELDS x _ y h z\nSIZE 4 1 4 4 4\nTYPE F U F F F\nCOUNT 1 4 1 3 1\n"
        "WIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA binary\n"
    )
    (tmp_path / "a.pcd").write_bytes(head.encode() + rows.tobytes())
    assert read(tmp_path / "a.pcd").points.tolist() == [[1, 4, 7], [2, 5, 8], [3, 6, 9]]
