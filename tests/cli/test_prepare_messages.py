"""What `prepare` says of mistyped names, other options, full disks and poses the wrong way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.goldens.run import unpack
from tests.support import files_below, make_place, run_main


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    unpack("uav-visloc", tmp_path / "UAV VisLoc")
    return tmp_path / "UAV VisLoc" / "in"


def prepare(capsys: pytest.CaptureFixture[str], code: int, *more: object) -> str:
    assert run_main("prepare", "uav-visloc", "--source", *more) == code
    return " ".join(capsys.readouterr().err.split())


def test_a_scene_that_is_not_there_is_named(
    source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (source / "09").rename(source.parent / "aside")
    said = prepare(capsys, 2, source, "--scene", "09")
    assert f"there is no scene '09' below {source}" in said
    assert "(did you mean '07'?)" in prepare(capsys, 2, source, "--scene", "7")
    assert "uav-visloc-partial" in prepare(capsys, 0, source)


def test_other_options_or_files_do_not_replace_a_folder(
    source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    prepare(capsys, 0, source, "--scene", "01")
    for more in (["--fov-across", "50"], ["--scene", "07"]):
        said = prepare(capsys, 2, source, "--scene", "01", *more)
        assert "data/uav-visloc-partial: " in said
        assert "--force" in said
    (source / "01" / "01.csv").touch()
    assert "--force" in prepare(capsys, 2, source, "--scene", "01")


@pytest.mark.parametrize("extra", [[], ["--tiles", "files"]])
def test_stopping_leaves_nothing_half_written(
    extra: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*arguments: object) -> None:
        raise KeyboardInterrupt

    place = make_place(tmp_path / "sources")
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    monkeypatch.setattr("airzoo_bench.datasets.folder.write_benchmark_file", stop)
    before = files_below(tmp_path / "sources")
    assert run_main(*place.arguments(), *extra) == 130
    assert files_below(tmp_path / "sources") == before
    assert files_below(tmp_path / "data") == set()


def test_camera_to_world_poses_of_oblique_photos_are_noticed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Level, 60 degrees off nadir, to the north from the south of the map; taken the wrong way
    # round it looks to the south, whatever its azimuth was.
    sine, cosine = np.sin(np.radians(60)), np.cos(np.radians(60))
    rotation = np.array([[1, 0, 0], [0, -cosine, -sine], [0, sine, -cosine]])
    place = make_place(tmp_path, {"a.jpg": (128.0, 240.0)})
    place.change_image("a.jpg", R_w2c=rotation.T.tolist())
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    assert run_main(*place.arguments()) == 2
    message = capsys.readouterr().err
    assert "1 photo: the footprint meets no tile" in message
    assert "whether poses are world-to-camera" in message
    place.change_image("a.jpg", R_w2c=rotation.tolist())
    assert run_main(*place.arguments()) == 0
