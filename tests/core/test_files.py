"""Files and folders appear whole or not at all, and only what was made so is replaced."""

from __future__ import annotations

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
    fingerprint,
    only_writer,
    read_text,
    sha256_of_tree,
    temporary_folder,
    write_npz,
)
from tests.support import files_below

posix = pytest.mark.skipif(sys.platform == "win32", reason="pipes, devices, links and locks")


def test_a_file_appears_when_it_is_complete(tmp_path: Path) -> None:
    path, plain = tmp_path / "new" / "a.txt", tmp_path / "plain"
    with atomic_write(path, "w") as stream:
        stream.write("ü\n")
        assert not path.exists()
    assert path.read_bytes() == "ü\n".encode()
    assert files_below(tmp_path) == {"new", "new/a.txt"}
    plain.touch()
    assert path.stat().st_mode == plain.stat().st_mode


@posix
def test_only_a_plain_file_is_replaced_and_links_are_written_through(tmp_path: Path) -> None:
    for name in ("folder", "there"):
        (tmp_path / name).mkdir()
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "fixed").touch(0o444)
    for name, target in (("odd", "pipe"), ("link", "there/old"), ("more", "there/new")):
        (tmp_path / name).symlink_to(target)
    (tmp_path / "there" / "old").touch()
    before = files_below(tmp_path)
    for path in (*(tmp_path / name for name in ("pipe", "odd", "folder", "fixed")), "/dev/null"):
        with pytest.raises(UsageError), atomic_write(Path(path)):
            pass
    refused = {tmp_path / "fixed" / "deep": (), tmp_path: ("b", "folder"), Path("s3://a/b"): ()}
    for folder, names in refused.items():
        with pytest.raises(UsageError):
            check_output_folder(folder, names)
    check_output_folder(tmp_path / "none" / "deep", ("b",))
    assert files_below(tmp_path) == before
    for name, target in (("link", "old"), ("more", "new")):
        with atomic_write(tmp_path / name, "w") as stream:
            stream.write("new")
        assert (tmp_path / name).is_symlink()
        assert (tmp_path / "there" / target).read_text() == "new"
    assert files_below(tmp_path) == before | {"there/new"}


def test_a_full_disk_is_the_user_s_to_fix(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="No space left"), atomic_write(tmp_path / "a"):
        raise OSError(28, "No space left on device")
    assert files_below(tmp_path) == set()


def test_hashes(tmp_path: Path) -> None:
    assert canonical_json({"b": [1, 2.5], "a": None}) == '{"a":null,"b":[1,2.5]}'
    assert fingerprint({"a": 1}) != fingerprint({"a": 1.5})
    with pytest.raises(ValueError, match="JSON compliant"):
        canonical_json(float("nan"))
    plain, linked, other = (tmp_path / name for name in ("plain", "linked", "other"))
    for folder in (plain / "a", plain / "b", linked / "a", other):
        folder.mkdir(parents=True)
        (folder / "x").write_text(folder.name.replace("other", "b"))
    (linked / "b").symlink_to(other)
    assert sha256_of_tree(linked) == sha256_of_tree(plain)


@pytest.mark.parametrize("compress", [False, True])
def test_npz_is_numpy_s_and_the_same_to_the_last_byte(compress: bool) -> None:
    arrays = {"a": np.arange(5), "b": np.array(["x", "ü"]), "file": np.array(1.5)}
    one, other = io.BytesIO(), io.BytesIO()
    for stream in (one, other):
        write_npz(stream, arrays, compress=compress)
    assert one.getvalue() == other.getvalue()
    one.seek(0)
    with np.load(one, allow_pickle=False) as loaded:
        assert {name: loaded[name].tolist() for name in loaded} == {
            name: array.tolist() for name, array in arrays.items()
        }


def test_text_that_a_person_wrote(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes("ü".encode())
    assert read_text(path, ProtocolError, "protocol file") == "ü"
    (tmp_path / "latin").write_bytes(b"a\nc\xff")
    for wrong, limit in ((path, 1), (tmp_path / "latin", 9), (tmp_path / "b", 9), (tmp_path, 9)):
        with pytest.raises(ProtocolError, match="protocol file"):
            read_text(wrong, ProtocolError, "protocol file", limit_bytes=limit)


@posix
def test_a_folder_has_one_writer(tmp_path: Path) -> None:
    with only_writer(tmp_path / "a"), pytest.raises(UsageError), only_writer(tmp_path / "a"):
        pass
    with only_writer(tmp_path / "a") as is_locked:
        assert is_locked
    (tmp_path / "link").symlink_to(tmp_path)
    with pytest.raises(OSError, match="link"), only_writer(tmp_path / "link"):
        pass


@posix
def test_what_a_dead_process_left_is_cleared_and_what_lives_is_not(tmp_path: Path) -> None:
    die = (
        "import os, sys; from pathlib import Path; from airzoo_bench.core import files;"
        "one = files.temporary_folder(Path(sys.argv[1]), 'a'); (one.__enter__() / 'x').touch();"
        "os.kill(os.getpid(), 9)"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", die, str(tmp_path)], env=environment, check=False)
    with temporary_folder(tmp_path, "other"):
        assert len(files_below(tmp_path)) == 3
    with temporary_folder(tmp_path, "a") as mine, temporary_folder(tmp_path, "a") as more:
        assert files_below(tmp_path) == {mine.name, more.name}
        assert mine.stat().st_mode & 0o077 == 0
    assert files_below(tmp_path) == set()


def test_other_files_of_a_folder_stay(tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "figures").mkdir(parents=True)
    for name in ("a", "thesis.tex", "figures/old.png"):
        (out / name).touch()
    with atomic_entries(out, ("a", "b", "figures")) as staged:
        (staged / "b").touch()
    assert files_below(tmp_path) == {"out", "out/b", "out/thesis.tex"}
    # Only a benchmark folder is replaced as a whole.
    for replace in (False, True):
        with pytest.raises(UsageError), atomic_folder(out, replace=replace):
            pass
    (out / "benchmark.toml").touch()
    with atomic_folder(out, replace=True) as staged:
        (staged / "new").touch()
    assert files_below(tmp_path) == {"out", "out/new"}
