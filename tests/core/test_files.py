"""Files and folders appear whole or not at all, and only what was made so is replaced."""

from __future__ import annotations

import hashlib
import io
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import ProtocolError, UsageError, UserError
from airzoo_bench.core.files import (
    atomic_entries,
    atomic_folder,
    atomic_write,
    canonical_json,
    check_output_folder,
    clear_abandoned,
    fingerprint,
    only_writer,
    read_text,
    sha256_of,
    sha256_of_tree,
    temporary_file,
    temporary_folder,
    write_npz,
)
from tests.support import files_below as names_below


def test_a_file_appears_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    with atomic_write(path, "w") as stream:
        stream.write("ü\n")
        assert not path.exists()
    assert path.read_bytes() == "ü\n".encode()
    assert names_below(tmp_path) == {"new", "new/a.txt"}
    plain = tmp_path / "plain"
    plain.touch()
    assert path.stat().st_mode == plain.stat().st_mode


def test_a_file_where_a_folder_should_be(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with (
        pytest.raises(UsageError, match=r"file: a file, not a folder"),
        atomic_write(tmp_path / "file" / "a.txt"),
    ):
        pass
    with pytest.raises(UsageError, match="file: a file, not a folder"):
        check_output_folder(tmp_path / "file" / "deep" / "out", ())
    assert names_below(tmp_path) == {"file"}


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
    assert names_below(tmp_path) == {"pipe", "link"}


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
    assert names_below(tmp_path) == {"old", "new", "there", "there/old", "there/new"}


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


def test_a_full_disk_is_the_user_s_to_fix(tmp_path: Path) -> None:
    with (
        pytest.raises(UserError, match="cannot be written: No space left on device\n  fix"),
        atomic_write(tmp_path / "a"),
    ):
        raise OSError(28, "No space left on device")
    assert names_below(tmp_path) == set()


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


def test_links_are_followed_and_end(tmp_path: Path) -> None:
    plain, linked, other = (tmp_path / name for name in ("plain", "linked", "other"))
    for folder in (plain / "a", plain / "b", linked / "a", other):
        folder.mkdir(parents=True)
        (folder / "x").write_text(folder.name.replace("other", "b"))
    (linked / "b").symlink_to(other)
    (other / "round").symlink_to(linked)
    assert sha256_of_tree(linked) == sha256_of_tree(plain)


@pytest.mark.skipif(sys.platform == "win32", reason="links of POSIX")
def test_names_that_somebody_else_made_are_not_used(tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir()
    for name in (".a.airzoo-part", ".b.airzoo-part"):
        (tmp_path / name).symlink_to("theirs")
    with temporary_folder(tmp_path, "a") as folder, temporary_file(tmp_path / "b") as (one, file):
        os.close(one)
        assert folder.resolve().parent == file.resolve().parent == tmp_path
        assert folder.stat().st_mode & 0o077 == file.stat().st_mode & 0o077 == 0


@pytest.mark.skipif(sys.platform == "win32", reason="no locks")
def test_what_a_dead_process_left_is_cleared_and_what_lives_is_not(tmp_path: Path) -> None:
    """A child dies with a temporary file and a folder; this process holds one of each."""
    die = (
        "import os, sys; from pathlib import Path; from airzoo_bench.core import files as t;"
        "home = Path(sys.argv[1]); a = t.temporary_file(home / 'a'); a.__enter__();"
        "b = t.temporary_folder(home, 'b'); (b.__enter__() / 'x').touch(); os.kill(os.getpid(), 9)"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", die, str(tmp_path)], env=environment, check=False)
    assert len(names_below(tmp_path)) == 3
    clear_abandoned(tmp_path / "other")
    assert len(names_below(tmp_path)) == 3
    with temporary_folder(tmp_path, "mine") as mine, temporary_file(tmp_path / "own") as (one, own):
        os.close(one)
        for name in ("a", "b", "mine", "own"):
            clear_abandoned(tmp_path / name)
        assert names_below(tmp_path) == {mine.name, own.name}
    assert names_below(tmp_path) == set()


def test_a_folder_with_other_files_keeps_them(tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "figures").mkdir(parents=True)
    for name in ("a", "thesis.tex", "figures/old.png"):
        (out / name).touch()
    with atomic_entries(out, ("a", "b", "figures")) as staged:
        (staged / "b").touch()
    assert names_below(tmp_path) == {"out", "out/b", "out/thesis.tex"}


def test_only_a_benchmark_folder_is_replaced(tmp_path: Path) -> None:
    folder = tmp_path / "f"
    folder.mkdir()
    (folder / "thesis.tex").touch()
    with pytest.raises(UsageError, match=r"exists already.*\n.*--force"), atomic_folder(folder):
        pass
    with (
        pytest.raises(UsageError, match="not a benchmark folder, and so is not replaced"),
        atomic_folder(folder, replace=True),
    ):
        pass
    assert names_below(folder) == {"thesis.tex"}
    (folder / "benchmark.toml").touch()
    with atomic_folder(folder, replace=True) as staged:
        (staged / "new").touch()
    assert names_below(tmp_path) == {"f", "f/new"}
