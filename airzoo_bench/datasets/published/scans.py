"""UAVScenes and UrbanScene3D: photos with poses, to be reconstructed against a scan.

UAVScenes has 20 flights over four places, each against the DJI Terra cloud of its place:

::

    interval5_CAM_LIDAR/interval5_<run>/interval5_CAM/*.jpg
                                       /sampleinfos_interpolated.json
    terra_3dmap_pointcloud_mesh/<place>/cloud_merged.ply

UrbanScene3D's real scenes have poses from COLMAP or Mega-NeRF, which publishes a file of tensors
for each photo. Its world has the axes down, right and back, less an origin and divided by a scale;
its cameras have NeRF's axes, right, up and back (scripts/colmap_to_mega_nerf.py in
cmusatyalab/mega-nerf).
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, CameraError, UsageError, first_of, readable
from airzoo_bench.core.files import read_text
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.cameras import cameras_of_lenses, lens_of
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
from airzoo_bench.datasets.settings import UavScenesOptions, UrbanScene3DOptions
from airzoo_bench.datasets.surveys.colmap import read_similarity
from airzoo_bench.datasets.tables import values_by_scene
from airzoo_bench.formats.foreign_arrays import read_tensors
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.geometry.poses import Poses

_POSES, _CLOUD = "sampleinfos_interpolated.json", "cloud_merged.ply"
_CLOUDS = "terra_3dmap_pointcloud_mesh"
_RUNS = f"interval5_CAM_LIDAR/interval5_<run>/ with interval5_CAM/ and {_POSES}"
_LIMIT_BYTES = 128 << 20


class _UavScenes(Dataset[UavScenesOptions]):
    """The runs of UAVScenes."""

    name = "uavscenes"
    about = load_about("uavscenes")
    options = UavScenesOptions
    protocols = ("uavscenes-reconstruction",)

    def scenes(self, options: UavScenesOptions) -> Mapping[str, Sequence[Path]]:
        runs = _find_runs(options)
        return {run: [folder, *_clouds(options, run, runs)] for run, folder in runs.items()}

    def read(self, options: UavScenesOptions, scene: str, progress: Progress) -> NativeScene:
        runs = _find_runs(options)
        folder, path = runs[scene] / f"interval{options.interval}_CAM", runs[scene] / _POSES
        photos = files_by_key(folder, stem_of, _RUNS)
        text = read_text(path, BenchmarkError, "file of poses", _LIMIT_BYTES)
        expected = "a list of OriginalImageName, T4x4 and P3x3, as UAVScenes has it"
        with readable(path, "cannot be read", kind=BenchmarkError, expected=expected):
            samples = {
                stem_of(one["OriginalImageName"]): one
                for one in json.loads(text.removeprefix("\ufeff"))
            }
            chosen, notes = chosen_photos([s for s in photos if s in samples], options.every)
            names = tuple(photos[stem] for stem in chosen)
            shown = progress(names, scene, len(names))
            sizes = [photo_size(folder / name) for name in shown]
            cameras, poses = _posed([samples[s] for s in chosen], sizes, names)
        posed = PosedPhotos(names, cameras, poses, LOCAL_CRS)
        check_centred(posed, path)
        clouds = _clouds(options, scene, runs)
        if not clouds:
            fix = f"unpack {_CLOUDS}.zip there, or name the cloud with --cloud {scene}=FILE"
            layout = f"{_CLOUDS}/{scene}/{_CLOUD}"
            raise missing(f"there is no cloud for {scene}", options.source, layout, fix)
        return NativeScene(
            scene,
            folder,
            *posed,
            cloud=clouds[0],
            poses_from=path,
            unposed=tuple(name for stem, name in photos.items() if stem not in samples),
            notes=(*notes, f"its cloud is {clouds[0]}"),
        )


def _find_runs(options: UavScenesOptions) -> dict[str, Path]:
    """Return the folders of the runs below a source, in the order of the protocol."""
    source, prefix = options.source.resolve(), f"interval{options.interval}_"
    pack = f"{prefix}CAM_LIDAR"
    inside = [source, source / pack, source / pack / pack]
    folders = [path for place in inside if place.is_dir() for path in place.glob(f"{prefix}*")]
    found = {
        path.name.removeprefix(prefix): path
        for path in sorted({source, *folders})
        if path.name.startswith(prefix) and (path / _POSES).is_file()
    }
    known = published_scenes("uavscenes-reconstruction")
    strange = [run for run in found if run not in known]
    if strange or not found:
        what = f"holds no run of UAVScenes, or unknown ones: {first_of(strange)}"
        layout = f"{_RUNS}; the runs are {', '.join(known)}"
        fix = f"unpack {pack}.zip there; --interval chooses between interval1 and interval5"
        raise missing(what, source, layout, fix)
    return {run: found[run] for run in known if run in found}


def _clouds(options: UavScenesOptions, run: str, runs: Mapping[str, Path]) -> list[Path]:
    """Return the clouds that a run may have, the most special first."""
    given = values_by_scene(options.cloud, "cloud", list(runs)).get(run)
    if given is not None:
        return [Path(given)]
    source = options.source.resolve()
    tops = [source, *source.parents[:3]] if source.name.startswith("interval") else [source]
    folders = [path for top in tops for path in (top / _CLOUDS, top / _CLOUDS / _CLOUDS)]
    place = re.sub(r"(\d+|_Evening)$", "", run)
    places = dict.fromkeys((run, place, place.partition("_")[0]))
    paths = (folder / one / _CLOUD for one in places for folder in folders)
    return [path for path in paths if path.is_file()]


def _posed(
    samples: Sequence[Mapping[str, Any]], sizes: Sequence[tuple[int, int]], names: Sequence[str]
) -> tuple[Cameras, Poses]:
    """Return the cameras and poses of images."""
    for sample, size, name in zip(samples, sizes, names, strict=True):
        stated = (sample.get("Width") or size[0], sample.get("Height") or size[1])
        if stated != size:
            raise ValueError(f"{name} is {size[0]}x{size[1]} px, not {stated[0]}x{stated[1]}")
    keys = ("K1", "K2", "P1", "P2", "K3")
    bent = np.array([[one.get(key, 0.0) for key in keys] for one in samples], np.float64)
    matrices = np.array([one["T4x4"] for one in samples], np.float64)
    (width, height), calibrations = np.array(sizes).T, [one["P3x3"] for one in samples]
    cameras = Cameras.from_matrices(calibrations, width, height, bent, names=names)
    rotations = np.swapaxes(matrices[:, :3, :3], 1, 2)
    return cameras, Poses.from_centres(rotations, matrices[:, :3, 3], names)


UAVSCENES = _UavScenes()


_COORDINATES = "coordinates.pt"
_SCENES = (
    "a folder a scene, such as residence-pixsfm, with coordinates.pt, and metadata/*.pt with "
    "rgbs/* in train and val, of Mega-NeRF; or with images/ and a COLMAP model in sparse/0/"
)
_OTHER_NAMES = {"sciart": "artsci", "artisci": "artsci"}
# The axes down, right and back become those of the COLMAP model; the matrix is its own inverse.
_TO_COLMAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_TO_OPENCV = np.array([1.0, -1.0, -1.0])


class _UrbanScene3D(Dataset[UrbanScene3DOptions]):
    """The real scenes of _UrbanScene3D."""

    name = "urbanscene3d"
    about = load_about("urbanscene3d")
    options = UrbanScene3DOptions
    protocols = ("urbanscene3d-reconstruction",)

    def scenes(self, options: UrbanScene3DOptions) -> Mapping[str, Sequence[Path]]:
        found = _find_scenes(options.source)
        named = (("scan", options.scan), ("transform", options.transform))
        given = [values_by_scene(texts, option, list(found)) for option, texts in named]
        return {
            scene: [folder, *(Path(files[scene]) for files in given if scene in files)]
            for scene, folder in found.items()
        }

    def read(self, options: UrbanScene3DOptions, scene: str, progress: Progress) -> NativeScene:
        scenes = _find_scenes(options.source)
        folder, known = scenes[scene], list(scenes)
        scan = values_by_scene(options.scan, "scan", known).get(scene)
        transform = values_by_scene(options.transform, "transform", known).get(scene)
        if scan is None or (transform is None and not options.same_frame):
            raise UsageError(
                f"the scan of {scene} is not named, or not how its poses lie to it",
                where=folder,
                expected=f"--scan {scene}=FILE; and --same-frame or --transform {scene}=FILE, 4 x "
                "4 numbers from the frame of the poses to the scan's",
                fix="register the model's points to the scan, such as with CloudCompare",
            )
        images, photos, unposed, notes = _photos(folder, options.every, progress)
        if transform is not None:
            moved = read_similarity(Path(transform)).apply_poses(photos.poses)
            moved = Poses.from_centres(moved.rotation, moved.centres, photos.names)
            photos = photos._replace(poses=moved)
        return NativeScene(
            scene,
            images,
            *photos._replace(crs=LOCAL_CRS),
            cloud=Path(scan),
            poses_from=folder,
            unposed=unposed,
            notes=notes,
        )


def _find_scenes(source: Path) -> dict[str, Path]:
    """Return the folders of scenes by id, in the order of the protocol."""
    known = published_scenes("urbanscene3d-reconstruction")
    inside = sorted(path for path in source.iterdir() if path.is_dir()) if source.is_dir() else []
    found: dict[str, Path] = {}
    for folder in (source.resolve(), *inside):
        # Sci-Art-pixsfm is ArtSci.
        letters = re.sub(r"[^a-z]", "", folder.name.casefold().removesuffix("-pixsfm"))
        scene = _OTHER_NAMES.get(letters, letters)
        if scene in known and ((folder / _COORDINATES).is_file() or _model(folder)):
            found.setdefault(scene, folder)
    if not found:
        raise missing("holds no scene", source, _SCENES, f"name the folders {', '.join(known)}")
    return {scene: found[scene] for scene in known if scene in found}


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
    sizes = photo_sizes(images, progress)
    photos = read_poses(model, sizes)
    rows, notes = chosen_photos(range(len(photos.names)), every)
    return images, photos.take(rows), tuple(sorted(set(sizes) - set(photos.names))), notes


def _mega_nerf_photos(folder: Path) -> dict[str, Path]:
    """Return the file of each photo, by the photo's path relative to the folder."""
    found: dict[str, Path] = {}
    for part in ("train", "val"):
        files = sorted((folder / part / "metadata").glob("*.pt"))
        photos = files_by_key(folder / part / "rgbs", stem_of, _SCENES)
        absent = [file.name for file in files if stem_of(file.stem) not in photos]
        if absent or not files:
            what = f"poses without a photo ({first_of(absent)})" if files else "has no metadata"
            raise missing(what, folder / part, _SCENES, "let Mega-NeRF's copy_images.py finish")
        found |= {f"{part}/rgbs/{photos[stem_of(file.stem)]}": file for file in files}
    return found


def _read_mega_nerf(
    folder: Path, photos: Mapping[str, Path], names: tuple[str, ...], progress: Progress
) -> PosedPhotos:
    """Read the cameras and poses of some photos, in metres and the axes of the COLMAP model."""
    origin, scale = _arrays(folder / _COORDINATES, origin_drb=(3,), pose_scale_factor=())
    lenses, sizes, to_world = [], {}, []
    for name in progress(names, folder.name, len(names)):
        stated = _arrays(photos[name], W=(), H=(), intrinsics=(4,), c2w=(3, 4))
        width, height, lens, pose = stated
        sizes[name] = photo_size(folder / name)
        values = zip(
            ("width", "height", "fx", "fy", "cx", "cy"), (width, height, *lens), strict=True
        )
        lenses.append(lens_of(dict(values), sizes[name], photos[name]))
        to_world.append(pose)
    axes = np.array(to_world)
    centres: Floats = (axes[:, :, 3] * scale + origin) @ _TO_COLMAP.T
    rotations: Floats = np.swapaxes(_TO_COLMAP @ axes[:, :, :3] * _TO_OPENCV, 1, 2)
    try:
        cameras = cameras_of_lenses(lenses, names, sizes)
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


URBANSCENE3D = _UrbanScene3D()
