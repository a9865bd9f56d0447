"""Sealing and opening: bytes, keys, damage, what is left behind, and a kill at any step."""

from __future__ import annotations

import json
import os
import shutil
import tarfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.leaderboard.sealed_scoring import opened_truth
from airzoo_bench.leaderboard.sealing import load_pyrage, seal
from tests.api.place import NAME
from tests.leaderboard.sealed.conftest import SALT, SealedField


def content(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def opened(public: Path, archive: Path, key: Any) -> dict[str, bytes]:
    with opened_truth(public, archive, key) as truth:
        return content(truth)


def test_opened_is_what_was_sealed(sealed: SealedField) -> None:
    whole, found = content(sealed.folder), opened(sealed.public, sealed.archive, sealed.key)
    assert found.items() <= whole.items()
    assert whole.keys() - found.keys() == {f"data/{NAME}/images/a.png"}  # it had metadata


CHANGES: dict[str, Callable[[bytearray], Any]] = {
    "a byte in the middle": lambda d: d.__setitem__(len(d) // 2, d[len(d) // 2] ^ 1),
    "a byte of the end": lambda d: d.__setitem__(-1, d[-1] ^ 1),
    "a byte of the head": lambda d: d.__setitem__(3, d[3] ^ 1),
    "half of it": lambda d: d.__delitem__(slice(len(d) // 2, None)),
    "the last byte": lambda d: d.__delitem__(-1),
    "more at its end": lambda d: d.extend(b"more"),
    "nothing": lambda d: d.clear(),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_damaged_archive_opens_nothing(
    change: Callable[[bytearray], Any], sealed: SealedField, tmp_path: Path
) -> None:
    data = bytearray(sealed.archive.read_bytes())
    change(data)
    (tmp_path / "x.age").write_bytes(data)
    with pytest.raises(BenchmarkError, match="damaged, cut off"):
        opened(sealed.public, tmp_path / "x.age", sealed.key)


def test_another_key_another_run_and_a_missing_file(sealed: SealedField, tmp_path: Path) -> None:
    other = load_pyrage().x25519.Identity.generate()
    with pytest.raises(BenchmarkError, match="sealed to another key"):
        opened(sealed.public, sealed.archive, other)
    with pytest.raises(UserError, match="is sealed already"):
        seal(sealed.public, tmp_path / "again", tmp_path / "again.age", other.to_public())
    seal(sealed.folder, tmp_path / "p", tmp_path / "x.age", sealed.key.to_public())
    with pytest.raises(BenchmarkError, match="belongs to another public folder"):
        opened(sealed.public, tmp_path / "x.age", sealed.key)
    public = Path(shutil.copytree(sealed.public, tmp_path / NAME))
    (public / "data" / NAME / "images" / "b.png").unlink()
    with pytest.raises(BenchmarkError, match=r"b\.png: a file of the public folder is missing"):
        opened(public, sealed.archive, sealed.key)


@pytest.mark.parametrize("name", ["../x", "/etc/x", "a/../../x"])
def test_an_archive_that_anybody_could_have_sealed_writes_nowhere_else(
    name: str, sealed: SealedField, tmp_path: Path
) -> None:
    """The public key is public: members are held to a manifest whose names stay in the folder."""
    file = {"sha256": SALT, "size": 1, "how": "sealed"}
    manifest = {"format": 1, "salt": SALT, "files": {name: file}}
    plain = BytesIO()
    with tarfile.open(fileobj=plain, mode="w") as tar:
        for member, text in (("manifest.json", json.dumps(manifest)), (f"files/{name}", "x")):
            entry = tarfile.TarInfo(member)
            entry.size = len(text)
            tar.addfile(entry, BytesIO(text.encode()))
    path = tmp_path / "x.age"
    path.write_bytes(load_pyrage().encrypt(plain.getvalue(), [sealed.key.to_public()]))
    with pytest.raises(BenchmarkError, match=r"another version|another public"):
        opened(sealed.public, path, sealed.key)


def test_opened_truth_is_private_and_goes(sealed: SealedField) -> None:
    for error in (None, UserError("x"), KeyboardInterrupt(), SystemExit(143)):
        try:
            with opened_truth(sealed.public, sealed.archive, sealed.key) as truth:
                assert truth.stat().st_mode & 0o077 == 0
                Benchmark.open(truth)
                if error is not None:
                    raise error
        except type(error or UserError):
            assert error is not None
        assert not truth.exists()


def test_truth_of_a_killed_run_is_cleared_by_the_next(sealed: SealedField) -> None:
    read, write = os.pipe()
    child = os.fork()
    if not child:
        with opened_truth(sealed.public, sealed.archive, sealed.key) as truth:
            (truth / "left").touch()
            os.write(write, str(truth / "left").encode())
            os.kill(os.getpid(), 9)
    os.waitpid(child, 0)
    left = Path(os.read(read, 4096).decode())
    os.close(read)
    os.close(write)
    assert left.exists()
    with opened_truth(sealed.public, sealed.archive, sealed.key):
        assert not left.exists()
