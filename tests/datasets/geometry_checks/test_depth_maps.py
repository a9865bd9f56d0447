"""Depth maps in each format, and what bad ones get."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from PIL import Image

from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.datasets.geometry_checks.depth_maps import find_depths, read_depth

DEPTH = np.arange(1.0, 13.0, dtype=np.float32).reshape(3, 4)


def write_tif(path: Path, array: np.ndarray, **profile: Any) -> Path:
    size = {"count": 1, "height": array.shape[0], "width": array.shape[1], "dtype": array.dtype}
    with (
        pytest.warns(rasterio.errors.NotGeoreferencedWarning),
        rasterio.open(path, "w", driver="GTiff", **size, **profile) as file,
    ):
        file.write(array, 1)
    return path


def write(path: Path, array: np.ndarray) -> Path:
    match path.suffix:
        case ".npy":
            np.save(path, array)
        case ".npz":
            np.savez_compressed(path, depth=array, confidence=array)
        case ".png":
            Image.fromarray(array).save(path)
        case _:
            write_tif(path, array)
    return path


@pytest.mark.parametrize("suffix", [".tif", ".npy", ".npz"])
def test_floats_are_metres(tmp_path: Path, suffix: str) -> None:
    stored = DEPTH.copy()
    stored[0] = (0.0, np.nan, np.inf, -1.0)
    read = read_depth(write(tmp_path / f"a{suffix}", stored), 4, 3)
    assert read.dtype == np.float32
    assert np.isnan(read[0]).all()
    assert (read[1:] == DEPTH[1:]).all()


@pytest.mark.parametrize("suffix", [".png", ".tif", ".npy"])
def test_whole_numbers_need_a_scale(tmp_path: Path, suffix: str) -> None:
    stored = (1000 * DEPTH).astype(np.uint16)
    stored[0, 0] = 0
    path = write(tmp_path / f"a{suffix}", stored)
    with pytest.raises(BenchmarkError, match="--depth-scale"):
        read_depth(path, 4, 3)
    read = read_depth(path, 4, 3, 0.001)
    assert np.isnan(read[0, 0])
    assert read[1:] == pytest.approx(DEPTH[1:])


def test_nodata_of_the_file_is_no_depth(tmp_path: Path) -> None:
    read = read_depth(write_tif(tmp_path / "a.tif", DEPTH, nodata=5.0), 4, 3)
    assert np.isnan(read[1, 0])
    assert np.isnan(read).sum() == 1


@pytest.mark.parametrize("suffix", [".tif", ".npy", ".npz"])
def test_another_size_names_both(tmp_path: Path, suffix: str) -> None:
    path = write(tmp_path / f"a{suffix}", DEPTH)
    with pytest.raises(BenchmarkError, match="is 4 x 3 px, the camera 8 x 6 px"):
        read_depth(path, 8, 6)
    with pytest.raises(BenchmarkError, match="rows and columns are swapped"):
        read_depth(path, 3, 4)


def test_an_axis_of_length_one_is_dropped(tmp_path: Path) -> None:
    for shape in ((1, 3, 4), (3, 4, 1)):
        assert (read_depth(write(tmp_path / "a.npy", DEPTH.reshape(shape)), 4, 3) == DEPTH).all()


@pytest.mark.parametrize("suffix", [".tif", ".npy", ".npz", ".png"])
def test_garbage_is_one_message(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    good = write(tmp_path / f"b{suffix}", (DEPTH * 9).astype(np.uint16)).read_bytes()
    for content in (b"", b"garbage" * 30, good[: len(good) // 2], good[:-3]):
        path.write_bytes(content)
        # A file that lacks a few bytes at its end may still be whole.
        with suppress(UserError):
            read_depth(path, 4, 3, 1.0)
    path.write_bytes(b"garbage")
    with pytest.raises(BenchmarkError, match=path.name):
        read_depth(path, 4, 3, 1.0)


def test_objects_and_pictures_are_no_depth(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(BenchmarkError):
        read_depth(tmp_path / "a.npy", 4, 3)
    with pytest.raises(BenchmarkError, match="pictures of depth"):
        read_depth(write(tmp_path / "a.png", DEPTH.astype(np.uint8)), 4, 3, 1.0)
    Image.new("RGB", (4, 3)).save(tmp_path / "b.png")
    with pytest.raises(BenchmarkError, match="3 bands"):
        read_depth(tmp_path / "b.png", 4, 3, 1.0)


def test_a_header_that_claims_much_takes_no_memory(tmp_path: Path) -> None:
    path = write(tmp_path / "a.npy", DEPTH)
    path.write_bytes(path.read_bytes().replace(b"(3, 4), ", b"(300000, 4000000), "))
    with pytest.raises(BenchmarkError):
        read_depth(path, 4, 3)


def test_an_npz_of_several_arrays_needs_one_called_depth(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", z=DEPTH, c=DEPTH)
    with pytest.raises(BenchmarkError, match="no array 'depth'"):
        read_depth(tmp_path / "a.npz", 4, 3)
    np.savez(tmp_path / "b.npz", z=DEPTH)
    assert (read_depth(tmp_path / "b.npz", 4, 3) == DEPTH).all()


def test_found_by_name_in_subfolders(tmp_path: Path) -> None:
    (tmp_path / "left").mkdir()
    one = write(tmp_path / "left" / "a.b.npy", DEPTH)
    assert find_depths(tmp_path, ["left/a.b.jpg", "a.b.jpg"]) == (one, None)
    write(tmp_path / "left" / "a.b.npz", DEPTH)
    with pytest.raises(BenchmarkError, match="more than one depth map"):
        find_depths(tmp_path, ["left/a.b.jpg"])
    with pytest.raises(BenchmarkError, match="no depth map of any"):
        find_depths(tmp_path, ["other.jpg"])
    with pytest.raises(UserError, match="no such folder"):
        find_depths(tmp_path / "none", ["other.jpg"])
