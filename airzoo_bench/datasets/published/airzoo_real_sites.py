"""The reconstruction sites of AirZoo-Real: four places, each in up to four hours of the day.

::

    airzoo_real_recon/<site>/<hours>/images/{i}_0.png       photos (_1, _2: other renderings)
                                    /poses/poses/t_pose.txt  name qw qx qy qz tx ty tz
                                    /poses/intrinsics/t_intrinsic.txt
                     /dom/fcw_hangtian_DSM.tif               heights, 0.5 m a pixel

Poses are world-to-camera in EPSG:4547 with OpenGL's camera axes; cameras are written for photos of
4032x3024 while those that are there have a quarter of that size.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import data_root
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.published.places import folder_content, stem_key, sub_folder
from airzoo_bench.datasets.published.pose_lines import (
    CameraLines,
    PosedFiles,
    PoseLines,
    posed_files,
    read_camera_lines,
    read_pose_lines,
)
from airzoo_bench.datasets.published.reference_maps import with_georeference
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.rasters import pixel_to_world

__all__ = ["SITES", "SITE_SCENES", "read_site", "site_files", "site_scenes"]

SITES: Mapping[str, str] = {
    "school": "xuexiao",
    "driving-school": "jiaxiao",
    "substation": "biandian",
    "plaza": "guangchang",
}
DAY, NIGHT = ("06-08", "12-14", "18-20"), ("22-24",)
SITE_SCENES = tuple(
    f"{site}-{hours}" for site in SITES for hours in (*DAY, *(NIGHT if "school" in site else ()))
)
"""Ids of the scenes, in the protocol's order; two sites were flown at night too."""
CRS = "EPSG:4547"

_HOME = "airzoo_real_recon"
_OPENGL = (1.0, -1.0, -1.0)
_PHOTO = re.compile(r"(.+)_0\.png", re.IGNORECASE)
_OTHERS = ("_1", "_2")
_SURFACE = "fcw_hangtian_DSM.tif"
_LAYOUT = (
    f"{_HOME}/{{{','.join(SITES.values())}}}/{{{','.join((*DAY, *NIGHT))}}}/images, "
    "poses/poses/t_pose.txt, poses/intrinsics/t_intrinsic.txt"
)


def site_folder(source: Path, scene: str) -> Path | None:
    """Return the folder of a scene such as "school-06-08"; None where it is not there."""
    site, hours = _site_and_hours(scene)
    home = sub_folder(source, _HOME) or source
    place = sub_folder(home, SITES[site])
    return None if place is None else sub_folder(place, hours)


def site_scenes(source: Path) -> list[str]:
    """Return the scenes that stand below a folder, in the protocol's order."""
    return [scene for scene in SITE_SCENES if site_folder(source, scene) is not None]


def site_files(source: Path, scene: str) -> list[Path]:
    """Return the folder of a scene, and that of the rasters of all sites."""
    home = site_folder(source, scene)
    return [part for part in (home, home and _rasters(source, home)) if part is not None]


def _rasters(source: Path, home: Path) -> Path | None:
    folders = (home.parent.parent, source)
    return next((found for one in folders if (found := sub_folder(one, "dom")) is not None), None)


def _site_and_hours(scene: str) -> tuple[str, str]:
    site, first, last = scene.rsplit("-", 2)
    return site, f"{first}-{last}"


def read_site(
    source: Path, scene: str, cloud: Path | None, reach_m: float, progress: Progress
) -> NativeScene:
    """Read the photos, cameras and poses of a scene, and its true cloud."""
    home = site_folder(source, scene)
    if home is None:
        raise BenchmarkError(f"scene {scene} is not there", where=source, expected=_LAYOUT)
    images, pose_file, camera_file = (
        _part(home, parts)
        for parts in (
            ("images",),
            ("poses", "poses", "t_pose.txt"),
            ("poses", "intrinsics", "t_intrinsic.txt"),
        )
    )
    lines = _of_photos(read_pose_lines(pose_file, _number, _OPENGL))
    lenses = read_camera_lines(camera_file, _number)
    posed = posed_files(images, _photos(images), lines, lenses, progress)
    dsm, notes = _surface(source, home, cloud is None)
    if cloud is None and dsm is not None:
        cloud = surface_cloud(dsm, posed.poses.centres, reach_m, scene)
        notes.append(
            f"the true cloud is made of dom/{_SURFACE}, one point a pixel within {reach_m:g} m of "
            "the cameras: the depth that the paper took is not in the release. It has no facades "
            "and nothing below a roof or a crown; --cloud names another"
        )
    return NativeScene(
        scene=scene,
        images=images,
        names=posed.names,
        cameras=posed.cameras,
        poses=posed.poses,
        crs=CRS,
        dsm=dsm,
        cloud=cloud,
        unposed=posed.unposed,
        notes=(*posed.notes, *_scaled(lenses, posed), *notes),
        poses_from=pose_file,
        conditions={"hours": [_site_and_hours(scene)[1]] * len(posed.names)},
    )


def _scaled(lenses: CameraLines, posed: PosedFiles) -> tuple[str, ...]:
    stated = sorted({f"{width:g}x{height:g}" for width, height in lenses.size.tolist()})
    there = sorted({f"{width}x{height}" for width, height in posed.sizes})
    if stated == there:
        return ()
    return (
        f"cameras are written for photos of {' and '.join(stated)} px and were scaled to those "
        f"that are there, {' and '.join(there)} px",
    )


def surface_cloud(dsm: Path, centres: Floats, reach_m: float, scene: str) -> Path:
    """Write the heights of a surface model around cameras as a cloud, one point a pixel."""
    low, high = centres[:, :2].min(axis=0) - reach_m, centres[:, :2].max(axis=0) + reach_m
    field = HeightField.read(dsm, (*low.tolist(), *high.tolist()))
    rows, columns = np.nonzero(np.isfinite(field.heights))
    places = pixel_to_world(field.transform, np.stack((columns, rows), axis=1) + 0.5)
    inside = ((places >= low) & (places <= high)).all(axis=1)
    heights = field.heights[rows, columns].astype(np.float64)
    points = np.column_stack((places, heights))[inside]
    if not len(points):
        raise BenchmarkError(
            "has no height around the cameras",
            where=dsm,
            expected=f"heights within {reach_m:g} m of them",
            fix="name a true cloud: --cloud SCENE=FILE",
        )
    target = data_root() / "made" / "airzoo-real" / f"{scene}-dsm-{reach_m:g}m.ply"
    target.parent.mkdir(parents=True, exist_ok=True)
    write_ply(target, Cloud(points))
    return target


def _surface(source: Path, home: Path, needed: bool) -> tuple[Path | None, list[str]]:
    """Find the surface model of all sites; none may be missing where the cloud is made of it."""
    dom = _rasters(source, home)
    file = None if dom is None else sub_folder(dom, _SURFACE)
    if file is not None:
        return with_georeference(file, data_root() / "made" / "airzoo-real", heights=True)
    if needed:
        raise BenchmarkError(
            f"there is no dom/{_SURFACE} to make the true cloud of"
            + ("" if dom is None else f": {folder_content(dom)}"),
            where=home.parent.parent,
            expected=f"{_HOME}/dom/{_SURFACE}",
            fix="download it too, or name a true cloud: --cloud SCENE=FILE",
        )
    return None, []


def _part(home: Path, parts: tuple[str, ...]) -> Path:
    place = home
    for part in parts:
        found = sub_folder(place, part)
        if found is None:
            raise BenchmarkError(
                f"lacks {part}: {folder_content(place)}",
                where=place,
                expected=_LAYOUT,
                fix="download the scene again, and unpack it whole",
            )
        place = found
    return place


def _photos(images: Path) -> dict[str, str]:
    """Return the photos, ``<name>_0.png``, by name; the other renderings are left aside."""
    found = {}
    for path in sorted(images.iterdir()):
        match = _PHOTO.fullmatch(path.name)
        if match is not None and not path.name.startswith("."):
            found[match[1]] = path.name
    if not found:
        raise BenchmarkError(
            f"holds no photo: {folder_content(images)}",
            where=images,
            expected="files such as 0_0.png, 1_0.png",
            fix="download the folder again",
        )
    return found


def _number(name: str) -> str:
    """Return what a name says of a photo, whether it is written as 12, 12_0 or images/12_0.png."""
    return stem_key(name).removesuffix("_0")


def _of_photos(lines: PoseLines) -> PoseLines:
    """Leave out the lines of the other renderings, <name>_1 and <name>_2, if there are any."""
    known = set(lines.keys)
    kept = [
        i for i, key in enumerate(lines.keys) if key[:-2] not in known or key[-2:] not in _OTHERS
    ]
    rows = np.array(kept)
    keys = tuple(lines.keys[i] for i in kept)
    return PoseLines(lines.path, keys, lines.poses.take(rows), lines.rounding_m[rows])
