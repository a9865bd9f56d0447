"""DJI photos with RTK: their metadata, which are the truth, and the dataset."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import BenchmarkError, CameraError, UsageError, first_of, readable
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.cameras import (
    are_alike,
    cameras_of_lenses,
    film_focal_px,
    lens_of,
    read_camera_file,
    stated_cameras,
)
from airzoo_bench.datasets.content import photo_sizes, utm_zone
from airzoo_bench.datasets.metadata import (
    PhotoPrior,
    metadata_priors,
    priors_to_poses,
    read_dji_texts,
    read_prior,
    read_prior_file,
)
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos
from airzoo_bench.datasets.settings import DjiOptions
from airzoo_bench.datasets.surveys.survey import Survey, posed_scene, stated_crs
from airzoo_bench.datasets.tables import read_native_text
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import geodesic_distance_m, horizontal_crs
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.protocol import MatchingProtocol

_FIXED = (48, 49, 50)  # RtkFlag of a fixed solution, or its finer kinds
_SAME_PLACE_M = 5.0  # between a photo's own position and its time stamp's
_PHOTO_NUMBER = re.compile(r"(?<!\d)(\d{4})(?!\d)")
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
_OUT = "take the table out of the folder, and positions come from the photos"
_DEWARP = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")

Std = tuple[float, float, float]
"""Standard deviations to the east and north, and of the height, in metres."""


class _DjiFolders(Survey[DjiOptions]):
    """Photos with their own metadata as truth: RTK position, gimbal angles."""

    about = load_about("dji")
    options = DjiOptions
    needs = ("dom",)

    def benchmark_protocols(self, options: DjiOptions, root: Path) -> BenchmarkProtocols:
        kept = []
        for protocol in super().benchmark_protocols(options, root).every:
            if isinstance(protocol, MatchingProtocol):
                scores = protocol.scores.model_copy(update={"orientation_is_trusted": False})
                protocol = protocol.model_copy(update={"scores": scores})
            kept.append(protocol)
        return BenchmarkProtocols(tuple(kept))

    def read(self, options: DjiOptions, scene: str, progress: Progress) -> NativeScene:
        images = options.images or options.source
        sizes = photo_sizes(images, progress)
        shown = list(progress(sorted(sizes), "metadata", len(sizes)))
        metadata = {name: read_prior(images / name) for name in shown}
        tags = {name: read_tags(images / name, sizes[name]) for name in shown}
        stamps, notes = photo_time_stamps(options.source, images, metadata)
        truth, more = true_positions(metadata, tags, stamps, options.source)
        names, notes = tuple(truth), [*notes, *more]
        metadata = {name: metadata[name] for name in names}
        crs = _crs(options, truth, notes)
        poses = priors_to_poses(truth, crs)
        stated = [stamps[n].std_m if n in stamps else tags[n].std_m for n in names]
        accuracy = _stated_accuracy([std for std in stated if std is not None], notes)
        plane = options.plane_height
        if plane is None and options.dsm is None:
            plane = _take_off(truth, images, notes)
        priors = None
        if options.priors is not None:
            given = read_prior_file(options.priors, sizes)
            own = {name: PhotoPrior(**given.get(name, {})) for name in names}
            priors = metadata_priors(own, crs)
        own_sizes = {name: sizes[name] for name in names}
        fix = "give the camera with --camera"
        cameras, said = photo_cameras(images, own_sizes, tags, options.camera, fix)
        parts: dict[str, Any] = {"plane_height_m": plane, "truth_accuracy_m": accuracy}
        parts |= {"priors": priors, "metadata": metadata, "is_metadata": True}
        parts |= {"notes": (*notes, *said), "crs_from": str(options.dsm or options.dom)}
        posed = PosedPhotos(names, cameras, poses, crs)
        return posed_scene(options, scene, images, sizes, posed, images, progress, **parts)


def _crs(options: DjiOptions, truth: Mapping[str, PhotoPrior], notes: list[str]) -> str:
    """Return the CRS that is stated, else the map's, else the UTM zone of the photos."""
    crs = stated_crs(options)
    if crs is None:
        crs = horizontal_crs(open_info(options.dsm or options.dom or Path()).crs)
    if not crs.is_projected:
        lonlat = np.array([(p.lon, p.lat) for p in truth.values()], np.float64)
        crs = CRS.from_user_input(utm_zone(lonlat))
        notes.append(f"poses are in {crs.name}, the photos' zone")
    return str(crs.to_string())


def _stated_accuracy(stds: Sequence[Std], notes: list[str]) -> float | None:
    """Return how good positions are stated to be, in metres of all three axes, and say it."""
    if not stds:
        notes.append("photos do not state how good their positions are")
        return None
    values = np.array(stds)
    level = round(float(np.median(np.linalg.norm(values, axis=1))), 4)
    notes.append(
        f"positions are stated good to {level} m (median of the standard deviations of {len(stds)} "
        "photos); gimbal angles to no figure"
    )
    return level or None  # a file of zeros states nothing


def _take_off(truth: Mapping[str, PhotoPrior], images: Path, notes: list[str]) -> float:
    """Return the height of the place of take-off, in the photos' altitudes."""
    known = [
        p.altitude_m - p.relative_altitude_m
        for p in truth.values()
        if p.altitude_m is not None and p.relative_altitude_m is not None
    ]
    if not known:
        what = "there is no surface model, and photos have no RelativeAltitude"
        raise UsageError(what, where=images, fix="give --dsm or --plane-height")
    height = float(np.median(known))
    notes.append(
        f"the ground is a plane at {height:.2f} m, where the drone took off: absolute less "
        f"relative altitude, {np.ptp(known):.2f} m apart at most (--dsm for a surface)"
    )
    return height


@dataclass(frozen=True)
class DjiTags:
    """A photo's metadata on the quality of its position and on its lens, empty where none is.

    `rtk_flag` is 16 for a single point, 34 for a float solution.
    """

    rtk_flag: int | None
    std_m: Std | None
    lens: dict[str, float]
    lens_from: str


def read_tags(path: Path, size: tuple[int, int]) -> DjiTags:
    """Read the quality of a photo's position, and its lens."""
    texts = read_dji_texts(path)
    with readable(path, "damaged metadata of DJI", kind=BenchmarkError):
        flag = int(float(texts["RtkFlag"])) if "RtkFlag" in texts else None
        east, north, up = (float(texts.get(f"RtkStd{a}", "nan")) for a in ("Lon", "Lat", "Hgt"))
        lens = _dewarp(texts, size)
    said = "DewarpData" + ", of photos without distortion" * (texts.get("DewarpFlag") == "1")
    film, millimetres = film_focal_px(path, size)
    if lens and film is not None and not are_alike(lens["fx"], film):
        what = f"DJI's DewarpData has fx = {lens['fx']:g} px, and the focal length of 35 mm film "
        what += f"makes {film:g} px in a photo of {size[0]}x{size[1]} px"
        fix = "take the photos in their original size, or give the camera with --camera"
        raise BenchmarkError(what, where=path, fix=fix)
    if not lens and film is not None:
        lens = {"fx": film}
        said = f"the focal length of 35 mm film ({millimetres} mm), without distortion"
    std_m = (east, north, up) if np.isfinite((east, north, up)).all() else None
    return DjiTags(flag, std_m, lens, said)


def _dewarp(texts: Mapping[str, str], size: tuple[int, int]) -> dict[str, float]:
    """Read ``date;fx,fy,cx,cy,k1,k2,p1,p2,k3``; cx, cy count from the middle of the photo."""
    stated = texts.get("DewarpData", "").rpartition(";")[2]
    values = [float(part) for part in stated.split(",")] if stated else []
    if not any(values):
        return {}
    lens = dict(zip(_DEWARP, values, strict=True))
    lens["cx"] += size[0] / 2
    lens["cy"] += size[1] / 2
    return lens | (dict.fromkeys(_DEWARP[4:], 0.0) if texts.get("DewarpFlag") == "1" else {})


def photo_cameras(
    home: Path,
    sizes: Mapping[str, tuple[int, int]],
    tags: Mapping[str, DjiTags],
    given: Path | None,
    fix: str,
) -> tuple[Cameras, list[str]]:
    """Return cameras: of a file, else as the photos state them; and sentences on what states them.

    `fix` says how the file is given.
    """
    if given is not None:
        values = dict.fromkeys(sizes, read_camera_file(given))
        return stated_cameras(values, sizes, home, given), [f"cameras are from {given.name}"]
    lacking = [name for name in sizes if not tags[name].lens]
    if lacking:
        what = f"photos state no camera: {first_of(lacking, len(sizes))}"
        expected = "DJI's DewarpData, or EXIF FocalLengthIn35mmFilm"
        raise CameraError(what, where=home, expected=expected, fix=fix)
    lenses = [lens_of(tags[name].lens, size, home / name) for name, size in sizes.items()]
    said = sorted({tags[name].lens_from for name in sizes})
    cameras = cameras_of_lenses(lenses, list(sizes), sizes)
    return cameras, [f"cameras are from {what}" for what in said]


@dataclass(frozen=True)
class TimeStamp:
    """A line of a table of time stamps: where a photo was taken, above the ellipsoid."""

    lat: float
    lon: float
    height_m: float
    std_m: Std
    flag: int


def read_time_stamps(path: Path) -> dict[int, TimeStamp]:
    """Read a table of time stamps (.MRK) by the number of the photo, its values by their order."""
    stamps: dict[int, TimeStamp] = {}
    text = read_native_text(path)
    expected = "photo, time, [week], N, E, V (mm), latitude, longitude, height, three standard "
    expected += "deviations, flag; a flight in each folder"
    with readable(
        path, "no table of time stamps", kind=BenchmarkError, expected=expected, fix=_OUT
    ):
        for line in filter(str.strip, text.splitlines()):
            photo, *_, lat, lon, height, north, east, up, flag = map(float, _NUMBER.findall(line))
            if len(_) != 5 or abs(lat) > 90 or int(photo) in stamps:
                raise ValueError(f"other numbers, or a second line of one photo: {line[:80]!r}")
            stamps[int(photo)] = TimeStamp(lat, lon, height, (east, north, up), int(flag))
    return stamps


def photo_time_stamps(
    source: Path, images: Path, metadata: Mapping[str, PhotoPrior]
) -> tuple[dict[str, TimeStamp], list[str]]:
    """Return each photo's time stamp, by its number from the table in its folder, and notes."""
    tables = sorted(p for p in source.rglob("*") if p.name.lower().endswith("timestamp.mrk"))
    found: dict[str, TimeStamp] = {}
    for table in tables:
        stamps = read_time_stamps(table)
        for name in metadata:
            numbers = _PHOTO_NUMBER.findall(PurePosixPath(name).stem)
            ours = (images / name).parent == table.parent
            if ours and numbers and int(numbers[-1]) in stamps:
                found[name] = stamps[int(numbers[-1])]
    if not tables:
        return {}, []
    far = [name for name, stamp in found.items() if _apart_m(metadata[name], stamp) > _SAME_PLACE_M]
    if far or not found:
        what = "time stamps are of other photos: none has their numbers, or they are more than "
        what += f"{_SAME_PLACE_M:g} m away ({first_of(far, len(found))})"
        raise BenchmarkError(what, where=tables[0], fix=_OUT)
    names = first_of([table.name for table in tables], noun="table")
    said = f"positions of {len(found)} of {len(metadata)} photos come from {names} of time stamps"
    return found, [f"{said}, above the ellipsoid"]


def _apart_m(prior: PhotoPrior, stamp: TimeStamp) -> float:
    """Return how far a photo's own position is from its time stamp's; 0 where it has none."""
    if prior.lon is None or prior.lat is None:
        return 0.0
    places = np.array([(prior.lon, prior.lat), (stamp.lon, stamp.lat)])
    return float(geodesic_distance_m(*places))


def true_positions(
    metadata: Mapping[str, PhotoPrior],
    tags: Mapping[str, DjiTags],
    stamps: Mapping[str, TimeStamp],
    where: Path,
) -> tuple[dict[str, PhotoPrior], list[str]]:
    """Return the photos with a position that can be truth, and a note on the others.

    Where there are time stamps, they are the positions: heights of photos without one may be of
    another datum.
    """
    placed, flags = dict(metadata), {name: tags[name].rtk_flag for name in metadata}
    if stamps:
        flags = {name: stamp.flag for name, stamp in stamps.items()}
        placed = {
            name: replace(metadata[name], lon=one.lon, lat=one.lat, altitude_m=one.height_m)
            for name, one in stamps.items()
        }
    chosen = [
        name
        for name in metadata
        if name in placed and placed[name].is_complete and flags[name] in _FIXED
    ]
    if not chosen:
        what = "no photo has a fixed RTK position, an altitude and gimbal angles"
        expected = "photos as the drone wrote them, with EXIF GPS, DJI's XMP and RtkFlag 50"
        raise BenchmarkError(what, where=where, expected=expected)
    others = [name for name in metadata if name not in chosen]
    what = "photos without an RTK fix, a time stamp, altitude or angles, left out"
    notes = [f"{what}: {first_of(others, len(metadata))}"] if others else []
    return {name: placed[name] for name in chosen}, notes


DJI = _DjiFolders()
