"""The two survey regions of AirZoo-Real: photos of a DJI drone with RTK, DOM and DSM.

What the files of ``Scene1`` (City) and ``Scene2`` (Rural) are called is not known, so they are told
by their kind: photos, rasters of colours and of heights, and DJI's tables of RTK positions (.MRK).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import data_root
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.photo_metadata import priors_to_poses
from airzoo_bench.datasets.photos import metadata_priors, photo_metadata
from airzoo_bench.datasets.published.dji_rtk import true_positions
from airzoo_bench.datasets.published.places import folder_content, sub_folder
from airzoo_bench.datasets.published.reference_maps import find_maps, only_one, with_georeference
from airzoo_bench.datasets.surveys.dji_tags import photo_cameras, read_tags
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from airzoo_bench.geometry.rasters import gsd_m, open_info

__all__ = ["REGIONS", "RegionFiles", "RegionOptions", "read_region", "region_files", "region_home"]

CRS = "EPSG:4547"
REGIONS: Mapping[str, str] = {"City": "Scene1", "Rural": "Scene2"}

_PHOTOS = (".jpg", ".jpeg")
_LAYOUT = "Scene1/ (City) and Scene2/ (Rural), each with photos, a DOM, a DSM and RTK tables"
# As `matching.prepare` tells priors that are the truth.
_SAME_M, _SAME_DEG = 0.02, 0.1


@dataclass(frozen=True)
class RegionOptions:
    """What the user says of a region.

    Attributes
    ----------
    dom, dsm, satellite, positions, priors, camera : Path or None
    height_offset_m : float
        Is added to the heights of true positions and priors.
    """

    dom: Path | None = None
    dsm: Path | None = None
    satellite: Path | None = None
    positions: Path | None = None
    priors: Path | None = None
    camera: Path | None = None
    height_offset_m: float = 0.0

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that were named."""
        named = (self.dom, self.dsm, self.satellite, self.positions, self.priors, self.camera)
        return tuple(file for file in named if file is not None)


@dataclass(frozen=True)
class RegionFiles:
    """Where the parts of a region stand.

    Attributes
    ----------
    home : Path
    photos : tuple of str
        Relative to `home`.
    dom, dsm : Path
    satellite : Path or None
        The map of retrieval, of the resolution that its protocol has; may be `dom`.
    rtk : tuple of Path
        DJI's tables of positions.
    notes : tuple of str
    """

    home: Path
    photos: tuple[str, ...]
    dom: Path
    dsm: Path
    satellite: Path | None
    rtk: tuple[Path, ...]
    notes: tuple[str, ...]


def region_home(source: Path, scene: str) -> Path | None:
    """Return the folder of a region, Scene1 or Scene2; None where it is not there."""
    return sub_folder(source, REGIONS[scene])


def region_files(
    source: Path, scene: str, options: RegionOptions, gsd: tuple[float, float]
) -> RegionFiles:
    """Tell the files of a region by their kind."""
    home = region_home(source, scene)
    if home is None:
        raise BenchmarkError(
            f"lacks {REGIONS[scene]}: {folder_content(source)}", where=source, expected=_LAYOUT
        )
    every = sorted(p for p in home.rglob("*") if p.is_file() and not p.name.startswith("."))
    photos = [p.relative_to(home).as_posix() for p in every if p.suffix.lower() in _PHOTOS]
    if not photos:
        raise BenchmarkError(
            f"holds no photo: {folder_content(home)}",
            where=home,
            expected="the drone's photos as .JPG",
            fix="download the folder again, and unpack it",
        )
    maps, notes = _maps(home, scene, options, gsd)
    rtk = tuple(path for path in every if path.suffix.lower() == ".mrk")
    return RegionFiles(home, tuple(photos), *maps, rtk, notes)


def _maps(
    home: Path, scene: str, options: RegionOptions, gsd: tuple[float, float]
) -> tuple[tuple[Path, Path, Path | None], tuple[str, ...]]:
    """Return DOM, surface model and retrieval's map, each with its georeference, and notes."""
    found, made = find_maps(home), data_root() / "made" / "airzoo-real" / scene
    fits = [path for path in found.maps if _has_gsd(with_georeference(path, made)[0], gsd)]
    other = [path for path in found.maps if path not in (*fits, options.satellite)]
    doms = found.maps if len(found.maps) == 1 else other
    dom = options.dom or only_one(doms, "map (DOM)", home, f"--dom {scene}=FILE")
    dsm = options.dsm or only_one(found.surfaces, "surface model", home, f"--dsm {scene}=FILE")
    satellite = options.satellite
    if satellite is None and fits:
        satellite = only_one(fits, "satellite map", home, f"--satellite {scene}=FILE")
    of_dom, of_dsm = with_georeference(dom, made), with_georeference(dsm, made, heights=True)
    of_map = None if satellite is None else with_georeference(satellite, made)
    taken = f"{dom.name} is the DOM, {dsm.name} the surface model; " + (
        f"no map has {gsd[0]:g} m a pixel: without --satellite {scene}=FILE retrieval has no truth"
        if satellite is None
        else f"{satellite.name} is the map of retrieval"
    )
    said = [*of_dom[1], *of_dsm[1], *(of_map[1] if of_map is not None else ())]
    paths = (of_dom[0], of_dsm[0], None if of_map is None else of_map[0])
    return paths, (taken, *dict.fromkeys(said))


def read_region(
    files: RegionFiles, scene: str, options: RegionOptions, progress: Progress
) -> NativeScene:
    """Read photos, cameras and true positions of a region."""
    shown = progress(files.photos, "photos", len(files.photos))
    sizes = {name: photo_size(files.home / name) for name in shown}
    metadata = photo_metadata(files.photos, files.home, options.priors, sizes, progress)
    stated = metadata
    if options.priors is not None:
        stated = photo_metadata(files.photos, files.home, None, sizes, progress)
    tags = {name: read_tags(files.home / name, size) for name, size in sizes.items()}
    truth = true_positions(stated, tags, files.rtk, options.positions)
    kept = tuple(name for name in files.photos if name in truth.positions)
    if not kept:
        raise BenchmarkError(
            f"no photo has a true position and gimbal angles: {truth.said}",
            where=files.home,
            expected="photos of a drone with RTK, with DJI's metadata",
            fix=f"give their positions: --positions {scene}=FILE (image, lon, lat, altitude_m)",
        )
    of_kept = {name: metadata[name] for name in kept}
    sizes = {name: sizes[name] for name in kept}
    fix = f"--camera {scene}=FILE, JSON with fx (px), or focal_mm and sensor_mm, or fov_deg"
    cameras, of_cameras = photo_cameras(files.home, sizes, tags, options.camera, fix)
    offset = options.height_offset_m
    poses = _raised(priors_to_poses({name: truth.positions[name] for name in kept}, CRS), offset)
    priors = metadata_priors(of_kept, CRS)
    priors, said = _unlike_truth(None if priors is None else _raised(priors, offset), poses)
    return NativeScene(
        scene=scene,
        images=files.home,
        names=kept,
        cameras=cameras,
        poses=poses,
        crs=CRS,
        dom=files.dom,
        dsm=files.dsm,
        gallery=None if files.satellite == files.dom else files.satellite,
        priors=priors,
        metadata=of_kept,
        unposed=tuple(name for name in files.photos if name not in truth.positions),
        notes=(*files.notes, truth.said, *of_cameras, *said),
        poses_from=truth.path,
    )


def _raised(poses: Poses, offset_m: float) -> Poses:
    centres = poses.centres + np.array((0.0, 0.0, offset_m))
    return Poses(rotation=poses.rotation, centres=centres)


def _unlike_truth(priors: Poses | None, poses: Poses) -> tuple[Poses | None, tuple[str, ...]]:
    """Return priors as they are, none where they are the truth."""
    if priors is None:
        return None, ()
    apart = np.linalg.norm(priors.centres - poses.centres, axis=1)
    turned = rotation_angle_deg(priors.rotation, poses.rotation)
    same = int(((apart < _SAME_M) & (turned < _SAME_DEG)).sum())
    if 2 * same <= len(poses):
        return priors, ()
    return None, (
        f"the photos' own metadata are the truth in {same} of {len(poses)} photos, and so no "
        "prior: matching has no truth. --priors gives others; --positions gives processed "
        "positions for the truth; --prior truth crops by the truth, as a benchmark of another name",
    )


def _has_gsd(path: Path, gsd: tuple[float, float]) -> bool:
    return all(abs(side / gsd[0] - 1.0) <= gsd[1] for side in gsd_m(open_info(path)))
