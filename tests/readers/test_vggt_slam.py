"""VGGT-SLAM's logs: numbers that mean photos, frames that submaps share, and what is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.reader import find_reader
from airzoo_bench.readers.scene_folders import ScenePlaces
from airzoo_bench.readers.vggt_slam import VGGT_SLAM
from tests.readers.recon_support import check_perfect, scored, world
from tests.readers.samples import vggt_slam
from tests.readers.samples.true_views import true_views
from tests.reconstruction.world import World

__all__ = ["world"]


@pytest.fixture
def out(world: World, tmp_path: Path) -> Path:
    return vggt_slam.write(tmp_path / "out", world)


def test_exact_points_are_perfect_and_shared_frames_count_once(world: World, out: Path) -> None:
    found = scored(world, out, names=out.with_name("out-names.txt"))
    check_perfect(found, tolerance_m=1e-3)  # 8 decimals of a frame 32 times smaller


@pytest.mark.parametrize("twice", [False, True])
def test_numbers_with_gaps(twice: bool, world: World, tmp_path: Path) -> None:
    """Every fifth frame of a video, say: the list says which number is which photo's."""
    lines = []
    for scene in ("yard", "lot"):
        views = true_views(world, scene)
        frames = [f"frame_{5 * row:04d}.png" for row in range(len(views.names))]
        vggt_slam.write_scene(tmp_path / "out" / scene, views, frames)
        lines += [f"{5 * row:04d} {scene}/{name}" for row, name in enumerate(views.names)]
    names = tmp_path / "names.txt"
    names.write_text("\n".join(reversed(lines)).replace("0005 yard", "5.0 yard"))
    if twice:
        names.write_text("\n".join(lines).replace("0005 yard", "0000 yard"))
        with pytest.raises(PredictionError, match=r"names\.txt"):
            scored(world, tmp_path / "out", names=names)
    else:
        check_perfect(scored(world, tmp_path / "out", names=names), tolerance_m=1e-3)


def test_numbers_in_the_names_of_photos(world: World, tmp_path: Path) -> None:
    for scene in ("yard", "lot"):
        views = true_views(world, scene)
        vggt_slam.write_scene(tmp_path / "out" / scene, views, views.names)
    check_perfect(scored(world, tmp_path / "out"), tolerance_m=1e-3)


def test_cameras_alone(world: World, tmp_path: Path) -> None:
    for scene in ("yard", "lot"):
        views = true_views(world, scene)
        vggt_slam.write_scene(tmp_path / "out" / scene, views, views.names, dense=False)
    assert find_reader(tmp_path / "out" / "yard" / "poses.txt") == "vggt-slam"
    found = scored(world, tmp_path / "out")
    assert found.result.overall["pose_auc_3deg"] > 0.999
    assert found.result.overall["f1_0.2m"] == 0.0
    assert any("skip_dense_log" in note for note in found.result.notes)


def test_names_that_begin_with_a_date_collapse(world: World, tmp_path: Path) -> None:
    views = true_views(world, "yard")
    dated = [f"DJI_20260101101500_{row:04d}.JPG" for row in range(len(views.names))]
    place = vggt_slam.write_scene(tmp_path / "yard", views, dated)
    assert len(list((place / "poses_logs").iterdir())) == 1
    with pytest.raises(PredictionError, match="share 1 number") as caught:
        scored(world, tmp_path)
    assert "numbered/{number:06d}" in str(caught.value.fix)


@pytest.mark.parametrize("share", ["one", "half"])
def test_files_that_are_missing(share: str, world: World, out: Path) -> None:
    files = sorted((out / "yard" / "poses_logs").iterdir())
    for path in files[: 1 if share == "one" else len(files) // 2]:
        path.unlink()
    with pytest.raises(PredictionError, match="files are missing"):
        scored(world, out, names=out.with_name("out-names.txt"))


def test_what_contradicts_is_refused(world: World, out: Path) -> None:
    names = out.with_name("out-names.txt")
    folder = out / "yard" / "poses_logs"
    text = out / "yard" / "poses.txt"
    whole = text.read_text()
    np.savez(folder / "77.0.npz", pointcloud=np.ones((4, 5, 3)), mask=np.ones((4, 5), bool))
    with pytest.raises(PredictionError, match="files of no line"):
        scored(world, out, names=names)
    (folder / "77.0.npz").unlink()
    text.write_text(whole.replace("1.00000000 ", "77.00000000 ", 1))
    with pytest.raises(PredictionError, match="of no photo"):
        scored(world, out, names=names)
    text.write_text(whole + "1 2 3\n")
    with pytest.raises(PredictionError, match="is '1 2 3'"):
        scored(world, out, "vggt-slam", names=names)
    text.write_text(whole)
    np.savez(folder / "0.0.npz", pointcloud=np.ones((4, 5, 3)), mask=np.ones((4, 5)))
    with pytest.raises(PredictionError, match="mask"):
        scored(world, out, names=names)


def test_poses_that_went_away_before_their_scene_is_read(out: Path) -> None:
    (out / "yard" / "poses.txt").unlink()
    reading: Any = None  # is not looked at without poses
    scenes = ScenePlaces(out, {"yard": out / "yard"}, (), reading)
    with pytest.raises(PredictionError, match="no text of poses"):
        VGGT_SLAM.read_scene(scenes, out / "yard", 1 << 20)
