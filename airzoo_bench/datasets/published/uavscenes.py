"""UAVScenes: 20 flights over four places, each against the DJI Terra cloud of its place.

::

    interval5_CAM_LIDAR/interval5_<run>/interval5_CAM/*.jpg
                                       /sampleinfos_interpolated.json
    terra_3dmap_pointcloud_mesh/<place>/cloud_merged.ply
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.registry import Option
from airzoo_bench.core.validation import validation_message
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
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.geometry.poses import Poses

__all__ = ["UAVSCENES", "UavScenesOptions"]

_POSES, _CLOUD = "sampleinfos_interpolated.json", "cloud_merged.ply"
_CLOUDS = "terra_3dmap_pointcloud_mesh"
_LAYOUT = f"interval5_CAM_LIDAR/interval5_<run>/ with interval5_CAM/ and {_POSES}"
_LIMIT_BYTES = 128 << 20

_Number = Annotated[float, Field(allow_inf_nan=False)]
_Row3 = tuple[_Number, _Number, _Number]
_Row4 = tuple[_Number, _Number, _Number, _Number]


@dataclass(frozen=True)
class UavScenesOptions(SourceOptions):
    """Which photos of a run are reconstructed, and what its files do not settle."""

    interval: Annotated[
        int, Option("interval", "Take the photos of interval5_... or interval1_...", least=1)
    ] = 5
    every: Annotated[
        int, Option("every", "Take every Nth photo of a run, starting with the first.", least=1)
    ] = 10
    cloud: Annotated[Files, Option("cloud", "True cloud of a run, as RUN=FILE; repeat it.")] = None
    lens: Annotated[
        Literal["file", "none"], Option("lens", "Distortion as the poses' file states it, or none.")
    ] = "file"


class UavScenes(Dataset[UavScenesOptions]):
    """The runs of UAVScenes."""

    name = "uavscenes"
    about = about_of("uavscenes")
    options = UavScenesOptions
    protocols = ("uavscenes-reconstruction",)

    def scenes(self, options: UavScenesOptions) -> Mapping[str, Sequence[Path]]:
        """Return the runs below the source, each with its folder and the clouds it may have."""
        runs, found = _find_runs(options), {}
        for run, folder in runs.items():
            given = values_by_scene(options.cloud, "cloud", list(runs)).get(run)
            places = _clouds_near(options.source, run)
            found[run] = [folder, *([Path(given)] if given else [path for _, path in places])]
        return found

    def read(self, options: UavScenesOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a run: its photos, their cameras and poses, and where its cloud is."""
        home = _find_runs(options)[scene]
        folder, path = home / f"interval{options.interval}_CAM", home / _POSES
        photos, samples = files_by_key(folder, stem_of, _LAYOUT), _read_samples(path)
        posed = [stem for stem in photos if stem in samples]
        if not posed:
            raise BenchmarkError(
                f"names {first_of(samples)}, none of the photos",
                where=path,
                expected=f"names such as {next(iter(photos.values()))!r}",
            )
        chosen, notes = chosen_photos(posed, options.every)
        names, entries = tuple(photos[stem] for stem in chosen), [samples[s] for s in chosen]
        shown = progress(names, scene, len(names))
        sizes = [photo_size(folder / name) for name in shown]
        try:
            cameras = _cameras(entries, sizes, options.lens)
            poses = _poses(entries)
        except CameraError as error:
            raise error.inside(path) from error
        check_centred(PosedPhotos(names, cameras, poses), path)
        cloud, where = _cloud_of(scene, options)
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
            f"unknown runs {first_of(strange)}" if strange else "holds no run of UAVScenes",
            source / pack if (source / pack).is_dir() else source,
            f"{_LAYOUT}; the runs are {', '.join(known)}",
            f"unpack {pack}.zip there; --interval chooses between interval1 and interval5",
        )
    return {run: found[run] for run in known if run in found}


def _cloud_of(run: str, options: UavScenesOptions) -> tuple[Path, tuple[str, ...]]:
    """Return a run's cloud and, where it is that of another name, a sentence that says so."""
    given = values_by_scene(options.cloud, "cloud", list(_find_runs(options))).get(run)
    if given is not None:
        return Path(given), ()
    clouds = _clouds_near(options.source, run)
    if not clouds:
        fix = f"unpack {_CLOUDS}.zip there, or name the cloud with --cloud {run}=FILE"
        layout = f"{_CLOUDS}/{_places(run)[1]}/{_CLOUD}"
        raise missing(f"there is no cloud for {run}", options.source, layout, fix)
    place, cloud = clouds[0]
    own = place in _places(run)[:2]
    return cloud, () if own else (f"its cloud is taken to be that of {place}",)


def _clouds_near(source: Path, run: str) -> list[tuple[str, Path]]:
    """Return the clouds that a run may have, with their places, the most special first."""
    source = source.resolve()
    tops = [source, *source.parents[:3]] if source.name.startswith("interval") else [source]
    folders = [path for top in tops for path in (top / _CLOUDS, top / _CLOUDS / _CLOUDS)]
    paths = [(place, folder / place / _CLOUD) for place in _places(run) for folder in folders]
    return [(place, path) for place, path in paths if path.is_file()]


def _places(run: str) -> list[str]:
    """Return the names that a run's cloud may be under, the most special first."""
    place = re.sub(r"(\d+|_Evening)$", "", run)
    return list(dict.fromkeys((run, place, place.partition("_")[0])))


class _Sample(BaseModel):
    """An image's entry; keys beyond these are passed over."""

    model_config = ConfigDict(frozen=True)
    name: str = Field(alias="OriginalImageName", max_length=200)
    to_world: tuple[_Row4, _Row4, _Row4, _Row4] = Field(alias="T4x4")
    matrix: tuple[_Row3, _Row3, _Row3] = Field(alias="P3x3")
    width: _Number | None = Field(default=None, alias="Width")
    height: _Number | None = Field(default=None, alias="Height")
    k1: _Number = Field(default=0.0, alias="K1")
    k2: _Number = Field(default=0.0, alias="K2")
    p1: _Number = Field(default=0.0, alias="P1")
    p2: _Number = Field(default=0.0, alias="P2")
    k3: _Number = Field(default=0.0, alias="K3")


_SAMPLES = TypeAdapter(Annotated[list[_Sample], Field(min_length=1)])


def _read_samples(path: Path) -> dict[str, _Sample]:
    """Read a run's poses, by time stamp with a point."""
    text = read_text(path, BenchmarkError, "file of poses", _LIMIT_BYTES)
    try:
        samples = _SAMPLES.validate_json(text.removeprefix("\ufeff"))
    except ValidationError as error:
        raise BenchmarkError(
            validation_message(error, _Sample),
            where=path,
            expected="a list of OriginalImageName, T4x4 and P3x3, as UAVScenes has it",
            fix="download the file again",
        ) from error
    return {stem_of(sample.name): sample for sample in samples}


def _poses(samples: Sequence[_Sample]) -> Poses:
    """Return the poses of images, world-to-camera."""
    matrices = np.array([sample.to_world for sample in samples])
    if (np.abs(matrices[:, 3] - (0.0, 0.0, 0.0, 1.0)) > 1e-6).any():
        raise CameraError(
            "T4x4 whose last row is not 0 0 0 1",
            expected="camera-to-world matrices, rows first",
            fix="transpose them if columns stand first",
        )
    rotations: Floats = np.swapaxes(matrices[:, :3, :3], 1, 2)
    return Poses.from_centres(rotations, matrices[:, :3, 3], [sample.name for sample in samples])


def _cameras(samples: Sequence[_Sample], sizes: Sequence[tuple[int, int]], lens: str) -> Cameras:
    """Return the cameras of images, whose lens is that of the file or "none"."""
    names = [sample.name for sample in samples]
    other = [
        f"{one.name} is {size[0]}x{size[1]} px, not {one.width:g}x{one.height:g}"
        for one, size in zip(samples, sizes, strict=True)
        if one.width and one.height and size != (one.width, one.height)
    ]
    if other:
        raise CameraError(
            f"photos of another size than stated: {first_of(other, len(names))}",
            fix="use the photos as they were downloaded",
        )
    width, height = np.array(sizes).T
    matrices = np.array([sample.matrix for sample in samples])
    bent = np.array([(one.k1, one.k2, one.p1, one.p2, one.k3) for one in samples])
    return Cameras.from_matrices(matrices, width, height, bent * (lens == "file"), names=names)


UAVSCENES = UavScenes()
