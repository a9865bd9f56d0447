"""Files appear whole or not at all, and hold what was written."""

from __future__ import annotations

import hashlib
import io
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import ProtocolError, UsageError, UserError
from airzoo_bench.core.files import (
    atomic_folder,
    atomic_write,
    canonical_json,
    fingerprint,
    read_text,
    sha256_of,
    stamps,
    write_npz,
)
from airzoo_bench.core.places import check_output_file, check_output_folder
from airzoo_bench.core.temporaries import (
    only_writer,
)
from tests.support import files_below


def test_a_file_appears_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    with atomic_write(path, "w") as stream:
        stream.write("ü\n")
        assert not path.exists()
    assert path.read_bytes() == "ü\n".encode()
    assert files_below(tmp_path) == {"new", "new/a.txt"}
    plain = tmp_path / "plain"
    plain.touch()
    assert path.stat().st_mode == plain.stat().st_mode


@pytest.mark.parametrize("fault", [ValueError, KeyboardInterrupt, SystemExit])
def test_a_fault_leaves_the_old_file_and_nothing_else(
    fault: type[BaseException], tmp_path: Path
) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def write_half() -> None:
        with atomic_write(path) as stream:
            stream.write(b"half")
            raise fault

    with pytest.raises(fault):
        write_half()
    assert path.read_text() == "old"
    assert files_below(tmp_path) == {"a.txt"}


def test_a_file_where_a_folder_should_be(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with (
        pytest.raises(UsageError, match=r"file: a file, not a folder\n.*a\.txt needs a folder"),
        atomic_write(tmp_path / "file" / "a.txt"),
    ):
        pass
    with pytest.raises(UsageError, match="file: a file, not a folder"):
        check_output_folder(tmp_path / "file" / "deep" / "out", ())
    assert files_below(tmp_path) == {"file"}


def test_a_folder_where_a_file_should_be(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="a folder, not a file"), atomic_write(tmp_path):
        pass
    (tmp_path / "out" / "a.txt").mkdir(parents=True)
    with pytest.raises(UsageError, match=r"a\.txt: a folder, not a file"):
        check_output_folder(tmp_path / "out", ("b.txt", "a.txt"))
    check_output_folder(tmp_path / "out", ("b.txt",))
    check_output_folder(tmp_path / "none" / "deep", ("b.txt",))


def write_to(path: Path) -> None:
    with atomic_write(path, "w") as stream:
        stream.write("new")


@pytest.mark.skipif(sys.platform == "win32", reason="pipes, devices and links of POSIX")
def test_what_is_no_plain_file_stays(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path / "link", Path(os.devnull)):
        with pytest.raises(UsageError, match="a pipe or a device, not a file"):
            write_to(path)
    with pytest.raises(UsageError, match="pipe: a pipe or a device"):
        check_output_folder(tmp_path, ("a.txt", "pipe"))
    assert (tmp_path / "pipe").is_fifo()
    assert (tmp_path / "link").is_symlink()
    assert files_below(tmp_path) == {"pipe", "link"}


@pytest.mark.skipif(sys.platform == "win32", reason="links of POSIX")
def test_a_link_is_written_through(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    for name in ("old", "new"):
        (tmp_path / name).symlink_to(Path("there") / name)
    (tmp_path / "there" / "old").write_text("old")
    for name in ("old", "new"):
        write_to(tmp_path / name)
        assert (tmp_path / name).is_symlink()
        assert (tmp_path / "there" / name).read_text() == "new"
    assert files_below(tmp_path) == {"old", "new", "there", "there/old", "there/new"}
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(UsageError, match="a symbolic link that leads to itself"):
        write_to(tmp_path / "loop")


def test_a_read_only_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    path.chmod(0o444)
    with pytest.raises(UsageError, match="a read-only file, which is not replaced"):
        write_to(path)
    assert path.read_text() == "old"
    path.chmod(0o644)
    write_to(path)
    assert path.read_text() == "new"


def test_a_folder_that_takes_nothing_is_found_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "none" / "a.txt"
    check_output_file(path)
    assert files_below(tmp_path) == set()
    # Whoever may do everything may also write where the mode forbids it.
    monkeypatch.setattr(os, "access", lambda place, _: Path(place) != tmp_path)
    with pytest.raises(UsageError, match="nothing may be written into this folder"):
        check_output_file(path)


def test_what_is_read_is_not_written(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    one, other = tmp_path / "in" / "a.csv", tmp_path / "b.csv"
    one.touch()
    os.link(one, tmp_path / "c.csv")
    (tmp_path / "d.csv").symlink_to(one)
    for path in (one, tmp_path / "in" / ".." / "in" / "a.csv", tmp_path / "d.csv"):
        with pytest.raises(UsageError, match=r"csv: is read to make what would be written"):
            check_output_file(path, [other, one])
    check_output_file(other, [other, one])
    check_output_file(one, [other])


@pytest.mark.parametrize("name", ["x" * 251 + ".txt", "ü" * 125 + ".txt"])
def test_the_longest_names_that_a_system_takes(name: str, tmp_path: Path) -> None:
    write_to(tmp_path / name)
    with atomic_folder(tmp_path / "out" / name) as folder:
        (folder / "a").touch()
    assert files_below(tmp_path) == {name, "out", f"out/{name}", f"out/{name}/a"}
    with pytest.raises(UserError, match=r"cannot be written: .*too long"):
        check_output_file(tmp_path / f"{name}{name}")


def test_a_full_disk_is_the_user_s_to_fix(tmp_path: Path) -> None:
    with (
        pytest.raises(UserError, match="cannot be written: No space left on device\n  fix"),
        atomic_write(tmp_path / "a"),
    ):
        raise OSError(28, "No space left on device")
    assert files_below(tmp_path) == set()


def test_hashes(tmp_path: Path) -> None:
    content = bytes(range(256)) * 10_000
    (tmp_path / "a").write_bytes(content)
    assert sha256_of(tmp_path / "a") == hashlib.sha256(content).hexdigest()
    assert canonical_json({"b": [1, 2.5], "a": None}) == '{"a":null,"b":[1,2.5]}'
    assert fingerprint({"a": 1, "b": 2}) == fingerprint({"b": 2, "a": 1})
    assert fingerprint({"a": 1}) != fingerprint({"a": 1.5})
    with pytest.raises(ValueError, match="JSON compliant"):
        canonical_json(float("nan"))


@pytest.mark.parametrize("compress", [False, True])
def test_npz_is_numpy_s_and_the_same_to_the_last_byte(compress: bool, tmp_path: Path) -> None:
    arrays = {"a": np.arange(5), "b": np.array(["x", "ü"]), "file": np.array(1.5)}
    one, other = io.BytesIO(), io.BytesIO()
    write_npz(one, arrays, compress=compress)
    write_npz(other, arrays, compress=compress)
    assert one.getvalue() == other.getvalue()
    one.seek(0)
    with np.load(one, allow_pickle=False) as loaded:
        for name, array in arrays.items():
            np.testing.assert_array_equal(loaded[name], array)


def test_npz_never_pickles(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="pickle"):
        write_npz(io.BytesIO(), {"a": np.array([{}], dtype=object)})


def test_text_that_a_person_wrote(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes("ü".encode())
    assert read_text(path, ProtocolError, "protocol file") == "ü"
    with pytest.raises(ProtocolError, match=r"too large for a protocol file\n.*at most 1 bytes"):
        read_text(path, ProtocolError, "protocol file", limit_bytes=1)
    path.write_bytes(b"a\nc\xff")
    with pytest.raises(ProtocolError, match="not text: byte 3 is not UTF-8, in line 2"):
        read_text(path, ProtocolError, "protocol file")
    with pytest.raises(ProtocolError, match="no such protocol file"):
        read_text(tmp_path / "b", ProtocolError, "protocol file")
    with pytest.raises(ProtocolError, match="a folder, not a protocol file"):
        read_text(tmp_path, ProtocolError, "protocol file")


@pytest.mark.skipif(sys.platform == "win32", reason="no locks there")
def test_a_lock_follows_no_link(tmp_path: Path) -> None:
    with only_writer(tmp_path / "mine.npz"):
        [lock] = tmp_path.iterdir()
    (tmp_path / "theirs").write_text("kept")
    lock.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match=lock.name), only_writer(tmp_path / "mine.npz"):
        pass
    assert not (tmp_path / "elsewhere").exists()


def test_stamps_are_of_files_that_are_there(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "one").write_bytes(b"12")
    (tmp_path / "to nothing").symlink_to(tmp_path / "nothing")
    os.utime(tmp_path / "a" / "one", ns=(0, 5))
    assert stamps(tmp_path) == {tmp_path / "a" / "one": (2, 5)}
    assert stamps(tmp_path / "a" / "one") == {tmp_path / "a" / "one": (2, 5)}
    for name in ("nothing", "a\0b"):
        assert stamps(tmp_path / name) == {}
