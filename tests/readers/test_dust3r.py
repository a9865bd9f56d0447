"""Scenes of DUSt3R and MASt3R as saved by their users, and the demo's GLB."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.reader import find_reader
from tests.formats.mesh_support import cube_document, write_glb
from tests.readers.recon_support import check_perfect, row, scored, world
from tests.readers.samples import dust3r
from tests.reconstruction.world import World

__all__ = ["world"]


def test_exact_points_are_perfect_named_or_in_order(world: World, tmp_path: Path) -> None:
    named = scored(world, dust3r.write(tmp_path / "named", world))
    check_perfect(named)
    nameless = scored(world, dust3r.write(tmp_path / "nameless", world, names=None))
    assert row(named) == row(nameless)
    assert named.given.reader is not None
    assert "views named by the field names" in named.given.reader.conventions


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pts3d": np.ones((2, 5, 3), "f4")}, "shape"),
        ({"pts3d": np.ones((2, 4, 5, 3), "f4")}, "image_names"),
        ({"poses": np.zeros((2, 4, 4), "f4")}, "extrinsics"),
        ({"names": np.array(["a.jpg", "b.jpg"])}, "none of its names"),
        ({"depths": np.ones(3)}, "depths"),
    ],
)
def test_what_contradicts_is_refused(
    changes: dict[str, np.ndarray], message: str, world: World, tmp_path: Path
) -> None:
    with pytest.raises(PredictionError, match=message):
        scored(world, dust3r.write(tmp_path / "out", world, **changes))


def test_the_demos_glb_is_refused_with_why(world: World, tmp_path: Path) -> None:
    document, body = cube_document()
    document["asset"]["generator"] = "https://github.com/mikedh/trimesh"
    document["meshes"] *= 3
    path = write_glb(tmp_path / "scene.glb", document, body)
    assert find_reader(path) == "dust3r"
    with pytest.raises(PredictionError, match="cameras as meshes") as caught:
        scored(world, path)
    assert "get_pts3d" in str(caught.value.fix)
    document["asset"]["generator"] = "Blender"
    assert find_reader(write_glb(tmp_path / "scene.glb", document, body)) is None
