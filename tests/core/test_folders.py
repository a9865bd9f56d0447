"""Folders appear whole or not at all, and only what was made so is replaced."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import (
    atomic_entries,
    atomic_folder,
)
from airzoo_bench.core.temporaries import (
    clear_abandoned,
    temporary_file,
    temporary_folder,
)
from tests.support import files_below


def test_a_folder_appears_when_it_is_complete(tmp_path: Path) -> None:
    with atomic_folder(tmp_path / "new" / "f") as folder:
        (folder / "a").touch()
        assert not (tmp_path / "new" / "f").exists()
    assert files_below(tmp_path) == {"new", "new/f", "new/f/a"}


@pytest.mark.parametrize("fault", [ValueError, KeyboardInterrupt])
def test_a_fault_leaves_the_old_folder(fault: type[BaseException], tmp_path: Path) -> None:
    (tmp_path / "f").mkdir()
    (tmp_path / "f" / "benchmark.toml").touch()

    def fill_half() -> None:
        with atomic_folder(tmp_path / "f", replace=True) as folder:
            (folder / "a").touch()
            raise fault

    with pytest.raises(fault):
        fill_half()
    assert files_below(tmp_path) == {"f", "f/benchmark.toml"}


@pytest.mark.skipif(sys.platform == "win32", reason="no locks")
def test_what_a_dead_process_left_is_cleared_and_what_lives_is_not(tmp_path: Path) -> None:
    """A child dies with a temporary file and a folder; this process holds one of each."""
    die = (
        "import os, sys; from pathlib import Path; from airzoo_bench.core import temporaries as t;"
        "home = Path(sys.argv[1]); a = t.temporary_file(home / 'a'); a.__enter__();"
        "b = t.temporary_folder(home, 'b'); (b.__enter__() / 'x').touch(); os.kill(os.getpid(), 9)"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", die, str(tmp_path)], env=environment, check=False)
    assert len(files_below(tmp_path)) == 3
    clear_abandoned(tmp_path / "other")
    assert len(files_below(tmp_path)) == 3
    with temporary_folder(tmp_path, "mine") as mine, temporary_file(tmp_path / "own") as (one, own):
        os.close(one)
        for name in ("a", "b", "mine", "own"):
            clear_abandoned(tmp_path / name)
        assert files_below(tmp_path) == {mine.name, own.name}
    assert files_below(tmp_path) == set()


def test_a_folder_with_other_files_keeps_them(tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "figures").mkdir(parents=True)
    for name in ("a", "thesis.tex", "figures/old.png"):
        (out / name).touch()
    with atomic_entries(out, ("a", "b", "figures")) as staged:
        (staged / "b").touch()
    assert files_below(tmp_path) == {"out", "out/b", "out/thesis.tex"}


@pytest.mark.skipif(sys.platform == "win32", reason="a folder in use cannot be renamed there")
def test_the_working_folder_stays_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a").touch()
    before = tmp_path.stat().st_ino
    with atomic_entries(Path(), ("a", "b")) as staged:
        (staged / "b").touch()
    assert tmp_path.stat().st_ino == before
    assert {path.name for path in Path().iterdir()} == {"b"}


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
    assert files_below(folder) == {"thesis.tex"}
    (folder / "benchmark.toml").touch()
    with atomic_folder(folder, replace=True) as staged:
        (staged / "new").touch()
    assert files_below(tmp_path) == {"f", "f/new"}
