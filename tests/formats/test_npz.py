"""Hostile ``.npz`` files: refused with one message, or read as what they are."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.core.files import write_npz
from airzoo_bench.formats.npz import NpzFile

LIMIT = 1 << 24


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
        np.arange(6, dtype=np.uint8).reshape(2, 3),
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


def test_only_plain_members_are_mapped_and_these_beyond_the_limit(tmp_path: Path) -> None:
    array, path = np.arange(1000.0), tmp_path / "x.npz"
    np.savez(
        path,
        plain=array,
        fortran=np.asfortranarray(array.reshape(10, 100)),
        big=array.astype(">f8"),
        text=np.array([b"\xc3\xbc" + b"x" * 1599]),
    )
    file = NpzFile(path, 7999)
    assert isinstance(file.map("plain"), np.memmap)
    np.testing.assert_array_equal(file.map("plain"), array)
    for name in ("fortran", "big", "text"):  # a byte becomes a character of four bytes more
        with pytest.raises(PredictionError, match=f"field '{name}'"):
            NpzFile(path, 7999).map(name)
        assert not isinstance(NpzFile(path, 8005).map(name), np.memmap)
    assert NpzFile(path, 8005).read("text")[0].startswith("üx")


@pytest.mark.parametrize("stated", [2, 8_388_608])
def test_a_bomb_is_never_unpacked(stated: int, tmp_path: Path) -> None:
    # 64 MB of zeros in 64 kB; the header says so, and the limit stops it, or lies.
    content = npy(SHAPE % f"({stated},)", bytes(1 << 26))
    path = member(tmp_path / "x.npz", content, compress=True)
    assert path.stat().st_size < 1 << 17
    with pytest.raises(PredictionError, match="67,108,864 bytes"):
        NpzFile(path, LIMIT).read("a")


def test_pickles_are_refused_and_never_loaded(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "sprung",))

    np.savez(tmp_path / "x.npz", a=np.array([Trap()], dtype=object))
    with pytest.raises(PredictionError, match="never loaded"):
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
def test_malformed_headers(content: Any, tmp_path: Path) -> None:
    path = member(tmp_path / "x.npz", content)
    with pytest.raises(PredictionError, match=r"field 'a' (is damaged|holds|has dtype)"):
        NpzFile(path, LIMIT)


def test_members_twice_and_encrypted(tmp_path: Path) -> None:
    path, good = tmp_path / "x.npz", npy(SHAPE % "(1,)", bytes(8))
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", good)
        with pytest.warns(UserWarning, match="Duplicate"):
            archive.writestr("a.npy", good)
    with pytest.raises(PredictionError, match="twice"):
        NpzFile(path, LIMIT)
    content = bytearray(member(path, good).read_bytes())
    content[6] |= 1  # the flag of encryption, in both headers
    content[content.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(content)
    with pytest.raises(PredictionError, match="encrypted"):
        NpzFile(path, LIMIT)


@pytest.mark.parametrize("compress", [False, True])
def test_damage_is_found(compress: bool, tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    write_npz(path, {"a": np.arange(100.0)}, compress=compress)
    whole = path.read_bytes()
    for share in (0.1, 0.5, 0.95):
        path.write_bytes(whole[: int(len(whole) * share)])
        with pytest.raises(UnreadableError):
            NpzFile(path, LIMIT)
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 1
    path.write_bytes(flipped)
    with pytest.raises(PredictionError, match="field 'a' is damaged or cut off"):
        NpzFile(path, LIMIT).read("a")
