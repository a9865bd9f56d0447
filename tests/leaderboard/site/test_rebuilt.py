"""A board built again: the same bytes from whatever way to them, and whole or not at all."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.engines.engine import Processes
from airzoo_bench.leaderboard.site.build import build_board
from tests.leaderboard.site.support import built, files_of, given, method, some_runs, write_version


def test_the_same_bytes_from_nothing_from_a_cache_and_in_any_order(
    root: Path, tmp_path: Path
) -> None:
    expected = files_of(root / "site")
    shutil.copytree(root / "runs", tmp_path / "runs", copy_function=shutil.copy)
    moved = sorted((tmp_path / "runs/made/retrieval").iterdir(), reverse=True)
    for path in moved:  # entries come back in another order
        path.rename(path.with_name(f"{path.name}~")).rename(path)
    write_version(tmp_path / "runs", "m1", 2, method("Method 1", 0.9))
    built(tmp_path)  # fills the cache, with a method that is not on the board later
    shutil.rmtree(tmp_path / "runs/made/retrieval/m1/2")
    assert files_of(built(tmp_path)) == expected
    assert files_of(built(tmp_path, out="other", cache="empty")) == expected


def test_the_cache_forgets_what_has_gone(tmp_path: Path) -> None:
    def kept() -> int:
        return len([*(tmp_path / "cache").glob("*.values")])

    some_runs(tmp_path / "runs")
    built(tmp_path)
    before = kept()
    shutil.rmtree(tmp_path / "runs/made/retrieval/m0")
    built(tmp_path)
    assert 0 < kept() == before - 2  # of two versions


def flipped(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.parametrize("damage", [flipped, lambda content: b""])
@pytest.mark.parametrize("changed", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_damaged_cache_gives_no_other_page(
    root: Path, tmp_path: Path, damage: Callable[[bytes], bytes], changed: bool
) -> None:
    shutil.copytree(root / "runs", tmp_path / "runs")
    built(tmp_path)
    if changed:
        write_version(tmp_path / "runs", "m1", 2, method("Method 1", 0.9))
    expected = files_of(built(tmp_path, "whole", "other"))
    kept = [path for path in (tmp_path / "cache").iterdir() if path.suffix != ".values"]
    assert kept
    for path in kept:
        path.write_bytes(damage(path.read_bytes()))
    assert files_of(built(tmp_path)) == expected


def test_damaged_values_of_a_method_are_named(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs")
    built(tmp_path)
    for path in (tmp_path / "cache").glob("*.values"):
        path.write_bytes(flipped(path.read_bytes()))
    with pytest.raises(UserError, match="is damaged: a build kept it") as refused:
        built(tmp_path)
    assert f"delete the folder {tmp_path / 'cache'}" in (refused.value.fix or "")


def test_two_processes_give_the_same_bytes(root: Path) -> None:
    site = build_board(given(root), root / "two", root / "fresh", engine=Processes(2), note=print)
    assert files_of(site) == files_of(root / "site")


def test_a_folder_that_is_no_board_is_not_replaced(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 1)
    (tmp_path / "site").mkdir()
    (tmp_path / "site/thesis.tex").touch()
    with pytest.raises(UserError, match="not replaced"):
        built(tmp_path)
    assert (tmp_path / "site/thesis.tex").exists()


def test_the_folder_above_the_site_is_made(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 2)
    assert (built(tmp_path, out="new/folder/site") / "index.html").is_file()


def test_two_builds_at_once_are_refused(tmp_path: Path) -> None:
    from airzoo_bench.core.files import only_writer

    some_runs(tmp_path / "runs", 1)
    with only_writer(tmp_path / "site"), pytest.raises(UserError, match="another build"):
        built(tmp_path)


_KILLER = """
import os, random, signal, sys, time
from pathlib import Path
from tests.leaderboard.site.support import built, files_of
root, moments = Path(sys.argv[1]), int(sys.argv[2])
old, new = files_of(root / "site"), files_of(built(root, out="whole", cache="cold"))
assert old != new
start = time.perf_counter()
built(root, out="timed", cache="other")
whole = time.perf_counter() - start
for moment in range(moments):
    child = os.fork()
    if child == 0:
        built(root)
        os._exit(0)
    time.sleep(whole * 1.1 * (moment + 0.5) / moments)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    found = files_of(root / "site")
    assert found in (old, new), moment
    if moment % 3 == 2:
        assert files_of(built(root)) == new, moment
        left = [path.name for path in root.iterdir() if "airzoo" in path.name]
        assert not left, left
assert files_of(built(root)) == new
print("held")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no fork")
@pytest.mark.parametrize("moments", [3, pytest.param(100, marks=pytest.mark.slow)])
def test_a_killed_build_leaves_the_board_whole(root: Path, tmp_path: Path, moments: int) -> None:
    shutil.copytree(root / "runs", tmp_path / "runs")
    shutil.copytree(root / "site", tmp_path / "site")
    write_version(tmp_path / "runs", "m1", 2, method("Method 1", 0.9))
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[3]), *sys.path]),
        "OPENBLAS_NUM_THREADS": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", _KILLER, str(tmp_path), str(moments)],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout == "held\n", done.stderr
