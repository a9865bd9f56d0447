"""Hostile ``.npz`` files: refused with one message, or read as what they are."""

from __future__ import annotations

import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.core.files import write_npz
from airzoo_bench.formats.npz import NpzFile

LIMIT = 1 << 24


def opened(path: Path, limit: int = LIMIT, **arrays: Any) -> NpzFile:
    np.savez(path, **arrays)
    return NpzFile(path, limit)


def npy(header: str, data: bytes = b"", version: bytes = b"\x01\x00", pad: int = 0) -> bytes:
    """Return an npy member with a header as written, however wrong."""
    text = header.encode("latin1") + b" " * pad + b"\n"
    width = 2 if version == b"\x01\x00" else 4
    return b"\x93NUMPY" + version + len(text).to_bytes(width, "little") + text + data


def member(path: Path, content: bytes, name: str = "a.npy", compress: bool = False) -> Path:
    method = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr(name, content)
    return path


@pytest.mark.parametrize(
    "array",
    [
        np.arange(6.0).reshape(2, 3),
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.arange(6, dtype=">f4").reshape(2, 3),
        np.arange(6, dtype=np.float16).reshape(2, 3),
        np.arange(6).reshape(2, 3)[:, ::-1],
        np.array(3.5),
        np.zeros((0, 4), np.float32),
        np.zeros((4, 0), np.float32),
        np.array(["east/ü", "", "east/名"]),
        np.array(["east/a", "b"], dtype=">U6"),
        np.array("made-retrieval"),
        np.array([], dtype=str),
        np.array([["a", "b"], ["c", ""]]).T,
    ],
    ids=lambda a: f"{a.dtype.str}{a.shape}",
)
@pytest.mark.parametrize("compress", [False, True])
def test_reads_what_numpy_wrote(array: Any, compress: bool, tmp_path: Path) -> None:
    (np.savez_compressed if compress else np.savez)(tmp_path / "x.npz", a=array)
    file = NpzFile(tmp_path / "x.npz", LIMIT)
    for read in (file.read("a"), file.map("a")):
        assert read.shape == array.shape
        assert read.dtype.kind == array.dtype.kind
        np.testing.assert_array_equal(read, array)


def test_bytes_become_text(tmp_path: Path) -> None:
    read = opened(tmp_path / "x.npz", a=np.array(["east/ü".encode()])).read("a")
    assert read.tolist() == ["east/ü"]


def test_only_plain_members_are_mapped(tmp_path: Path) -> None:
    array = np.arange(6, dtype=np.float32).reshape(2, 3)
    file = opened(
        tmp_path / "x.npz", plain=array, fortran=np.asfortranarray(array), big=array.astype(">f4")
    )
    assert isinstance(file.map("plain"), np.memmap)
    assert not isinstance(file.map("fortran"), np.memmap)
    assert not isinstance(file.map("big"), np.memmap)


def test_a_mapped_array_may_be_larger_than_the_limit(tmp_path: Path) -> None:
    array = np.arange(1000.0)
    file = opened(tmp_path / "x.npz", limit=7999, a=array)
    np.testing.assert_array_equal(file.map("a"), array)
    with pytest.raises(PredictionError, match=r"8,000 bytes .*\n.*at most 7,999 bytes"):
        file.read("a")
    np.testing.assert_array_equal(NpzFile(file.path, 8000).read("a"), array)


def test_bytes_count_as_the_text_that_they_become(tmp_path: Path) -> None:
    file = opened(tmp_path / "x.npz", limit=4999, a=np.array([b"x" * 1000]))
    with pytest.raises(PredictionError, match="5,000 bytes"):
        file.read("a")


def test_a_zip_bomb_is_never_unpacked(tmp_path: Path) -> None:
    # 64 MB of zeros in 64 kB; the header says so, and the limit stops it.
    content = npy("{'descr': '<f8', 'fortran_order': False, 'shape': (8388608,)}", bytes(1 << 26))
    path = member(tmp_path / "x.npz", content, compress=True)
    assert path.stat().st_size < 1 << 17
    with pytest.raises(PredictionError, match="more than the limit"):
        NpzFile(path, LIMIT).read("a")


def test_a_member_that_holds_more_than_it_says(tmp_path: Path) -> None:
    content = npy("{'descr': '<f8', 'fortran_order': False, 'shape': (2,)}", bytes(1 << 20))
    with pytest.raises(PredictionError, match="the archive 1,048,576 bytes"):
        NpzFile(member(tmp_path / "x.npz", content, compress=True), LIMIT)


def test_pickles_are_refused_and_never_loaded(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "sprung",))

    np.savez(tmp_path / "x.npz", a=np.array([Trap()], dtype=object))
    with pytest.raises(PredictionError, match="pickled Python objects, which are never loaded"):
        NpzFile(tmp_path / "x.npz", LIMIT)
    assert not (tmp_path / "sprung").exists()


SHAPE = "{'descr': '<f8', 'fortran_order': False, 'shape': %s}"
DESCR = "{'descr': %s, 'fortran_order': False, 'shape': (1,)}"


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x93NUMPY",
        b"\x93NUMPX\x01\x00\x00\x00",
        npy("") + b"junk",
        npy("{'descr': '<f8'}"),
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1,)", bytes(8)),
        npy("(" * 5000, pad=10),
        npy(SHAPE % "(1,)", bytes(8), pad=20_000),
        npy(SHAPE % "(-1,)"),
        npy(SHAPE % "(1.0,)", bytes(8)),
        npy(SHAPE % "'x'"),
        npy(SHAPE % f"({2**70}, 0)"),
        npy(SHAPE % "(2,)", bytes(8)),
        npy(SHAPE % "(1,)", bytes(9)),
        npy(DESCR % "'<q9'", bytes(9)),
        npy(DESCR % "'O'", b"\x80\x04N."),
        npy(DESCR % "'|V8'", bytes(8)),
        npy(DESCR % "'<M8[s]'", bytes(8)),
        npy(DESCR % "'<c16'", bytes(16)),
        npy(DESCR % "[('a', '<f8')]", bytes(8)),
        npy(DESCR % "('<f8', (10**9, 10**9))", bytes(8)),
        npy(DESCR % "'<U0'"),
        npy(DESCR % "__import__('os').system('false')", bytes(8)),
        npy(SHAPE % "(1,)", bytes(8), version=b"\x09\x00"),
        npy(SHAPE % "(1,)", bytes(8), version=b"\x03\x00"),
    ],
)
def test_malformed_headers(content: bytes, tmp_path: Path) -> None:
    path = member(tmp_path / "x.npz", content)
    with pytest.raises(PredictionError, match=r"field 'a' (is damaged|holds|has dtype)"):
        NpzFile(path, LIMIT)


def test_a_member_twice_and_an_encrypted_one(tmp_path: Path) -> None:
    path, good = tmp_path / "x.npz", npy(SHAPE % "(1,)", bytes(8))
    with warnings.catch_warnings(), zipfile.ZipFile(path, "w") as archive:
        warnings.simplefilter("ignore")
        archive.writestr("a.npy", good)
        archive.writestr("a.npy", good)
    with pytest.raises(PredictionError, match="twice"):
        NpzFile(path, LIMIT)
    content = bytearray(member(path, good).read_bytes())
    content[6] |= 1  # the flag of encryption, in both headers
    content[content.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(content)
    with pytest.raises(PredictionError, match="encrypted"):
        NpzFile(path, LIMIT)


def test_a_flipped_bit_is_found_by_the_checksum(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    write_npz(path, {"a": np.arange(100.0)})
    content = bytearray(path.read_bytes())
    content[content.index(np.arange(100.0)[50].tobytes()) + 6] ^= 1
    path.write_bytes(content)
    with pytest.raises(PredictionError, match="field 'a' is damaged or cut off: Bad CRC-32"):
        NpzFile(path, LIMIT).read("a")


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_a_file_that_is_cut_off_is_refused(compress: bool, share: float, tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    write_npz(path, {"a": np.arange(100.0)}, compress=compress)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with pytest.raises(UnreadableError):
        NpzFile(path, LIMIT)
