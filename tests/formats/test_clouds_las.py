"""LAS and LAZ beside laspy, and damaged ones that would end the process."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from tests.formats.cloud_support import made, opened, read, refused, write_las

N = 300


def laspy_points(path: Path) -> np.ndarray:
    return np.asarray(laspy.read(path).xyz)


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize("point_format", [0, 1, 2, 3, 6, 7, 8])
def test_the_same_as_laspy(suffix: str, point_format: int, tmp_path: Path) -> None:
    columns = made(N)
    path = write_las(tmp_path / f"a.{suffix}", columns, point_format)
    cloud = read(path, 77)
    np.testing.assert_array_equal(cloud.points, laspy_points(path))
    assert np.abs(cloud.points - np.stack([columns[a] for a in "xyz"], -1)).max() < 6e-4


@pytest.mark.parametrize("points", [50_001, 10**6])
def test_the_real_cloud_in_pieces(brighton: Path, points: int) -> None:
    path = brighton / "model.laz"
    cloud = read(path, points)
    assert len(cloud) == 940_393
    np.testing.assert_array_equal(cloud.points, laspy_points(path))


def test_extra_bytes_are_stepped_over(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=7)
    header.add_extra_dim(laspy.ExtraBytesParams("amplitude", np.float64))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.random.default_rng(0).integers(0, 900, (3, N)) / 4.0
    las["amplitude"] = np.arange(N, dtype=np.float64)
    for name in ("a.laz", "a.las"):
        las.write(tmp_path / name)
        np.testing.assert_array_equal(read(tmp_path / name).points, np.asarray(las.xyz))


def test_an_empty_file_of_points(tmp_path: Path) -> None:
    for name in ("a.laz", "a.las"):
        laspy.LasData(laspy.LasHeader(point_format=3)).write(tmp_path / name)
        assert len(read(tmp_path / name)) == 0


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize("left", [4, 100, 300, 700, 0.5, 0.9, 0.999])
def test_cut_off(suffix: str, left: float, tmp_path: Path) -> None:
    path = write_las(tmp_path / f"a.{suffix}", made(N))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(left if left > 1 else left * len(whole))])
    with refused(r"cut off|promises|ends before|contradicts"):
        read(path)


def changed(path: Path, place: int, kind: str, value: float) -> Path:
    raw = bytearray(path.read_bytes())
    struct.pack_into(kind, raw, place, value)
    path.write_bytes(raw)
    return path


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize(
    ("place", "kind", "value"),
    [
        (94, "<H", 1),
        (96, "<I", 0xFFFFFFFF),
        (96, "<I", 0),
        (100, "<I", 0xFFFFFFFF),
        (104, "<B", 60),
        (105, "<H", 1),
        (105, "<H", 65535),
        (107, "<I", 0xFFFFFFFF),
        (131, "<d", np.nan),
        (139, "<d", 0.0),
        (155, "<d", np.inf),
        (24, "<B", 9),
    ],
)
def test_wrong_headers(suffix: str, place: int, kind: str, value: float, tmp_path: Path) -> None:
    path = changed(write_las(tmp_path / f"a.{suffix}", made(N)), place, kind, value)
    with pytest.raises(PredictionError):
        read(path)


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize("point_format", [0, 3, 6, 7])
@pytest.mark.parametrize("more", [20, 4 * 10**9])
def test_a_header_that_counts_too_many(
    suffix: str, point_format: int, more: int, tmp_path: Path
) -> None:
    path = write_las(tmp_path / f"a.{suffix}", made(N), point_format)
    raw = bytearray(path.read_bytes())
    struct.pack_into("<I", raw, 107, N + more)
    if raw[25] >= 4:
        struct.pack_into("<Q", raw, 247, N + more)
    path.write_bytes(raw)
    with refused("damaged|holds fewer"):
        opened(path)


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize("point_format", [0, 3, 6, 7])
@pytest.mark.parametrize("count", [1, 100, 290])
def test_a_header_that_counts_too_few(
    suffix: str, point_format: int, count: int, tmp_path: Path
) -> None:
    path = write_las(tmp_path / f"a.{suffix}", made(N), point_format)
    assert opened(path).notes == ()
    raw = bytearray(path.read_bytes())
    struct.pack_into("<I", raw, 107, count)
    if raw[25] >= 4:
        struct.pack_into("<Q", raw, 247, count)
    path.write_bytes(raw)
    (note,) = opened(path).notes
    assert note.endswith(f"follow the {count} points that its header promises: not read")


def test_what_follows_the_points_of_a_las_file_is_no_point(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.random.default_rng(0).integers(0, 900, (3, N)) / 4.0
    las.evlrs = laspy.vlrs.vlrlist.VLRList()
    las.evlrs.append(laspy.VLR("someone", 1, "", b"x" * 5000))
    las.write(tmp_path / "a.las")
    assert opened(tmp_path / "a.las").notes == ()
