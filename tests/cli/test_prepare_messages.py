"""What `prepare` and others say of names that are mistyped, other options, full disks."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from airzoo_bench.datasets import prepare as scene_run
from tests.datasets.published.uav_visloc_tree import make_tree
from tests.support import run_main


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return make_tree(tmp_path / "UAV VisLoc")


def said_by(capsys: pytest.CaptureFixture[str], code: int, *command: object) -> str:
    assert run_main(*command) == code
    return " ".join(capsys.readouterr().err.split())


def prepare(capsys: pytest.CaptureFixture[str], code: int, *more: object) -> str:
    return said_by(capsys, code, "prepare", "uav-visloc", "--source", *more)


def test_a_scene_that_is_not_there_is_named(
    source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (source / "09").rename(source.parent / "aside")
    said = prepare(capsys, 2, source, "--scene", "09")
    assert f"there is no scene '09' below {source}" in said
    assert "(did you mean '07'?)" in prepare(capsys, 2, source, "--scene", "7")
    assert "uav-visloc-partial" in prepare(capsys, 0, source)


def test_names_that_are_nearly_right_are_offered(
    source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = prepare(capsys, 2, source.with_name("UAV VisLok"))
    assert "no such folder" in said
    for command in ("prepare", "download"):
        said = said_by(capsys, 2, command, "UAV_VisLoc")
        assert "(did you mean 'uav-visloc'?)" in said
    assert "airzoo-bench eval retrieval nowhere.npz" in said_by(
        capsys, 2, "eval", "nowhere.npz"
    ).replace("python -m airzoo_bench", "airzoo-bench").replace("pytest", "airzoo-bench")


def test_options_that_differ_are_named(source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    prepare(capsys, 0, source, "--scene", "01")
    again = "the folder exists already, made with"
    said = prepare(capsys, 2, source, "--scene", "01", "--fov-across", 50)
    assert f"{again} --fov-across 52.0, now 50.0" in said
    said = prepare(capsys, 2, source, "--scene", "01", "--scene", "07")
    assert f"{again} scenes 01" in said
    (source / "01" / "01.csv").touch()
    said = prepare(capsys, 2, source, "--scene", "01")
    assert "made from files that have changed since" in said
    assert "nothing to do" not in said


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS])
def test_a_disk_that_cannot_be_written_is_named(
    source: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def refuses(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(scene_run, "write_scene", refuses)
    said = prepare(capsys, 2, source, "--scene", "01")
    assert f"data/uav-visloc-partial: cannot be written: {os.strerror(number)} fix:" in said
