"""Reading UrbanScene3D: scenes, their poses, and what takes these to the frame of the scan."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, UsageError, UserError, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.posed_photos import PosedPhotos
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.published.mega_nerf import (
    COORDINATES,
    mega_nerf_photos,
    read_mega_nerf,
)
from airzoo_bench.datasets.published.places import folder_content
from airzoo_bench.datasets.published.reconstructions import (
    chosen_photos,
    files_by_scene,
    published_scenes,
)
from airzoo_bench.datasets.similarity_file import read_matrix, similarity_of
from airzoo_bench.datasets.sources import photo_sizes
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.geometry.poses import Poses

if TYPE_CHECKING:
    from airzoo_bench.datasets.published.options import UrbanScene3DOptions

__all__ = ["files_of_scene", "find_scenes", "read_scene"]

_LAYOUT = (
    "a folder a scene, such as residence-pixsfm, with coordinates.pt, train and val of Mega-NeRF, "
    "or with images/ and a COLMAP model in sparse/0/"
)
_OTHER_NAMES = {"sciart": "artsci", "artisci": "artsci"}
_MODELS = ("sparse/0", "sparse")
_MODEL_FILES = ("cameras.bin", "cameras.txt")


def find_scenes(source: Path) -> dict[str, Path]:
    """Return the folders of scenes by id, in the order of the protocol."""
    inside = sorted(path for path in source.iterdir() if path.is_dir()) if source.is_dir() else []
    found: dict[str, list[Path]] = {}
    for folder in (source.resolve(), *inside):
        scene = _scene_of(folder.name)
        if _kinds(folder) and scene is not None:
            found.setdefault(scene, []).append(folder)
    twice = [first_of(folders) for folders in found.values() if len(folders) > 1]
    if twice or not found:
        raise BenchmarkError(
            f"several folders claim to be one scene: {twice[0]}"
            if twice
            else f"holds no scene: {folder_content(source)}",
            where=source,
            expected=_LAYOUT,
            fix="keep one of them, or name it as --source"
            if twice
            else f"name the folders {', '.join(published_scenes('urbanscene3d'))}",
        )
    return {scene: found[scene][0] for scene in published_scenes("urbanscene3d") if scene in found}


def _scene_of(name: str) -> str | None:
    """Return the scene that a folder's name is of: Sci-Art-pixsfm is ArtSci."""
    letters = re.sub(r"[^a-z]", "", name.casefold().removesuffix("-pixsfm"))
    scene = _OTHER_NAMES.get(letters, letters)
    return scene if scene in published_scenes("urbanscene3d") else None


def _kinds(folder: Path) -> list[str]:
    """Return what kinds of poses a folder holds."""
    kinds = ["mega-nerf"] if (folder / COORDINATES).is_file() else []
    return kinds + ["colmap"] * (_model(folder) is not None)


def _model(folder: Path) -> Path | None:
    """Return the folder of a scene's COLMAP model."""
    for part in _MODELS:
        if any((folder / part / file).is_file() for file in _MODEL_FILES):
            return folder / part
    return None


def files_of_scene(options: UrbanScene3DOptions, scene: str) -> list[Path]:
    """Return a scene's folder, and its scan and transform where they are named."""
    scenes = find_scenes(options.source)
    named = (("scan", options.scan), ("transform", options.transform))
    given = [files_by_scene(texts, option, list(scenes)) for option, texts in named]
    return [scenes[scene], *(files[scene] for files in given if scene in files)]


def read_scene(options: UrbanScene3DOptions, scene: str, progress: Progress) -> NativeScene:
    """Read a scene's poses, and take them to the frame of its scan."""
    scenes = find_scenes(options.source)
    folder = scenes[scene]
    scan = _scan(options, scene, list(scenes))
    transform = files_by_scene(options.transform, "transform", list(scenes)).get(scene)
    if transform is None and not options.same_frame:
        raise UsageError(
            f"it is not known how the poses of {scene} lie to its scan",
            where=folder,
            expected=f"--transform {scene}=FILE, 4 x 4 numbers that take the frame of the poses to "
            "that of the scan; or --same-frame",
            fix="find it by registering the model's points to the scan, such as with CloudCompare, "
            "which prints it",
        )
    if len(_kinds(folder)) > 1:
        raise BenchmarkError(
            "has poses of Mega-NeRF and of COLMAP",
            where=folder,
            fix="move one of them elsewhere",
        )
    images, photos, unposed, notes = _photos(folder, options.every, progress)
    poses = photos.poses
    if transform is not None:
        poses = _moved(poses, transform, photos.names)
    return NativeScene(
        scene,
        images,
        photos.names,
        photos.cameras,
        poses,
        LOCAL_CRS,
        cloud=scan,
        poses_from=folder,
        unposed=unposed,
        notes=notes,
    )


def _photos(
    folder: Path, every: int, progress: Progress
) -> tuple[Path, PosedPhotos, tuple[str, ...], tuple[str, ...]]:
    """Return the folder of the photos, those chosen, those without pose, and notes."""
    model = _model(folder)
    if model is None:
        files = mega_nerf_photos(folder)
        names, notes = chosen_photos(sorted(files, key=_file_name), every)
        return folder, read_mega_nerf(folder, files, names, progress), (), notes
    images = folder / "images"
    if not images.is_dir():
        raise BenchmarkError(
            f"has no folder images: {folder_content(folder)}",
            where=folder,
            expected="the photos that the COLMAP model names, in images/",
        )
    sizes = photo_sizes(images, progress)
    photos = read_poses(model, sizes)
    rows, notes = chosen_photos(range(len(photos.names)), every)
    chosen = replace(
        photos,
        names=tuple(photos.names[row] for row in rows),
        cameras=photos.cameras.take(np.array(rows)),
        poses=photos.poses.take(np.array(rows)),
    )
    return images, chosen, tuple(sorted(set(sizes) - set(photos.names))), notes


def _file_name(photo: str) -> str:
    return photo.rpartition("/")[2]


def _scan(options: UrbanScene3DOptions, scene: str, scenes: list[str]) -> Path:
    given = files_by_scene(options.scan, "scan", scenes)
    if scene not in given:
        raise UsageError(
            f"the scan of {scene} is not named",
            where="--scan",
            expected=f"--scan {scene}=FILE, a PLY, LAS or LAZ cloud",
            fix=f"name it; or name the scenes to prepare with --scene: {', '.join(given)}"
            if given
            else "name it: the names of UrbanScene3D's scans are not known here",
        )
    return given[scene]


def _moved(poses: Poses, path: Path, names: tuple[str, ...]) -> Poses:
    """Take poses to the frame of the scan."""
    matrix = read_matrix(path)
    if matrix is None:
        raise BenchmarkError(
            "holds no 4 x 4 numbers",
            where=path,
            expected="four lines of four numbers; the last is 0 0 0 1",
        )
    moved = similarity_of(matrix, path).apply_poses(poses)
    try:
        return Poses.from_centres(moved.rotation, moved.centres, names)
    except UserError as error:
        raise error.inside("--transform") from error
