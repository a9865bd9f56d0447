"""DUSt3R and MASt3R: point maps and cameras of a scene that its user saved, and what they show."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import npz_fields
from airzoo_bench.evaluation.reader import Reading, ReadPredictions
from airzoo_bench.readers.scene_folders import ScenePlaces, SceneReader
from airzoo_bench.readers.view_files import (
    GivenArrays,
    as_maps,
    in_photo_order,
    inverted,
    view_names,
)

if TYPE_CHECKING:
    from airzoo_bench.formats.npz import NpzFile
    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = ["DUST3R", "Dust3r"]

_NEEDED = {"pts3d", "poses"}
_ALLOWED = ("pts3d", "poses", "focals", "conf", "names")
_SHOWN = "scene.glb"
_HEAD_BYTES = 1 << 20
_LINES = """save the scene itself, after the alignment (docs/recipes/reconstruction.md):
  np.savez("SCENE.npz", pts3d=np.stack([p.detach().cpu() for p in scene.get_pts3d()]),
           poses=scene.get_im_poses().detach().cpu(), focals=scene.get_focals().detach().cpu(),
           conf=np.stack([c.detach().cpu() for c in scene.im_conf]), names=photos)"""


class Dust3r(SceneReader):
    """Reads point maps with the poses of their views; the GLB of the demo is refused."""

    title = "point maps of DUSt3R or MASt3R"
    layout = "npz with pts3d and poses, as the recipe's lines save them; scene.glb of the demo"
    methods = ("DUSt3R", "MASt3R")

    def sure_of(self, place: Path) -> float:
        """Look at the names of the fields."""
        path = _file(place)
        return 0.9 if npz_fields(path) >= _NEEDED or _is_shown(path) else 0.0

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `SceneReader.read`; what a demo shows is refused at once."""
        if _is_shown(path):
            raise _refused(path)
        return super().read(path, reading)

    def conventions(self, scenes: ScenePlaces) -> tuple[str, ...]:
        """See `SceneReader.conventions`."""
        place = next(iter(scenes.places.values()))
        named = scenes.reading.names is None and "names" in npz_fields(_file(place))
        return (
            "pts3d are points of the world, a pixel of the network's image each",
            "poses camera-to-world, axes of OpenCV",
            "views named by the field names" if named else in_photo_order(scenes),
        )

    def read_scene(self, scenes: ScenePlaces, place: Path, memory: int) -> ScenePrediction:
        """See `SceneReader.read_scene`."""
        import numpy as np

        from airzoo_bench.formats.arrays import check_fields, numbers
        from airzoo_bench.formats.npz import NpzFile
        from airzoo_bench.reconstruction.predictions import maps_of

        path = _file(place)
        if _is_shown(path):
            raise _refused(path)
        file = NpzFile(path, memory)
        check_fields(file, tuple(sorted(_NEEDED)), _ALLOWED, ", ".join(_ALLOWED))
        names = _names(scenes, place, file)
        given: dict[str, Callable[[], Any]] = {
            "world_points": lambda: as_maps(file, "pts3d", 4),
            "extrinsics": lambda: inverted(numbers(file, "poses", (None, 4, 4))),
        }
        if "conf" in file.names():
            given["conf"] = lambda: as_maps(file, "conf", 3)
        if names is not None:
            given["image_names"] = lambda: np.array(names, dtype=str)
        return maps_of(GivenArrays(file.path, file.budget, given))


def _file(place: Path) -> Path:
    """Return the file of a scene: itself, or the only one in its folder."""
    if not place.is_dir():
        return place
    inside = [one for one in place.glob("*.npz") if npz_fields(one) >= _NEEDED]
    return inside[0] if len(inside) == 1 else place / _SHOWN


def _is_shown(path: Path) -> bool:
    """Say whether a file is the GLB of a demo: of trimesh, with a mesh for each camera."""
    if path.name != _SHOWN or not path.is_file():
        return False
    try:
        with path.open("rb") as stream:
            head = stream.read(20)
            size = int.from_bytes(head[12:16], "little")
            text = stream.read(size) if head[:4] == b"glTF" and size < _HEAD_BYTES else b"{}"
        document = json.loads(text)
    except (OSError, ValueError, RecursionError):
        return False
    made = document.get("asset") if isinstance(document, dict) else None
    meshes = document.get("meshes") if isinstance(document, dict) else None
    by_trimesh = isinstance(made, dict) and "trimesh" in str(made.get("generator"))
    return by_trimesh and isinstance(meshes, list) and len(meshes) > 2


def _refused(path: Path) -> PredictionError:
    return PredictionError(
        "is what a demo shows: turned to the first view, with cameras as meshes among the points",
        where=path,
        expected="points in the frame of the cameras that go with them",
        fix=_LINES,
    )


def _names(scenes: ScenePlaces, place: Path, file: NpzFile) -> list[str] | None:
    from airzoo_bench.formats.arrays import texts

    listed = view_names(scenes, place)
    if listed is None and "names" in file.names():
        return scenes.photos(place, texts(file, "names", 1).tolist())
    return None if listed is None else list(listed.names)


DUST3R = Dust3r()
