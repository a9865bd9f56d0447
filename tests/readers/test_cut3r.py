"""CUT3R's folders: read right, and refused where they are incomplete or pickled."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.opening import open_predictions
from airzoo_bench.evaluation.reader import find_reader
from tests.readers.recon_support import check_perfect, row, scored, world
from tests.readers.samples import cut3r, vggt
from tests.readers.samples.true_views import true_views
from tests.reconstruction.world import PROTOCOL, World

__all__ = ["world"]


@pytest.fixture
def out(world: World, tmp_path: Path) -> Path:
    return cut3r.write(tmp_path / "out", world)


def test_exact_depth_is_perfect_and_scores_as_through_vggt(
    world: World, out: Path, tmp_path: Path
) -> None:
    names = [f"{scene}/{name}" for scene in ("yard", "lot") for name in world.images(scene)]
    (tmp_path / "names.txt").write_text("\n".join(names))
    found = scored(world, out, names=tmp_path / "names.txt")
    check_perfect(found)
    assert found.given.reader is not None
    assert "pose camera-to-world, axes of OpenCV" in found.given.reader.conventions
    other = scored(world, vggt.write(tmp_path / "vggt", world))
    assert row(found) == row(other)
    nameless = scored(world, out)
    assert row(nameless) == row(found)
    assert any("in the order of their names" in note for note in nameless.result.notes)


def test_names_may_be_given_in_any_order(world: World, tmp_path: Path) -> None:
    out = tmp_path / "out"
    names = []
    for scene in ("yard", "lot"):
        views = true_views(world, scene)
        order = np.arange(len(views.names))[::-1]
        turned = type(views)(
            views.names, views.depth[order], views.intrinsics[order], views.w2c[order]
        )
        cut3r.write_scene(out / scene, turned)
        names += [f"{scene}/{views.names[number]}" for number in order]
    (tmp_path / "names.txt").write_text("\n".join(names))
    check_perfect(scored(world, out, names=tmp_path / "names.txt"))
    with pytest.raises(PredictionError, match="order"):
        scored(world, out)


def test_photos_beside_its_files_name_the_views(world: World, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for scene in ("yard", "lot"):
        views = true_views(world, scene)
        some = np.arange(len(views.names))[1:]
        cut3r.write_scene(
            out / scene,
            type(views)(
                views.names[1:], views.depth[some], views.intrinsics[some], views.w2c[some]
            ),
        )
    with pytest.raises(PredictionError, match="has no image_names"):
        scored(world, out)
    for scene in ("yard", "lot"):
        (out / scene / "images").mkdir()
        for name in true_views(world, scene).names[1:]:
            (out / scene / "images" / name).touch()
    found = scored(world, out)
    assert found.result.overall["ate_m"] < 1e-4
    assert found.given.reader is not None
    assert "views named by the images in images/, sorted by name" in found.given.reader.conventions
    (out / "lot" / "images" / "zzz.jpg").touch()
    with pytest.raises(PredictionError, match="names of images in"):
        scored(world, out)


def test_a_trajectory_alone_has_pose_scores_and_no_surface(world: World, tmp_path: Path) -> None:
    found = scored(world, cut3r.write_trajectories(tmp_path / "out", world))
    assert found.result.overall["pose_auc_3deg"] > 0.999
    assert found.result.overall["f1_0.2m"] == 0.0
    assert any("cameras alone" in note for note in found.result.notes)


def test_the_order_of_quaternions_is_cut3rs(world: World, tmp_path: Path) -> None:
    for scene in ("yard", "lot"):
        place = cut3r.write_trajectory(tmp_path / "out" / scene, true_views(world, scene))
        lines = [line.split() for line in (place / "pred_traj.txt").read_text().splitlines()]
        turned = [" ".join([*line[:4], *line[5:], line[4]]) for line in lines]
        (place / "pred_traj.txt").write_text("\n".join(turned))
    with pytest.raises(PredictionError, match="order"):
        scored(world, tmp_path / "out")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("depth/000001.npy", "files are missing"),
        ("camera/000001.npz", "files are missing"),
        ("conf/last", "depth holds"),
    ],
)
def test_missing_files(wrong: str, message: str, world: World, out: Path) -> None:
    folder = out / "yard" / wrong.split("/")[0]
    name = sorted(folder.iterdir())[-1].name if wrong.endswith("last") else wrong.split("/")[1]
    (folder / name).unlink()
    with pytest.raises(PredictionError, match=message):
        scored(world, out)


def test_two_files_of_one_number(world: World, out: Path) -> None:
    """Which of the two counts would be the file system's choice."""
    folder = out / "yard" / "depth"
    (folder / "1.npy").write_bytes((folder / "000001.npy").read_bytes())
    with pytest.raises(PredictionError, match=r"of one number with another: 1 \(000001\.npy\)"):
        scored(world, out)


def test_a_scene_without_its_cameras_is_named(world: World, out: Path) -> None:
    shutil.rmtree(out / "yard" / "camera")
    (out / "log.txt").touch()
    notes = scored(world, out).result.notes
    assert "scenes that the predictions lack, scored at their worst: 1 (yard)" in notes
    assert "called as scenes, without all that one is read from, left aside: 1 (yard)" in notes
    assert "files that belong to no scene, left aside: 1 (log.txt)" in notes


def test_the_pickle_of_its_evaluation_is_answered_with_the_lines(
    world: World, tmp_path: Path
) -> None:
    points = np.ones((2, 3, 4, 3))
    saved = {"images_all": points, "pts_all": points, "pts_gt_all": points, "masks_all": points}
    np.save(tmp_path / "yard.npy", saved, allow_pickle=True)  # type: ignore[arg-type]
    assert find_reader(tmp_path / "yard.npy") == "cut3r"
    given = open_predictions(tmp_path, protocol=PROTOCOL, data=world.root)
    assert given.reader is not None
    assert not given.reader.conventions
    with pytest.raises(PredictionError, match="is a pickle of CUT3R") as caught:
        scored(world, tmp_path)
    lines = str(caught.value.fix).splitlines()[1:]
    code = "\n".join(line.strip() for line in lines).replace("SCENE", str(tmp_path / "yard"))
    exec(code, {"np": np})  # noqa: S102 - the lines that a message gives
    assert np.load(tmp_path / "yard.npz")["world_points"].shape == (2, 3, 4, 3)


def test_depth_without_cameras_is_answered_with_the_demo(world: World, tmp_path: Path) -> None:
    for scene in ("yard", "lot"):
        (tmp_path / "out" / scene).mkdir(parents=True)
        for number, depth in enumerate(true_views(world, scene).depth):
            np.save(tmp_path / "out" / scene / f"frame_{number:04d}.npy", depth.astype("f4"))
            (tmp_path / "out" / scene / f"frame_{number:04d}.png").touch()
    assert find_reader(tmp_path / "out") == "cut3r"
    with pytest.raises(PredictionError, match="evaluation of videos, which keeps no cameras"):
        scored(world, tmp_path / "out")
