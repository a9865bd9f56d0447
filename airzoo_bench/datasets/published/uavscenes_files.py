"""Reading UAVScenes: runs, their poses, and the clouds of their places."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.validation import nearest
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.posed_photos import PosedPhotos, check_centred
from airzoo_bench.datasets.published.places import folder_content
from airzoo_bench.datasets.published.reconstructions import (
    chosen_photos,
    files_by_scene,
    photos_by_stem,
    published_scenes,
)
from airzoo_bench.datasets.published.uavscenes_poses import (
    read_samples,
    sample_cameras,
    sample_poses,
)
from airzoo_bench.geometry.crs import LOCAL_CRS

if TYPE_CHECKING:
    from airzoo_bench.datasets.published.options import UavScenesOptions

__all__ = ["files_of_run", "find_runs", "read_run"]

_POSES, _CLOUD = "sampleinfos_interpolated.json", "cloud_merged.ply"
_CLOUDS = "terra_3dmap_pointcloud_mesh"
_LAYOUT = "interval5_CAM_LIDAR/interval5_<run>/ with interval5_CAM/ and " + _POSES


def find_runs(source: Path, interval: int) -> dict[str, Path]:
    """Return the folders of the runs below a source, in the order of the protocol."""
    source, prefix = source.resolve(), f"interval{interval}_"
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


def files_of_run(options: UavScenesOptions, run: str) -> list[Path]:
    """Return the folder of a run and the clouds that could be its own."""
    runs = find_runs(options.source, options.interval)
    given = files_by_scene(options.cloud, "cloud", list(runs))
    clouds = [cloud for place in _places(run) for cloud in _clouds_of(place, options.source)]
    return [runs[run], *([given[run]] if run in given else clouds)]


def read_run(options: UavScenesOptions, run: str, progress: Progress) -> NativeScene:
    """Read a run: its photos, their cameras and poses, and where its cloud is."""
    runs = find_runs(options.source, options.interval)
    folder = runs[run] / f"interval{options.interval}_CAM"
    photos = photos_by_stem(folder, _LAYOUT)
    path = runs[run] / _POSES
    samples = read_samples(path)
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
    sizes = [photo_size(folder / name) for name in shown]
    cameras = sample_cameras(entries, sizes, options.lens, path)
    cloud, where = _cloud_of(run, options, list(runs))
    poses = sample_poses(entries, path)
    check_centred(PosedPhotos(names, cameras, poses, None), path)
    return NativeScene(
        run,
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


def _cloud_of(
    run: str, options: UavScenesOptions, runs: Sequence[str]
) -> tuple[Path, tuple[str, ...]]:
    """Return a run's cloud and, where it is that of another name, a sentence that says so."""
    given = files_by_scene(options.cloud, "cloud", runs)
    if run in given:
        return given[run], ()
    for place in _places(run):
        found = _clouds_of(place, options.source)
        if len(found) > 1:
            raise BenchmarkError(
                f"several clouds could be that of {run}: {first_of(found)}",
                where=options.source,
                fix=f"say which: --cloud {run}=FILE",
            )
        if found:
            own = place in _places(run)[:2]
            return found[0], () if own else (f"its cloud is taken to be that of {place}",)
    where = next(iter(_cloud_folders(options.source)), options.source)
    raise BenchmarkError(
        f"there is no cloud for {run}: {folder_content(where)}",
        where=where,
        expected=f"{_CLOUDS}/{_places(run)[1]}/{_CLOUD}",
        fix=f"unpack {_CLOUDS}.zip there, or name the cloud with --cloud {run}=FILE",
    )


def _clouds_of(place: str, source: Path) -> list[Path]:
    paths = [folder / place / _CLOUD for folder in _cloud_folders(source)]
    return [path for path in paths if path.is_file()]


def _cloud_folders(source: Path) -> list[Path]:
    """Return the folders of clouds near a source, which may be a bundle or a run in one."""
    source = source.resolve()
    tops = [source, *source.parents[:3]] if source.name.startswith("interval") else [source]
    both = [path for top in tops for path in (top / _CLOUDS, top / _CLOUDS / _CLOUDS)]
    return [path for path in both if path.is_dir()]


def _places(run: str) -> list[str]:
    """Return the names that a run's cloud may be under, the most special first."""
    place = re.sub(r"(\d+|_Evening)$", "", run)
    return list(dict.fromkeys((run, place, place.partition("_")[0])))
