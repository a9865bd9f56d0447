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

C2W = np.arange(12, dtype="<f4").reshape(3, 4) / 8
KINDS = {"<f4": "Float", "<f8": "Double", "<i8": "Long"}


def plain(value: Any) -> bytes:
    """Return the part of a pickle that makes a plain value."""
    return pickle.dumps(value, 2)[2:-1]


def tensor(key: int, kind: str, count: int, shape: Any, strides: Any, offset: int = 0) -> bytes:
    """Return the part of a pickle that makes a tensor, as PyTorch writes it."""
    storage = b"(" + plain("storage") + f"ctorch\n{KINDS[kind]}Storage\n".encode()
    storage += plain(str(key)) + plain("cpu") + plain(count) + b"tQ"
    rest = b"".join(map(plain, (offset, shape, strides, False)))
    return (
        b"ctorch._utils\n_rebuild_tensor_v2\n("
        + storage
        + rest
        + b"ccollections\nOrderedDict\n)RtR"
    )


def save(path: Path, fields: dict[str, bytes], **members: bytes) -> Path:
    """Write a dictionary as ``torch.save`` does, its values as parts of a pickle."""
    content = b"".join(plain(name) + part for name, part in fields.items())
    return write(
        path, {"data.pkl": b"\x80\x02}(" + content + b"u.", "byteorder": b"little"} | members
    )


def write(path: Path, members: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in members.items():
            archive.writestr(f"{path.stem}/{name}", data)
    return path


MATRIX = tensor(0, "<f4", 12, (3, 4), (4, 1))
STORED = {"data/0": C2W.tobytes()}


def test_a_dictionary_comes_back_as_it_was_saved(tmp_path: Path) -> None:
    fields = {"W": plain(4096), "name": plain("Sci-Art"), "scale": plain(215.5), "c2w": MATRIX}
    fields["lens"] = b"](" + tensor(1, "<f8", 2, (2,), (1,)) + plain(None) + plain(True) + b"e"
    fields["scalar"] = tensor(2, "<i8", 1, (), ())
    fields["view"] = tensor(0, "<f4", 12, (2, 2), (2, 4), offset=4)  # of the same storage
    more = {"data/1": np.array([0.5, -0.25]).tobytes(), "data/2": np.array([2**40]).tobytes()}
    found = read_tensors(save(tmp_path / "1.pt", fields, **STORED, **more))
    assert (found["W"], found["name"], found["scale"]) == (4096, "Sci-Art", 215.5)
    assert found["c2w"].dtype == np.float32
    np.testing.assert_array_equal(found["c2w"], C2W)
    np.testing.assert_array_equal(found["lens"][0], [0.5, -0.25])
    assert found["lens"][1:] == [None, True]
    assert found["scalar"].shape == ()
    assert found["scalar"] == 2**40
    np.testing.assert_array_equal(found["view"], C2W[1:, ::2].T)


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
    with pytest.raises(BenchmarkError, match=r"evil\.pt"):
        read_tensors(write(tmp_path / "evil.pt", {"data.pkl": hostile}))
    assert not touched.exists()


WRONG: dict[str, tuple[bytes, dict[str, bytes]]] = {
    "another function": (MATRIX.replace(b"tensor_v2", b"parameter"), STORED),
    "another module": (MATRIX.replace(b"ctorch\n", b"cnumpy\n"), STORED),
    "a shape beyond the numbers": (tensor(0, "<f4", 12, (9, 4), (4, 1)), STORED),
    "strides beyond them": (tensor(0, "<f4", 12, (3, 4), (9, 1)), STORED),
    "a negative shape": (tensor(0, "<f4", 12, (-1, 4), (4, 1)), STORED),
    "numbers cut off": (MATRIX, {"data/0": b"12"}),
    "no numbers": (MATRIX, {}),
    "big-endian numbers": (MATRIX, {**STORED, "byteorder": b"big"}),
    "a class": (pickle.dumps(Path("b"), 2)[2:-1], {}),
    "no dictionary": (b"", {"data.pkl": pickle.dumps([1], 2)}),
    "cut off": (b"", {"data.pkl": b"\x80\x02}("}),
    "a mark too few": (b"", {"data.pkl": b"\x80\x02u."}),
}


@pytest.mark.parametrize("name", WRONG)
def test_damaged_and_foreign_files_are_refused_by_name(tmp_path: Path, name: str) -> None:
    part, members = WRONG[name]
    with pytest.raises(BenchmarkError, match=r"000001\.pt"):
        read_tensors(save(tmp_path / "000001.pt", {"c2w": part}, **members))


def test_other_layouts_and_bombs_are_refused(tmp_path: Path) -> None:
    bomb = write(tmp_path / "bomb.pt", {"data.pkl": bytes(1 << 20)}, zipfile.ZIP_DEFLATED)
    old = tmp_path / "old.pt"  # before PyTorch 1.6
    old.write_bytes(pickle.dumps(0x1950A86A20F9469CFC6C, 2))
    for path in (bomb, old):
        with pytest.raises(BenchmarkError, match=r"weights_only=True"):
            read_tensors(path)
