"""UAVScenes: 20 flights over four places, each against the DJI Terra cloud of its place.

::

    interval5_CAM_LIDAR/interval5_<run>/interval5_CAM/*.jpg
                                       /sampleinfos_interpolated.json
    terra_3dmap_pointcloud_mesh/<place>/cloud_merged.ply
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, first_of, readable
from airzoo_bench.core.files import read_text
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.published.places import (
    chosen_photos,
    files_by_key,
    missing,
    published_scenes,
    stem_of,
)
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos, check_centred
from airzoo_bench.datasets.settings import Files, SourceOptions
from airzoo_bench.datasets.tables import values_by_scene
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.geometry.poses import Poses

_POSES, _CLOUD = "sampleinfos_interpolated.json", "cloud_merged.ply"
_CLOUDS = "terra_3dmap_pointcloud_mesh"
_LAYOUT = f"interval5_CAM_LIDAR/interval5_<run>/ with interval5_CAM/ and {_POSES}"
_LIMIT_BYTES = 128 << 20


@dataclass(frozen=True)
class UavScenesOptions(SourceOptions):
    """Which photos of a run are reconstructed, and what its files do not settle."""

    interval: int = 5
    every: int = 10
    cloud: Files = None
    lens: Literal["file", "none"] = "file"


class UavScenes(Dataset[UavScenesOptions]):
    """The runs of UAVScenes."""

    name = "uavscenes"
    about = about_of("uavscenes")
    options = UavScenesOptions
    protocols = ("uavscenes-reconstruction",)

    def scenes(self, options: UavScenesOptions) -> Mapping[str, Sequence[Path]]:
        """Return the runs below the source, each with its folder and the clouds it may have."""
        runs = _find_runs(options)
        return {
            run: [folder, *(path for _, path in _clouds(options, run, runs))]
            for run, folder in runs.items()
        }

    def read(self, options: UavScenesOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a run: its photos, their cameras and poses, and where its cloud is."""
        runs = _find_runs(options)
        folder, path = runs[scene] / f"interval{options.interval}_CAM", runs[scene] / _POSES
        photos = files_by_key(folder, stem_of, _LAYOUT)
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
            cameras, poses = _posed([samples[s] for s in chosen], sizes, names, options.lens)
        check_centred(PosedPhotos(names, cameras, poses), path)
        cloud, where = _cloud_of(scene, options, runs)
        return NativeScene(
            scene,
            folder,
            names,
            cameras,
            poses,
            LOCAL_CRS,
            cloud=cloud,
            poses_from=path,
            unposed=tuple(name for stem, name in photos.items() if stem not in samples),
            notes=(*notes, *where),
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
        raise missing(
            f"holds no run of UAVScenes, or unknown ones: {first_of(strange)}",
            source / pack if (source / pack).is_dir() else source,
            f"{_LAYOUT}; the runs are {', '.join(known)}",
            f"unpack {pack}.zip there; --interval chooses between interval1 and interval5",
        )
    return {run: found[run] for run in known if run in found}


def _clouds(
    options: UavScenesOptions, run: str, runs: Mapping[str, Path]
) -> list[tuple[str, Path]]:
    """Return the clouds that a run may have, with their places, the most special first."""
    given = values_by_scene(options.cloud, "cloud", list(runs)).get(run)
    if given is not None:
        return [(run, Path(given))]
    source = options.source.resolve()
    tops = [source, *source.parents[:3]] if source.name.startswith("interval") else [source]
    folders = [path for top in tops for path in (top / _CLOUDS, top / _CLOUDS / _CLOUDS)]
    place = re.sub(r"(\d+|_Evening)$", "", run)
    places = dict.fromkeys((run, place, place.partition("_")[0]))
    paths = [(one, folder / one / _CLOUD) for one in places for folder in folders]
    return [(one, path) for one, path in paths if path.is_file()]


def _cloud_of(
    run: str, options: UavScenesOptions, runs: Mapping[str, Path]
) -> tuple[Path, tuple[str, ...]]:
    """Return a run's cloud and, where it is that of another name, a sentence that says so."""
    clouds = _clouds(options, run, runs)
    if not clouds:
        fix = f"unpack {_CLOUDS}.zip there, or name the cloud with --cloud {run}=FILE"
        layout = f"{_CLOUDS}/{run}/{_CLOUD}"
        raise missing(f"there is no cloud for {run}", options.source, layout, fix)
    place, cloud = clouds[0]
    own = place in (run, re.sub(r"(\d+|_Evening)$", "", run))
    return cloud, () if own else (f"its cloud is taken to be that of {place}",)


def _posed(
    samples: Sequence[Mapping[str, Any]],
    sizes: Sequence[tuple[int, int]],
    names: Sequence[str],
    lens: str,
) -> tuple[Cameras, Poses]:
    """Return the cameras and poses of images, whose lens is that of the file or "none"."""
    for sample, size, name in zip(samples, sizes, names, strict=True):
        stated = (sample.get("Width") or size[0], sample.get("Height") or size[1])
        if stated != size:
            raise ValueError(f"{name} is {size[0]}x{size[1]} px, not {stated[0]}x{stated[1]}")
    keys = ("K1", "K2", "P1", "P2", "K3")
    bent = np.array([[one.get(key, 0.0) for key in keys] for one in samples], np.float64)
    matrices = np.array([one["T4x4"] for one in samples], np.float64)
    if (np.abs(matrices[:, 3] - (0.0, 0.0, 0.0, 1.0)) > 1e-6).any():
        raise ValueError("T4x4 whose last row is not 0 0 0 1")
    (width, height), calibrations = np.array(sizes).T, [one["P3x3"] for one in samples]
    cameras = Cameras.from_matrices(
        calibrations, width, height, bent * (lens == "file"), names=names
    )
    rotations = np.swapaxes(matrices[:, :3, :3], 1, 2)
    return cameras, Poses.from_centres(rotations, matrices[:, :3, 3], names)


UAVSCENES = UavScenes()
