"""Sealing and opening: bytes, keys, damage, and a process that is killed at any step."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.leaderboard.sealed.archive import Member, opened_archive, write_archive
from airzoo_bench.leaderboard.sealed.keys import load_pyrage
from airzoo_bench.leaderboard.sealed.sealing import seal
from airzoo_bench.leaderboard.sealed.unsealing import opened_truth
from tests.api.place import NAME
from tests.hostile.crash_points import Fault, run
from tests.leaderboard.sealed.conftest import SALT, SealedField

_NO_FAULT = 3


def content(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def opened(public: Path, archive: Path, key: Any) -> dict[str, bytes]:
    with opened_truth(public, archive, key) as truth:
        return content(truth.folder)


def test_opened_is_what_was_sealed(sealed: SealedField) -> None:
    whole, found = content(sealed.folder), opened(sealed.public, sealed.archive, sealed.key)
    assert found.items() <= whole.items()
    assert whole.keys() - found.keys() == {f"data/{NAME}/images/a.png"}  # it had metadata


def test_the_commitment_is_salted(sealed: SealedField, tmp_path: Path) -> None:
    found = set()
    for number, salt in enumerate((SALT, SALT, "6b" * 32)):
        made = seal(
            sealed.folder,
            tmp_path / f"p{number}",
            tmp_path / f"{number}.age",
            sealed.key.to_public(),
            make_salt=lambda salt=salt: salt,  # type: ignore[misc]
        )
        found.add(made.commitment)
        opened = Benchmark.open(tmp_path / f"p{number}", sealed=True).file.sealed
        assert opened is not None
        assert opened.commitment == made.commitment
    assert len(found) == 2
    assert content(tmp_path / "p0") == content(tmp_path / "p1") == content(sealed.public)
    again = seal(
        sealed.folder, tmp_path / "p3", tmp_path / "3.age", sealed.key.to_public()
    ).commitment
    assert again not in found


def test_archives_of_one_truth_differ_and_hide_its_size(
    sealed: SealedField, tmp_path: Path
) -> None:
    sizes = set()
    for size in range(100_000, 105_000, 97):
        path = tmp_path / "x.age"
        with path.open("wb") as stream:
            member = Member("a", size, lambda size=size: iter([bytes(size)]))  # type: ignore[misc]
            write_archive(stream, [member], sealed.key.to_public())
        sizes.add(path.stat().st_size >> 11)  # age adds up to 300 bytes at random
    assert len(sizes) <= 4


def spoiled(archive: Path, path: Path, change: Callable[[bytearray], Any]) -> Path:
    data = bytearray(archive.read_bytes())
    change(data)
    path.write_bytes(data)
    return path


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
    archive = spoiled(sealed.archive, tmp_path / "x.age", change)
    with pytest.raises(BenchmarkError, match="damaged, cut off"):
        opened(sealed.public, archive, sealed.key)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.age"]


def test_another_key(sealed: SealedField, tmp_path: Path) -> None:
    other = load_pyrage().x25519.Identity.generate()
    with pytest.raises(BenchmarkError, match="sealed to another key"):
        opened(sealed.public, sealed.archive, other)


def test_what_is_sealed_is_not_sealed_again(sealed: SealedField, tmp_path: Path) -> None:
    key = load_pyrage().x25519.Identity.generate().to_public()
    with pytest.raises(UserError, match="is sealed already"):
        seal(sealed.public, tmp_path / "again", tmp_path / "again.age", key)


def test_an_archive_of_another_run(sealed: SealedField, tmp_path: Path) -> None:
    seal(sealed.folder, tmp_path / "p", tmp_path / "x.age", sealed.key.to_public())
    with pytest.raises(BenchmarkError, match="belongs to another public folder"):
        opened(sealed.public, tmp_path / "x.age", sealed.key)


def test_a_public_file_that_is_missing(sealed: SealedField, tmp_path: Path) -> None:
    public = Path(shutil.copytree(sealed.public, tmp_path / NAME))
    (public / "data" / NAME / "images" / "b.png").unlink()
    with pytest.raises(BenchmarkError, match=r"b\.png: a file of the public folder is missing"):
        opened(public, sealed.archive, sealed.key)


@pytest.mark.parametrize("name", ["../x", "/etc/x", "a/../../x"])
def test_an_archive_that_anybody_could_have_sealed_writes_nowhere_else(
    name: str, sealed: SealedField, tmp_path: Path
) -> None:
    """The public key is public: members are held to a manifest whose names stay in the folder."""
    path = tmp_path / "x.age"
    with path.open("wb") as stream:
        file = {"sha256": SALT, "size": 1, "how": "sealed"}
        manifest = {"format": 1, "salt": SALT, "files": {name: file}}
        text = json.dumps(manifest).encode()
        members = [
            Member("manifest.json", len(text), lambda: iter([text])),
            Member(f"files/{name}", 1, lambda: iter([b"x"])),
        ]
        write_archive(stream, members, sealed.key.to_public())
    with pytest.raises(BenchmarkError, match=r"another version|another public"):
        opened(sealed.public, path, sealed.key)


def test_a_file_that_changes_while_it_is_sealed(sealed: SealedField, tmp_path: Path) -> None:
    member = Member("a", 5, lambda: iter([b"x"]))
    with (tmp_path / "x.age").open("wb") as stream:  # noqa: SIM117
        with pytest.raises(BenchmarkError, match="was changed while"):
            write_archive(stream, [member], sealed.key.to_public())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk(sealed: SealedField) -> None:
    member = Member("a", 5_000_000, lambda: iter([bytes(5_000_000)]))
    with Path("/dev/full").open("wb", buffering=0) as stream:  # noqa: SIM117
        with pytest.raises(OSError, match="No space left"):
            write_archive(stream, [member], sealed.key.to_public())


def test_large_truth_takes_little_memory(sealed: SealedField, tmp_path: Path) -> None:
    import tracemalloc

    def pieces() -> Any:
        for _ in range(96):
            yield bytes(1 << 20)

    tracemalloc.start()
    with (tmp_path / "x.age").open("wb") as stream:
        write_archive(stream, [Member("a", 96 << 20, pieces)], sealed.key.to_public())
    with opened_archive(tmp_path / "x.age", sealed.key) as members:
        for _, file in members:
            while file.read(1 << 20):
                pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 16 << 20


# --- killed ---


def replaced(sealed: SealedField) -> Callable[[Path, str], None]:
    def write(home: Path, salt: str) -> None:
        place = home / NAME, home / "truth.age"
        key = sealed.key.to_public()
        seal(sealed.folder, *place, key, replace=True, make_salt=lambda: salt * 32)

    return write


def fits(sealed: SealedField, home: Path) -> str:
    """Return the commitment of a public folder whose archive opens and belongs to it."""
    with opened_truth(home / NAME, home / "truth.age", sealed.key) as truth:
        assert (truth.folder / f"scenes/{NAME}/retrieval/positives.npz").is_file()
    file = Benchmark.open(home / NAME, sealed=True).file
    assert file.sealed is not None
    return file.sealed.commitment


@pytest.fixture(scope="module")
def small(sealed: SealedField, tmp_path_factory: pytest.TempPathFactory) -> SealedField:
    """Return a folder of fewer files, for what is sealed again and again."""
    folder = Path(shutil.copytree(sealed.folder, tmp_path_factory.mktemp("small") / NAME))
    for name in ("retrieval/tiles", "matching/crops"):
        shutil.rmtree(folder / "scenes" / NAME / name)
    return replace(sealed, folder=folder)


@pytest.mark.parametrize(
    ("every", "shared"),
    [(28, True), *(pytest.param(2, one, marks=pytest.mark.slow) for one in (False, True))],
)
def test_killed_at_many_steps_of_sealing(
    every: int, shared: bool, small: SealedField, tmp_path: Path
) -> None:
    """In a folder of their own both are exchanged in one step; else none may be there."""
    home = tmp_path / "board"
    home.mkdir()
    if shared:
        (home / "leaderboard.toml").write_text("")
    write = replaced(small)
    write(home, "aa")
    old, kept = fits(small, home), 0
    codes = []
    for step in (*range(1, 200, every), *range(200, 400, min(7, every))):
        codes.append(run(write, home, "bb", Fault("killed", step)))
        if codes[-1] != -9:
            break
        left = fits(small, home) if (home / NAME).exists() or not shared else ""
        kept += left == old
        if left != old:
            write(home, "aa")
    assert codes[-1] == _NO_FAULT
    assert kept > len(codes) / 2
    assert fits(small, home) != old
    write(home, "aa")
    assert not [path for path in home.iterdir() if path.name.startswith(".")]
