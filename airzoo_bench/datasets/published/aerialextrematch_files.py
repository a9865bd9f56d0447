"""Files of AerialExtreMatch's localisation set.

::

    rgb/<name>.JPG     queries
    gt_pose.txt        name qw qx qy qz tx ty tz: world-to-camera, OpenCV axes, EPSG:4547
    intrinsic.txt      name PINHOLE width height fx fy cx cy
    HQref/, LQref/     an orthophoto and a surface model as GeoTIFF, with .prj and .tfw

Names agree up to their first point.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.core.files import data_root
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.photos import metadata_priors, photo_metadata
from airzoo_bench.datasets.published.places import (
    files_by_key,
    find_home,
    folder_content,
    stem_key,
    sub_folder,
)
from airzoo_bench.datasets.published.pose_lines import (
    CameraLines,
    PosedFiles,
    posed_files,
    read_camera_lines,
    read_pose_lines,
)
from airzoo_bench.datasets.published.reference_maps import find_maps, only_one, with_georeference
from airzoo_bench.geometry.crs import check_same_crs
from airzoo_bench.geometry.rasters import open_info

__all__ = ["CRS", "LocalizationFiles", "localization_files", "read_localization"]

CRS = "EPSG:4547"
Reference = Literal["hq", "lq"]

_FOLDERS = {"hq": "HQref", "lq": "LQref"}
_LAYOUT = "rgb/*.JPG, gt_pose.txt, intrinsic.txt, and HQref/*.tif or LQref/*.tif"
_WITHIN_PX = 1.0


@dataclass(frozen=True)
class LocalizationFiles:
    """Where the parts stand."""

    home: Path
    images: Path
    poses: Path
    cameras: Path
    reference: Path


def localization_files(source: Path, reference: Reference) -> LocalizationFiles:
    """Find the parts of the localisation set."""
    _refuse_pairs(source)
    home = find_home(source, ("gt_pose.txt", "rgb"), _LAYOUT)
    parts = ("rgb", "gt_pose.txt", "intrinsic.txt", _FOLDERS[reference])
    found = [sub_folder(home, part) for part in parts]
    lacking = [part for part, path in zip(parts, found, strict=True) if path is None]
    if lacking:
        raise BenchmarkError(
            f"lacks {', '.join(lacking)}: {folder_content(home)}",
            where=home,
            expected=_LAYOUT,
            fix="download what is missing, or name the other references with --reference",
        )
    return LocalizationFiles(home, *(path for path in found if path is not None))


def _refuse_pairs(source: Path) -> None:
    """Say what the folders of the evaluation pairs are: they come from another download."""
    if sub_folder(source, "gt_pose.txt") is None and sub_folder(source, "class_0") is not None:
        raise BenchmarkError(
            "these are AerialExtreMatch's evaluation pairs, class_0 to class_31, whose .npy files "
            "are Python pickles: to read one is to run what it says, which is never done here",
            where=source,
            expected=f"the localization set: {_LAYOUT}",
            fix="where you trust them, write them as .npz and score poses by "
            "airzoo_bench.pose_errors: docs/benchmarks.md has the lines",
        )


def read_localization(
    source: Path, reference: Reference, priors: Path | None, scene: str, progress: Progress
) -> NativeScene:
    """Read photos, cameras, poses and references of the localisation set."""
    files = localization_files(source, reference)
    lenses = read_camera_lines(files.cameras, stem_key)
    photos = files_by_key(files.images, PHOTO_SUFFIXES)
    lines = read_pose_lines(files.poses, stem_key)
    posed = posed_files(files.images, photos, lines, lenses, progress)
    _check_sizes(posed, lenses)
    sizes = dict.fromkeys(photos.values(), (0, 0))
    metadata = photo_metadata(posed.names, files.images, priors, sizes, progress)
    dom, dsm, notes = _references(files.reference, reference, scene)
    return NativeScene(
        scene=scene,
        images=files.images,
        names=posed.names,
        cameras=posed.cameras,
        poses=posed.poses,
        crs=CRS,
        dom=dom,
        dsm=dsm,
        priors=metadata_priors(metadata, CRS),
        metadata=metadata,
        unposed=posed.unposed,
        notes=(*posed.notes, *notes),
        poses_from=files.poses,
    )


def _references(folder: Path, reference: Reference, scene: str) -> tuple[Path, Path, list[str]]:
    found = find_maps(folder)
    move = "leave one in the folder, the others elsewhere"
    made = data_root() / "made" / "aerialextrematch" / f"{scene}-{reference}"
    dom, of_map = with_georeference(only_one(found.maps, "orthophoto", folder, move), made)
    dsm, of_heights = with_georeference(
        only_one(found.surfaces, "surface model", folder, move), made, heights=True
    )
    for path in (dom, dsm):
        check_same_crs(CRS, open_info(path).crs, f"the poses and {path.name}")
    return dom, dsm, [f"references of {folder.name}", *of_map, *of_heights]


def _check_sizes(posed: PosedFiles, lenses: CameraLines) -> None:
    """Hold photos to their camera's size and to twice its principal point."""
    row = {key: place for place, key in enumerate(lenses.keys)}
    rows = [row[key] for key in posed.keys]
    size, stated, twice = np.array(posed.sizes), lenses.size[rows], 2.0 * lenses.lens[rows, 2:]
    apart = np.maximum(np.abs(stated - size), np.abs(twice - size)).max(axis=1)
    odd = [
        f"{posed.keys[i]} is {size[i, 0]}x{size[i, 1]}, its camera for {stated[i, 0]:g}x"
        f"{stated[i, 1]:g} with 2 cx x 2 cy = {twice[i, 0]:g}x{twice[i, 1]:g}"
        for i in np.flatnonzero(apart > _WITHIN_PX).tolist()
    ]
    if odd:
        raise CameraError(
            f"photos of another size than their cameras: {first_of(odd, len(size))}",
            where=lenses.path,
            expected="width and height of the photo, and the principal point in its middle, as "
            "the benchmark's own code takes it",
            fix="use the photos as they were downloaded, at their full size",
        )
