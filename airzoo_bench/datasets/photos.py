"""``prepare photos``: own photos, poses and maps become a benchmark folder."""

from __future__ import annotations

import shutil
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tomli_w

from airzoo_bench.benchmark import BenchmarkFile, SceneFile, write_benchmark_file
from airzoo_bench.datasets.images import SUFFIXES, photo_size
from airzoo_bench.datasets.poses import PosedPhotos, read_poses
from airzoo_bench.datasets.tiles import write_tiles
from airzoo_bench.errors import (
    BenchmarkError,
    CameraError,
    RasterError,
    UsageError,
    UserError,
    first_of,
)
from airzoo_bench.files import atomic_folder, check_new_folder
from airzoo_bench.geometry.frames import horizontal_crs
from airzoo_bench.geometry.medians import median_height
from airzoo_bench.geometry.rasters import check_same_crs, describe_crs, open_info
from airzoo_bench.progress import Progress, silent
from airzoo_bench.protocol import Protocol, ProtocolScene
from airzoo_bench.retrieval.prepare import PreparedScene, SceneInputs, build_truth
from airzoo_bench.retrieval.truth import write_truth

if TYPE_CHECKING:
    from pyproj import CRS

__all__ = ["PhotoSources", "Prepared", "prepare_photos"]

_LONGEST_PATH = 180  # so that ids are no longer than prediction files may have them
_MOST_DSM_BANDS = 2  # heights, and perhaps a mask


@dataclass(frozen=True)
class PhotoSources:
    """Where the parts of a scene lie.

    Attributes
    ----------
    images : Path
        Folder of the photos, searched with its subfolders.
    poses : Path
        JSON file or COLMAP model.
    dom, dsm : Path
        Map and surface model, as GeoTIFF; the surface model is in the CRS of the poses.
    crs : str or None
        CRS of the poses, where their file does not name it.
    """

    images: Path
    poses: Path
    dom: Path
    dsm: Path
    crs: str | None = None


@dataclass(frozen=True)
class Prepared:
    """What `prepare_photos` made.

    Attributes
    ----------
    folder : Path
        The benchmark folder.
    protocol : str
        The name of the protocol in it.
    scene : PreparedScene
    without_pose : tuple of str
        Photos that the pose file lacks.
    """

    folder: Path
    protocol: str
    scene: PreparedScene
    without_pose: tuple[str, ...]


def prepare_photos(
    sources: PhotoSources,
    protocol: Protocol,
    folder: Path,
    *,
    tiles_on_disk: bool = False,
    copy: bool = False,
    replace: bool = False,
    progress: Progress = silent,
) -> Prepared:
    """Make a benchmark folder with one scene.

    Parameters
    ----------
    sources : PhotoSources
    protocol : Protocol
        With one scene; its benchmark's name becomes the folder's content.
    folder : Path
        Appears when it is complete.
    tiles_on_disk : bool
        Write each tile as PNG; otherwise tiles are windows of the map.
    copy : bool
        Copy photos and rasters into the folder; otherwise they are left where they are.
    replace : bool
        Whether a folder that stands there is replaced.
    progress : Progress

    Raises
    ------
    UserError
        A source is missing or wrong, or no photo can be answered.
    """
    scene = protocol.scenes[0]
    _check_target(sources, folder, replace=replace)
    sizes = _photo_sizes(sources.images, progress)
    photos = read_poses(sources.poses, sizes)
    _check_stems(photos.names, sources.images)
    inputs = _inputs(sources, photos, scene)
    prepared = build_truth(inputs, protocol.gallery, protocol.ground_truth)
    if prepared.truth.queries.empty:
        raise _nothing_to_ask(prepared, sources)
    with atomic_folder(folder, replace=replace) as staged:
        write_truth(staged / "scenes" / scene.id, prepared.truth, prepared.overlaps)
        if tiles_on_disk:
            write_tiles(
                staged / "scenes" / scene.id / "tiles", prepared.truth.tiles, sources.dom, progress
            )
        places = _copied(staged, scene.id, sources, photos.names) if copy else _left(sources)
        entry = _scene_entry(scene, inputs, prepared, places)
        _write_files(staged, protocol, entry)
    without = tuple(sorted(set(sizes) - set(photos.names)))
    return Prepared(folder, protocol.name, prepared, without)


def _check_target(sources: PhotoSources, folder: Path, *, replace: bool) -> None:
    check_new_folder(folder, replace=replace)
    target = folder.resolve()
    for source in (sources.images, sources.poses, sources.dom, sources.dsm):
        if target in (source.resolve(), *source.resolve().parents):
            raise UsageError(
                f"the folder to make holds {source}, which it is made from",
                where=folder,
                mend="name another --out",
            )


def _photo_sizes(folder: Path, progress: Progress) -> dict[str, tuple[int, int]]:
    if not folder.is_dir():
        raise UsageError("no such folder of photos", where=folder)
    paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())
    if not paths:
        raise BenchmarkError(
            "holds no photo", where=folder, expected="files ending in " + ", ".join(SUFFIXES)
        )
    shown = progress(paths, "photos", len(paths))
    return {path.relative_to(folder).as_posix(): photo_size(path) for path in shown}


def _check_stems(names: tuple[str, ...], folder: Path) -> None:
    odd = [repr(name) for name in names if not name.isprintable() or len(name) > _LONGEST_PATH]
    if odd:
        raise BenchmarkError(
            f"names that cannot become ids: {first_of(odd, len(names))}",
            where=folder,
            expected=f"printable characters, at most {_LONGEST_PATH}",
            mend="rename these photos",
        )
    stems = [Path(name).with_suffix("").as_posix() for name in names]
    twice = sorted(stem for stem, count in Counter(stems).items() if count > 1)
    if twice:
        raise BenchmarkError(
            f"photos that differ in their ending only: {first_of(twice, len(names))}",
            where=folder,
            mend="keep one of each; ids are names without the ending",
        )


def _inputs(sources: PhotoSources, photos: PosedPhotos, scene: ProtocolScene) -> SceneInputs:
    dom, dsm = open_info(sources.dom), open_info(sources.dsm)
    named = sources.crs or photos.crs
    if named is None:
        raise UsageError(
            "the CRS of the poses is not known",
            where=sources.poses,
            expected="a projected CRS in metres",
            mend="add the key 'crs' to the file, or give --crs EPSG:...",
        )
    crs = _metric_crs(named, sources)
    check_same_crs(crs, dsm.crs, f"the poses ({sources.poses}) and the DSM ({sources.dsm})")
    if dsm.bands > _MOST_DSM_BANDS:
        raise RasterError(
            f"has {dsm.bands} bands",
            where=sources.dsm,
            expected="one band of heights",
            mend="look whether --dom and --dsm are the wrong way round",
        )
    return SceneInputs(
        scene.id,
        photos.names,
        photos.cameras,
        photos.poses,
        crs.to_string(),
        dom,
        sources.dsm,
        median_height(sources.dsm),
    )


def _metric_crs(named: str, sources: PhotoSources) -> CRS:
    place = f"--crs {sources.crs}" if sources.crs else f"{sources.poses}, key 'crs'"
    try:
        crs = horizontal_crs(named)
    except UserError as error:
        raise error.inside(place) from error
    if not crs.is_projected or any(axis.unit_conversion_factor != 1 for axis in crs.axis_info):
        raise CameraError(
            f"poses are in {describe_crs(crs)}, which is not in metres",
            where=place,
            expected="a projected CRS in metres, such as UTM",
            mend="transform the camera centres, rotations and the DSM to one",
        )
    return crs


def _nothing_to_ask(prepared: PreparedScene, sources: PhotoSources) -> UserError:
    excluded = prepared.truth.excluded
    reasons = excluded["reason"].value_counts()
    listed = "; ".join(f"{count} photos: {reason}" for reason, count in reasons.items())
    return BenchmarkError(
        f"no photo has a tile that answers it ({listed})",
        where=sources.poses,
        expected="photos over the map, with poses in the CRS of the DSM",
        mend="look at the CRS of poses, DOM and DSM, and whether poses are world-to-camera",
    )


def _left(sources: PhotoSources) -> dict[str, str]:
    return {key: str(getattr(sources, key).resolve()) for key in ("images", "dom", "dsm")}


def _copied(
    folder: Path, scene: str, sources: PhotoSources, names: tuple[str, ...]
) -> dict[str, str]:
    home = Path("data") / scene
    for name in names:
        target = folder / home / "images" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(sources.images / name, target)
    for key in ("dom", "dsm"):
        shutil.copyfile(getattr(sources, key), folder / home / f"{key}.tif")
    kept = {"images": home / "images", "dom": home / "dom.tif", "dsm": home / "dsm.tif"}
    return {key: path.as_posix() for key, path in kept.items()}


def _scene_entry(
    scene: ProtocolScene, inputs: SceneInputs, prepared: PreparedScene, places: dict[str, str]
) -> SceneFile:
    return SceneFile(
        id=scene.id,
        title=scene.title,
        crs=inputs.crs,
        plane_height_m=inputs.plane_height_m,
        without_ground_point=prepared.without_ground_point,
        **places,
    )


def _write_files(folder: Path, protocol: Protocol, entry: SceneFile) -> None:
    values = protocol.model_dump(mode="json", by_alias=True, exclude_none=True)
    target = folder / "protocols" / f"{protocol.name}.toml"
    target.parent.mkdir()
    target.write_text(tomli_w.dumps(values), encoding="utf-8")
    file = BenchmarkFile(
        schema=1,
        name=protocol.benchmark,
        version=1,
        title=protocol.title,
        gallery=protocol.gallery,
        ground_truth=protocol.ground_truth,
        scenes=(entry,),
        checksums={},
    )
    write_benchmark_file(folder, file)
