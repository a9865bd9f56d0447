"""What is kept on this machine: all of it is listed, and nothing else is ever removed."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from airzoo_bench.storage.inventory import kept_in_cache, remove
from airzoo_bench.storage.mirror import Mirror
from airzoo_bench.storage.urls import Url
from tests.support import run_main

DAY_S = 86_400
OLD_S = time.time() - 40 * DAY_S
PREDICTIONS = f"fetched-predictions/{'a' * 64}"


@pytest.fixture
def root(tmp_path: Path, mirrors: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with a cache and a data root, each with things to keep and to leave alone."""
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    for name in (
        *("data/park/benchmark.toml", f"data/{PREDICTIONS}/p.npz", "data/mini-worlds/city-0/a"),
        *("data/fetched-predictions/mine/p.npz", "data/made/airzoo-real/m", "data/surfaces/s/m"),
        *("mirrors/run-0123456789ab.unfinished/1.task", "mirrors/unsent-0123456789ab/result.json"),
        *("mirrors/photos of mine/1.jpg", f"mirrors/{'b' * 24}/no mirror", "elsewhere/thing"),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(bytes(1000))
    (mirrors / ("c" * 24)).symlink_to(tmp_path / "elsewhere")
    (mirrored("old") / "large").write_bytes(bytes(5_000_000))
    for path in tmp_path.rglob("*"):
        os.utime(path, (OLD_S, OLD_S), follow_symlinks=False)
    mirrored("new")
    return tmp_path


def mirrored(name: str) -> Path:
    return Mirror.of(Url("s3", f"bucket/{name}"), "1").tree


def files(root: Path) -> set[str]:
    return {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()}


def test_all_is_listed_and_nothing_removed(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = files(root)
    assert run_main("cache") == 0
    printed = capsys.readouterr()
    listed = {line[24:48].strip(): line.split()[:4] for line in printed.out.splitlines()}
    assert set(listed) == {
        *("mirror", "finished tasks", "run not uploaded (stays)", "predictions"),
        *("world (stays)", "maps (stays)", "surface (stays)"),
    }
    assert listed["predictions"] == ["1", "kB", "40", "days"]
    assert "s3://bucket/old" in printed.out
    assert "8 folders, 5.01 MB" in printed.err
    assert files(root) == before


def test_what_was_not_used_is_removed_and_nothing_else(
    root: Path, mirrors: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = files(root)
    assert run_main("cache", "--remove-older-than", 30, "--yes") == 0
    told = capsys.readouterr()
    assert "removed 3 folders: 5 MB are free" in told.err
    gone = before - files(root)
    assert {name.partition("/")[2].split("/")[0] for name in gone if "mirrors" in name} == {
        *("run-0123456789ab.unfinished", mirrored("old").parent.name)
    }
    assert {name for name in gone if "data" in name} == {f"data/{PREDICTIONS}/p.npz"}
    assert not [name for name in files(root) if "airzoo-part" in name]
    assert (mirrors / ("c" * 24)).is_symlink()
    assert run_main("cache", "--remove-older-than", 0, "--yes") == 0
    assert not [one for one in kept_in_cache() if one.kind == "mirror"]
    assert (root / "data" / "park" / "benchmark.toml").exists()
    assert (mirrors / "unsent-0123456789ab" / "result.json").exists()


def test_a_mirror_that_is_used_is_not_old(root: Path) -> None:
    mirrored("old")
    before = files(root)
    assert run_main("cache", "--remove-older-than", 30, "--yes") == 0
    assert not [name for name in before - files(root) if "large" in name]


def test_nothing_is_removed_unasked(
    root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = files(root)
    assert run_main("cache", "--remove-older-than", 30) == 2
    assert "nothing was removed: nobody can be asked" in capsys.readouterr().err
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("typer.confirm", lambda *_, **__: (_ for _ in ()).throw(SystemExit(1)))
    assert run_main("cache", "--remove-older-than", 30) == 1
    assert files(root) == before


def test_what_is_not_made_again_is_never_removed(root: Path) -> None:
    (unsent,) = (one for one in kept_in_cache() if not one.spare)
    with pytest.raises(ValueError, match="not to be removed"):
        remove(unsent)


def test_a_data_root_at_a_url_has_a_cache_too(
    root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", "s3://bucket/benchmarks")
    assert run_main("cache") == 0
    assert "4 folders" in capsys.readouterr().err


def test_a_place_that_is_a_link_is_left_alone(root: Path) -> None:
    data, there = root / "data", root / "elsewhere" / "fetched"
    (data / "fetched-predictions").rename(there)
    (data / "fetched-predictions").symlink_to(there)
    assert run_main("cache", "--remove-older-than", 0, "--yes") == 0
    assert (there / ("a" * 64) / "p.npz").exists()
