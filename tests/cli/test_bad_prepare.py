"""What `prepare photos` does when it is stopped, and with poses taken the wrong way round."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support import files_below, make_place, run_main


@pytest.mark.parametrize("extra", [[], ["--copy"], ["--tiles", "files"]])
def test_stopping_leaves_nothing_half_written(
    extra: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
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
