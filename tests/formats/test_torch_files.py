"""Tensors without PyTorch: values come back, and nothing in a file is ever run."""

from __future__ import annotations

import os
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.formats.torch_files import read_tensors
from tests.formats.torch_support import Tensor, pickled, save, write_members

C2W = np.arange(12, dtype=np.float32).reshape(3, 4) / 8
STORED = {"data/0": C2W.tobytes()}


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_a_dictionary_comes_back_as_it_was_saved(tmp_path: Path, protocol: int) -> None:
    content = {
        "W": 4096,
        "H": -3,
        "scale": 215.5,
        "name": "Sci-Art",
        "c2w": Tensor(C2W),
        "lens": [Tensor([0.5, -0.25], "<f8"), None, True],
        "scalar": Tensor(2.5),
        "more": {"counts": Tensor([1, 2**40], "<i8")},
    }
    found = read_tensors(save(tmp_path / "000001.pt", content, protocol))
    assert (found["W"], found["H"], found["scale"], found["name"]) == (4096, -3, 215.5, "Sci-Art")
    assert found["c2w"].dtype == np.float32
    np.testing.assert_array_equal(found["c2w"], C2W)
    np.testing.assert_array_equal(found["lens"][0], [0.5, -0.25])
    assert found["lens"][1:] == [None, True]
    assert found["scalar"].shape == ()
    assert found["more"]["counts"].tolist() == [1, 2**40]


def test_views_of_one_storage_keep_their_offset_and_strides(tmp_path: Path) -> None:
    base = np.arange(24, dtype=np.float32)
    grid = base.reshape(4, 6)
    turned = Tensor(0.0)
    turned.values, turned.base = grid[1:, ::2].T, base
    found = read_tensors(save(tmp_path / "view.pt", {"c2w": turned}))
    np.testing.assert_array_equal(found["c2w"], grid[1:, ::2].T)


class Hostile:
    """Something that runs a command when it is unpickled."""

    def __init__(self, function: Any, *arguments: Any) -> None:
        self.call = function, arguments

    def __reduce__(self) -> Any:
        return self.call


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_code_in_a_file_is_refused_and_never_run(tmp_path: Path, protocol: int) -> None:
    touched = tmp_path / "touched"
    hostile = pickle.dumps({"c2w": Hostile(os.mkdir, str(touched))}, protocol)
    path = write_members(tmp_path / "evil.pt", {"data.pkl": hostile})
    with pytest.raises(BenchmarkError, match=r"evil\.pt"):
        read_tensors(path)
    assert not touched.exists()


def _spoiled(replace: bytes, by: bytes) -> bytes:
    data = pickled({"c2w": Tensor(C2W)})[0]
    assert replace in data
    return data.replace(replace, by)


SHAPE = b"K\x03K\x04\x86"
DAMAGED: dict[str, dict[str, bytes]] = {
    "another function": {
        "data.pkl": _spoiled(b"_rebuild_tensor_v2", b"_rebuild_parameter"),
        **STORED,
    },
    "another module": {
        "data.pkl": _spoiled(b"ctorch\nFloatStorage", b"cnumpy\nFloatStorage"),
        **STORED,
    },
    "a shape beyond the numbers": {"data.pkl": _spoiled(SHAPE, b"K\x09K\x04\x86"), **STORED},
    "strides beyond them": {"data.pkl": _spoiled(b"K\x04K\x01\x86", b"K\x09K\x01\x86"), **STORED},
    "a negative shape": {"data.pkl": _spoiled(SHAPE, b"J\xff\xff\xff\xffK\x04\x86"), **STORED},
    "numbers cut off": {"data.pkl": _spoiled(SHAPE, SHAPE), "data/0": b"12"},
    "no numbers": {"data.pkl": _spoiled(SHAPE, SHAPE)},
    "big-endian numbers": {"data.pkl": _spoiled(SHAPE, SHAPE), **STORED, "byteorder": b"big"},
    "no pickle": STORED,
    "cut off": {"data.pkl": _spoiled(SHAPE, SHAPE)[:60], **STORED},
    "no dictionary": {"data.pkl": pickle.dumps([1], 2)},
    "a class": {"data.pkl": pickle.dumps({"a": Path("b")}, 2)},
    "a mark too few": {"data.pkl": b"\x80\x02u."},
}


@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_and_foreign_files_are_refused_by_name(tmp_path: Path, name: str) -> None:
    path = write_members(tmp_path / "000001.pt", DAMAGED[name])
    with pytest.raises(BenchmarkError, match=r"000001\.pt"):
        read_tensors(path)


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    members = {"data.pkl": b"\0" * (1 << 20)}
    path = write_members(tmp_path / "bomb.pt", members, zipfile.ZIP_DEFLATED)
    with pytest.raises(BenchmarkError, match="compressed"):
        read_tensors(path)


def test_the_layout_before_pytorch_1_6_has_a_recipe(tmp_path: Path) -> None:
    path = tmp_path / "old.pt"
    path.write_bytes(pickle.dumps(0x1950A86A20F9469CFC6C, 2))
    with pytest.raises(BenchmarkError) as caught:
        read_tensors(path)
    assert "torch.load(f, weights_only=True)" in str(caught.value)
