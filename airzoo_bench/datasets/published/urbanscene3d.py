"""UrbanScene3D: the real scenes that were scanned, by poses from COLMAP or Mega-NeRF.

Mega-NeRF publishes a file of tensors for each photo. Its world has the axes down, right and back,
less an origin and divided by a scale; its cameras have NeRF's axes, right, up and back
(scripts/colmap_to_mega_nerf.py in cmusatyalab/mega-nerf).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import (
    BenchmarkError,
    CameraError,
    UsageError,
    first_of,
    readable,
)
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.content import photo_sizes
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.published.places import (
    chosen_photos,
    files_by_key,
    missing,
    published_scenes,
    stem_of,
)
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos, check_centred
from airzoo_bench.datasets.settings import Files, SourceOptions
from airzoo_bench.datasets.surveys.colmap import similarity_of
from airzoo_bench.datasets.tables import read_matrix, values_by_scene
from airzoo_bench.formats.torch_files import read_tensors
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.geometry.poses import Poses

_COORDINATES = "coordinates.pt"
_LAYOUT = (
    "a folder a scene, such as residence-pixsfm, with coordinates.pt, and metadata/*.pt with "
    "rgbs/* in train and val, of Mega-NeRF; or with images/ and a COLMAP model in sparse/0/"
)
_OTHER_NAMES = {"sciart": "artsci", "artisci": "artsci"}
# The axes down, right and back become those of the COLMAP model; the matrix is its own inverse.
_TO_COLMAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_TO_OPENCV = np.array([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class UrbanScene3DOptions(SourceOptions):
    """Scans, and how the frame of the poses leads to theirs."""

    scan: Files = None
    transform: Files = None
    same_frame: bool = False
    every: int = 1


class UrbanScene3D(Dataset[UrbanScene3DOptions]):
    """The real scenes of UrbanScene3D."""

    name = "urbanscene3d"
    about = about_of("urbanscene3d")
    options = UrbanScene3DOptions
    protocols = ("urbanscene3d-reconstruction",)

    def scenes(self, options: UrbanScene3DOptions) -> Mapping[str, Sequence[Path]]:
        """Return the scenes below the source, each with its folder, scan and transform."""
        found = _find_scenes(options.source)
        named = (("scan", options.scan), ("transform", options.transform))
        given = [values_by_scene(texts, option, list(found)) for option, texts in named]
        return {
            scene: [folder, *(Path(files[scene]) for files in given if scene in files)]
            for scene, folder in found.items()
        }

    def read(self, options: UrbanScene3DOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a scene's poses, and take them to the frame of its scan."""
        scenes = _find_scenes(options.source)
        folder, known = scenes[scene], list(scenes)
        scan = values_by_scene(options.scan, "scan", known).get(scene)
        transform = values_by_scene(options.transform, "transform", known).get(scene)
        if scan is None or (transform is None and not options.same_frame):
            raise UsageError(
                f"the scan of {scene} is not named, or not how its poses lie to it",
                where=folder,
                expected=f"--scan {scene}=FILE; and --transform {scene}=FILE, 4 x 4 numbers from "
                "the frame of the poses to the scan's, or --same-frame",
                fix="find the transform by registering the model's points to the scan, such as "
                "with CloudCompare; or name the scenes to prepare with --scene",
            )
        images, photos, unposed, notes = _photos(folder, options.every, progress)
        if transform is not None:
            photos = replace(photos, poses=_moved(photos, Path(transform)))
        return NativeScene(
            scene,
            images,
            photos.names,
            photos.cameras,
            photos.poses,
            LOCAL_CRS,
            cloud=Path(scan),
            poses_from=folder,
            unposed=unposed,
            notes=notes,
        )


def _find_scenes(source: Path) -> dict[str, Path]:
    """Return the folders of scenes by id, in the order of the protocol."""
    known = published_scenes("urbanscene3d-reconstruction")
    inside = sorted(path for path in source.iterdir() if path.is_dir()) if source.is_dir() else []
    found: dict[str, list[Path]] = {}
    for folder in (source.resolve(), *inside):
        # Sci-Art-pixsfm is ArtSci.
        letters = re.sub(r"[^a-z]", "", folder.name.casefold().removesuffix("-pixsfm"))
        scene = _OTHER_NAMES.get(letters, letters)
        if scene in known and ((folder / _COORDINATES).is_file() or _model(folder)):
            found.setdefault(scene, []).append(folder)
    if not found or any(len(folders) > 1 for folders in found.values()):
        what = "several folders claim to be one scene" if found else "holds no scene"
        fix = f"name the folders {', '.join(known)}, each once"
        raise missing(what, source, _LAYOUT, fix)
    return {scene: found[scene][0] for scene in known if scene in found}


def _model(folder: Path) -> Path | None:
    """Return the folder of a scene's COLMAP model."""
    places = (folder / "sparse/0", folder / "sparse")
    files = ("cameras.bin", "cameras.txt")
    return next((p for p in places if any((p / file).is_file() for file in files)), None)


def _photos(
    folder: Path, every: int, progress: Progress
) -> tuple[Path, PosedPhotos, tuple[str, ...], tuple[str, ...]]:
    """Return the folder of the photos, those chosen, those without pose, and notes."""
    model, images = _model(folder), folder / "images"
    if model is None:
        files = _mega_nerf_photos(folder)
        in_order = sorted(files, key=lambda photo: photo.rpartition("/")[2])
        names, notes = chosen_photos(in_order, every)
        return folder, _read_mega_nerf(folder, files, tuple(names), progress), (), notes
    if (folder / _COORDINATES).is_file() or not images.is_dir():
        what = "has no images/, or poses of Mega-NeRF and of COLMAP"
        raise missing(what, folder, _LAYOUT, "move one of both kinds of poses elsewhere")
    sizes = photo_sizes(images, progress)
    photos = read_poses(model, sizes)
    rows, notes = chosen_photos(range(len(photos.names)), every)
    return images, photos.take(rows), tuple(sorted(set(sizes) - set(photos.names))), notes


def _moved(photos: PosedPhotos, path: Path) -> Poses:
    """Take poses to the frame of the scan."""
    matrix = read_matrix(path)
    if matrix is None:
        raise BenchmarkError(
            "holds no 4 x 4 numbers",
            where=path,
            expected="four lines of four numbers; the last is 0 0 0 1",
        )
    moved = similarity_of(matrix, path).apply_poses(photos.poses)
    return Poses.from_centres(moved.rotation, moved.centres, photos.names)


def _mega_nerf_photos(folder: Path) -> dict[str, Path]:
    """Return the file of each photo, by the photo's path relative to the folder."""
    found: dict[str, Path] = {}
    for part in ("train", "val"):
        files = sorted((folder / part / "metadata").glob("*.pt"))
        photos = files_by_key(folder / part / "rgbs", stem_of, _LAYOUT)
        absent = [file.name for file in files if stem_of(file.stem) not in photos]
        if absent or not files:
            what = f"poses without a photo ({first_of(absent)})" if files else "has no metadata"
            raise missing(what, folder / part, _LAYOUT, "let Mega-NeRF's copy_images.py finish")
        found |= {f"{part}/rgbs/{photos[stem_of(file.stem)]}": file for file in files}
    return found


def _read_mega_nerf(
    folder: Path, photos: Mapping[str, Path], names: tuple[str, ...], progress: Progress
) -> PosedPhotos:
    """Read the cameras and poses of some photos, in metres and the axes of the COLMAP model."""
    origin, scale = _arrays(folder / _COORDINATES, origin_drb=(3,), pose_scale_factor=())
    matrices, sizes, to_world = [], [], []
    for name in progress(names, folder.name, len(names)):
        stated = _arrays(photos[name], W=(), H=(), intrinsics=(4,), c2w=(3, 4))
        width, height, (fx, fy, cx, cy), pose = stated
        size = photo_size(folder / name)
        if (int(width), int(height)) != size:
            raise CameraError(
                f"its photo is {size[0]}x{size[1]} px, not {width:g}x{height:g}",
                where=photos[name],
                fix="use the photos that copy_images.py makes",
            )
        sizes.append(size)
        to_world.append(pose)
        matrices.append(((fx, 0.0, cx), (0.0, fy, cy), (0.0, 0.0, 1.0)))
    axes = np.array(to_world)
    centres: Floats = (axes[:, :, 3] * scale + origin) @ _TO_COLMAP.T
    rotations: Floats = np.swapaxes(_TO_COLMAP @ axes[:, :, :3] * _TO_OPENCV, 1, 2)
    try:
        width, height = np.array(sizes).T
        cameras = Cameras.from_matrices(matrices, width, height, names=names)
        posed = PosedPhotos(names, cameras, Poses.from_centres(rotations, centres, names))
    except CameraError as error:
        raise error.inside(folder) from error
    check_centred(posed, folder)
    return posed


def _arrays(path: Path, **shapes: tuple[int, ...]) -> list[NDArray[np.float64]]:
    """Return tensors of a file as numbers of these shapes."""
    expected = f"tensors {', '.join(shapes)}, as Mega-NeRF's README names them"
    with readable(path, "cannot be read", kind=BenchmarkError, expected=expected):
        stated = read_tensors(path)
        return [
            np.asarray(stated[key]).astype(np.float64).reshape(shape)
            for key, shape in shapes.items()
        ]


URBANSCENE3D = UrbanScene3D()
