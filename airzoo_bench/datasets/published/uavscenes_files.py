"""Reading UAVScenes: runs, their poses, and the clouds of their places."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.validation import nearest, validation_message
from airzoo_bench.datasets.native import NativeScene
from airzoo_bench.datasets.poses import PosedPhotos, check_centred
from airzoo_bench.datasets.published.places import folder_content
from airzoo_bench.datasets.published.reconstructions import (
    chosen_photos,
    files_by_scene,
    photos_by_stem,
    published_scenes,
    stem_of,
)
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.geometry.poses import Poses

if TYPE_CHECKING:
    from airzoo_bench.datasets.published.uavscenes import UavScenesOptions

__all__ = ["find_runs", "read_run"]

_POSES, _CLOUD = "sampleinfos_interpolated.json", "cloud_merged.ply"
_CLOUDS = "terra_3dmap_pointcloud_mesh"
_LIMIT_BYTES = 128 << 20
_MOST_POSES = 200_000
_LAYOUT = "interval5_CAM_LIDAR/interval5_<run>/ with interval5_CAM/ and " + _POSES

Number = Annotated[float, Field(allow_inf_nan=False)]
Row4 = tuple[Number, Number, Number, Number]
Row3 = tuple[Number, Number, Number]


class _Sample(BaseModel):
    """An image's entry; keys beyond these are passed over."""

    model_config = ConfigDict(frozen=True)

    name: str = Field(alias="OriginalImageName", max_length=200)
    to_world: tuple[Row4, Row4, Row4, Row4] = Field(alias="T4x4")
    matrix: tuple[Row3, Row3, Row3] = Field(alias="P3x3")
    width: Number | None = Field(default=None, alias="Width")
    height: Number | None = Field(default=None, alias="Height")
    k1: Number = Field(default=0.0, alias="K1")
    k2: Number = Field(default=0.0, alias="K2")
    p1: Number = Field(default=0.0, alias="P1")
    p2: Number = Field(default=0.0, alias="P2")
    k3: Number = Field(default=0.0, alias="K3")

    @property
    def distortion(self) -> tuple[float, ...]:
        return self.k1, self.k2, self.p1, self.p2, self.k3


_Samples = TypeAdapter(Annotated[list[_Sample], Field(min_length=1, max_length=_MOST_POSES)])


def find_runs(source: Path, interval: int) -> dict[str, Path]:
    """Return the folders of the runs below a source, in the order of the protocol.

    Parameters
    ----------
    source : Path
        What was downloaded, a bundle in it, or the folder of one run.
    interval : int
        Of the photos: 1 or 5.

    Raises
    ------
    BenchmarkError
        There is none, one that the protocol does not know, or two of one name.
    """
    prefix = f"interval{interval}_"
    pack = f"{prefix}CAM_LIDAR"
    inside = [source, source / pack, source / pack / pack]
    folders = [path for place in inside if place.is_dir() for path in place.glob(f"{prefix}*")]
    runs = [path for path in sorted({source, *folders}) if _is_run(path, prefix)]
    found: dict[str, Path] = {}
    for folder in runs:
        other = found.setdefault(folder.name.removeprefix(prefix), folder)
        if other != folder:
            raise BenchmarkError(
                f"two folders claim to be the run {folder.name}: {other} and {folder}",
                where=source,
                fix="keep one of them, or name it as --source",
            )
    return _known(source, pack, found)


def _is_run(folder: Path, prefix: str) -> bool:
    named = folder.name.startswith(prefix) and folder.is_dir()
    return named and any((folder / part).exists() for part in (f"{prefix}CAM", _POSES))


def _known(source: Path, pack: str, found: dict[str, Path]) -> dict[str, Path]:
    known = published_scenes("uavscenes")
    strange = [run for run in found if run not in known]
    if strange:
        raise BenchmarkError(
            f"unknown runs: {first_of(strange, len(found))}{nearest(strange[0], known)}",
            where=source,
            expected=f"runs such as {known[0]}: {', '.join(known)}",
            fix="rename the folders, if these are the published runs, and please report the names",
        )
    if not found:
        place = source / pack if (source / pack).is_dir() else source
        raise BenchmarkError(
            f"holds no run of UAVScenes: {folder_content(place)}",
            where=place,
            expected=_LAYOUT,
            fix=f"unpack {pack}.zip there; --interval chooses between interval1 and interval5",
        )
    return {run: found[run] for run in known if run in found}


def read_run(options: UavScenesOptions, run: str, progress: Progress) -> NativeScene:
    """Read a run: its photos, their cameras and poses, and where its cloud is.

    Parameters
    ----------
    options : UavScenesOptions
    run : str
        One of `find_runs`.
    progress : Progress

    Raises
    ------
    UserError
        A file is missing, damaged or ambiguous, or a pose is none.
    """
    runs = find_runs(options.source, options.interval)
    folder = runs[run] / f"interval{options.interval}_CAM"
    photos = photos_by_stem(folder, _LAYOUT)
    path = runs[run] / _POSES
    samples = _by_stem(_read_samples(path), path)
    posed = [stem for stem in photos if stem in samples]
    if not posed:
        raise BenchmarkError(
            f"names none of {len(photos):,} photos, but {next(iter(samples.values())).name!r}",
            where=path,
            expected=f"names such as {next(iter(photos.values()))!r}",
            fix="put the photos and the poses of one run together",
        )
    chosen, notes = chosen_photos(posed, options.every)
    names = tuple(photos[stem] for stem in chosen)
    entries = [samples[stem] for stem in chosen]
    shown = progress(names, run, len(names))
    cameras = _cameras(entries, [photo_size(folder / name) for name in shown], options.lens, path)
    cloud, where = _cloud_of(run, options, list(runs))
    poses = _poses(entries, path)
    check_centred(PosedPhotos(names, cameras, poses, None), path)
    return NativeScene(
        run,
        folder,
        names,
        cameras,
        poses,
        LOCAL_CRS,
        cloud=cloud,
        unposed=tuple(name for stem, name in photos.items() if stem not in samples),
        notes=(*notes, *where),
    )


def _read_samples(path: Path) -> list[_Sample]:
    text = read_text(path, BenchmarkError, "file of poses", _LIMIT_BYTES)
    try:
        return _Samples.validate_json(text.removeprefix("\ufeff"))
    except ValidationError as error:
        raise BenchmarkError(
            validation_message(error, _Sample),
            where=path,
            expected="a list of OriginalImageName, T4x4 and P3x3, as UAVScenes has it",
            fix="download the file again",
        ) from error


def _by_stem(samples: list[_Sample], path: Path) -> dict[str, _Sample]:
    """Return the samples by time stamp; a stamp may be there twice only with one pose."""
    found: dict[str, _Sample] = {}
    for sample in samples:
        other = found.setdefault(stem_of(sample.name), sample)
        same = (other.to_world, other.matrix) == (sample.to_world, sample.matrix)
        if not same:
            raise BenchmarkError(
                f"has two poses of {sample.name!r}", where=path, fix="download the file again"
            )
    return found


def _poses(samples: Sequence[_Sample], path: Path) -> Poses:
    matrices = np.array([sample.to_world for sample in samples])
    names = [sample.name for sample in samples]
    last = (0.0, 0.0, 0.0, 1.0)
    odd = np.asarray((np.abs(matrices[:, 3] - last) > 1e-6).any(axis=1))
    if odd.any():
        turned = (np.abs(matrices[odd][:, :, 3] - last) < 1e-6).all()
        raise CameraError(
            f"T4x4 whose last row is not 0 0 0 1: "
            f"{first_of([name for name, bad in zip(names, odd, strict=True) if bad], len(names))}",
            where=path,
            expected="camera-to-world matrices, rows first",
            fix="transpose them: columns stand first" if turned else "download the file again",
        )
    rotations: Floats = np.swapaxes(matrices[:, :3, :3], 1, 2)
    try:
        return Poses.from_centres(rotations, matrices[:, :3, 3], names)
    except CameraError as error:
        raise error.inside(path) from error


def _cameras(
    samples: Sequence[_Sample], sizes: Sequence[tuple[int, int]], lens: str, path: Path
) -> Cameras:
    names = [sample.name for sample in samples]
    stated = [(sample.width, sample.height) for sample in samples]
    other = [
        f"{name} is {size[0]}x{size[1]} px, not {given[0]:g}x{given[1]:g}"
        for name, size, given in zip(names, sizes, stated, strict=True)
        if given[0] and given[1] and size != given
    ]
    if other:
        raise CameraError(
            f"photos of another size than stated: {first_of(other, len(names))}",
            where=path,
            fix="use the photos as they were downloaded",
        )
    width, height = np.array(sizes).T
    matrices = np.array([sample.matrix for sample in samples])
    bent = np.array([sample.distortion for sample in samples]) * (lens == "file")
    try:
        return Cameras.from_matrices(matrices, width, height, bent, names=names)
    except CameraError as error:
        raise error.inside(path) from error


def _cloud_of(
    run: str, options: UavScenesOptions, runs: Sequence[str]
) -> tuple[Path, tuple[str, ...]]:
    """Return a run's cloud and, where it is that of another name, a sentence that says so."""
    given = files_by_scene(options.cloud, "cloud", runs)
    if run in given:
        return given[run], ()
    roots = _cloud_folders(options.source)
    for place in _places(run):
        found = [root / place / _CLOUD for root in roots if (root / place / _CLOUD).is_file()]
        if len(found) > 1:
            raise BenchmarkError(
                f"several clouds could be that of {run}: {first_of(found)}",
                where=options.source,
                fix=f"say which: --cloud {run}=FILE",
            )
        if found:
            own = place in _places(run)[:2]
            return found[0], () if own else (f"its cloud is taken to be that of {place}",)
    where = roots[0] if roots else options.source
    raise BenchmarkError(
        f"there is no cloud for {run}: {folder_content(where)}",
        where=where,
        expected=f"{_CLOUDS}/{_places(run)[1]}/{_CLOUD}",
        fix=f"unpack {_CLOUDS}.zip there, or name the cloud with --cloud {run}=FILE",
    )


def _cloud_folders(source: Path) -> list[Path]:
    """Return the folders of clouds near a source, which may be a bundle or a run in one."""
    above = source.resolve().parents
    tops = [source, *above[:3]] if source.name.startswith("interval") else [source]
    both = [path for top in tops for path in (top / _CLOUDS, top / _CLOUDS / _CLOUDS)]
    return [path for path in both if path.is_dir()]


def _places(run: str) -> list[str]:
    """Return the names that a run's cloud may be under, the most special first.

    Of HKairport_GNSS01 these are itself, HKairport_GNSS and HKairport.
    """
    place = re.sub(r"(\d+|_Evening)$", "", run)
    return list(dict.fromkeys((run, place, place.partition("_")[0])))
