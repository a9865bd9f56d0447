"""COLMAP models of networks: read as pycolmap reads them, and refused where they are damaged."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.reader import find_reader
from airzoo_bench.readers.colmap_models import _points, first_cameras
from tests.readers.recon_support import check_perfect, scored, world
from tests.readers.samples import vggt_colmap
from tests.readers.samples.network_models import write_model, write_points_ply
from tests.readers.samples.true_views import true_views
from tests.reconstruction.world import PHOTO_SIZE, World

__all__ = ["world"]


def one(world: World, folder: Path) -> Path:
    views = true_views(world, "yard")
    model = write_model(folder / "out" / "yard" / "sparse", views)
    write_points_ply(model, views)
    return model


def test_exact_models_are_perfect(world: World, tmp_path: Path) -> None:
    path = vggt_colmap.write(tmp_path / "out", world)
    assert find_reader(path) == "vggt-colmap"
    found = scored(world, path)
    check_perfect(found)
    assert found.result.predictions.kind == "cloud"


def test_a_list_of_names_is_refused_since_a_model_has_them(world: World, tmp_path: Path) -> None:
    path = vggt_colmap.write(tmp_path / "out", world)
    names = [f"{scene}/{name}" for scene in ("yard", "lot") for name in world.images(scene)]
    (tmp_path / "names.txt").write_text("\n".join(names))
    with pytest.raises(PredictionError, match="--names is not used"):
        scored(world, path, names=tmp_path / "names.txt")


def test_the_samples_are_models_of_colmap(world: World, tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    views, model = true_views(world, "yard"), one(world, tmp_path)
    found = pycolmap.Reconstruction(str(model))
    assert sorted(image.name for image in found.images.values()) == views.names
    for number, image in found.images.items():
        pose = image.cam_from_world().matrix()
        np.testing.assert_allclose(pose, views.w2c[number - 1, :3], atol=1e-12)
    points = np.array([point.xyz for point in found.points3D.values()])
    np.testing.assert_allclose(np.sort(points, 0), np.sort(views.points[views.depth > 0], 0), 1e-5)
    count, cameras = first_cameras(model)
    assert (count, cameras[0].size) == (6, PHOTO_SIZE)
    assert cameras[0].parameters == tuple(found.cameras[1].params)


def test_images_without_a_pose_are_absent(world: World, tmp_path: Path) -> None:
    views = true_views(world, "yard")
    path = tmp_path / "out" / "yard" / "sparse"
    write_model(path, views, tracks=False)
    content = (path / "images.bin").read_bytes()
    size = struct.calcsize("<I7dI") + len(views.names[0]) + 1 + 8
    (path / "images.bin").write_bytes(struct.pack("<Q", 5) + content[8 + size :])
    found = scored(world, tmp_path / "out", "vggt-colmap")
    assert "1 of 6 photos has no pose in the prediction" in " ".join(found.result.notes)
    assert found.scored["yard"].records.to_dict("records")[0]["f1_0.2m"] == 1.0


SPOILT: dict[str, Callable[[bytes], bytes]] = {
    "cut": lambda content: content[:-7],
    "long": lambda content: content + b"\0",
    "many": lambda content: struct.pack("<Q", 1 << 60) + content[8:],
    "none": lambda content: struct.pack("<Q", 0),
    "name": lambda content: content.replace(b"yard_3.jpg", b"yard_\xff.jpg"),
    "photo": lambda content: content.replace(b"yard_3.jpg", b"yard_9.jpg"),
    "escape": lambda content: content.replace(b"yard_3.jpg", b"yard\x1b[2Jg"),
    "huge": lambda content: content[:12] + struct.pack("<d", 1e300) + content[20:],
    "norm": lambda content: content[:12] + struct.pack("<d", 7.0) + content[20:],
    "track": lambda content: content[:51] + b"\xff" * 8 + content[59:],
}


def spoil(model: Path, what: str) -> None:
    kind, how = what.split()
    file = model / f"{kind}.bin"
    file.write_bytes(SPOILT[how](file.read_bytes()))


def test_a_model_without_points_scores_zero(world: World, tmp_path: Path) -> None:
    spoil(one(world, tmp_path), "points3D none")
    found = scored(world, tmp_path / "out").scored["yard"].records.to_dict("records")[0]
    assert (found["f1_0.2m"], found["ate_m"] < 1e-6) == (0.0, True)


@pytest.fixture(scope="module")
def sound(world: World, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sound")
    one(world, folder)
    return folder / "out"


@pytest.mark.parametrize("lengths", [(1, 1, 1, 1), (0, 0, 0, 0), (1, 1, 3, 0), (2, 0, 1, 1)])
def test_tracks_may_be_of_any_length(lengths: tuple[int, ...], tmp_path: Path) -> None:
    points = np.arange(12.0).reshape(4, 3)
    rows = [
        struct.pack("<Q3d3BdQ", 1, *point, 0, 0, 0, 0.0, length) + b"\7" * 8 * length
        for point, length in zip(points, lengths, strict=True)
    ]
    (tmp_path / "points3D.bin").write_bytes(struct.pack("<Q", 4) + b"".join(rows))
    for most in (1, 2, 3, 9):
        pieces = [piece.points for piece in _points(tmp_path / "points3D.bin", most)]
        np.testing.assert_array_equal(np.concatenate(pieces), points)
        assert max(map(len, pieces)) <= most
