"""DJI photos with RTK, whose metadata are the truth: what they state, and the dataset of them."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import BenchmarkError, CameraError, UsageError, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.registry import Option
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.content import photo_sizes, utm_zone
from airzoo_bench.datasets.lenses import (
    are_alike,
    cameras_of_lenses,
    check_focal_lengths,
    film_focal_px,
    lens_of,
    read_camera_file,
)
from airzoo_bench.datasets.metadata import (
    PhotoPrior,
    metadata_priors,
    priors_to_poses,
    read_dji_texts,
    read_prior,
    read_prior_file,
)
from airzoo_bench.datasets.scenes import NativeScene
from airzoo_bench.datasets.surveys.survey import (
    Survey,
    SurveyOptions,
    stated_crs,
    surface_altitudes,
)
from airzoo_bench.datasets.tables import read_native_text
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import geodesic_distance_m, horizontal_crs
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.settings import MatchingProtocol

__all__ = [
    "DJI",
    "DjiOptions",
    "photo_cameras",
    "photo_time_stamps",
    "read_tags",
    "true_positions",
]

_SAME_PRIOR_M = 0.01
_FIXED = (48, 49, 50)  # RtkFlag of a fixed solution, or its finer kinds
_SAME_PLACE_M = 5.0  # between a photo's own position and its time stamp's
_PHOTO_NUMBER = re.compile(r"(?<!\d)(\d{4})(?!\d)")
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
_STAMP_NUMBERS = 13
_DEWARP = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True, kw_only=True)
class DjiOptions(SurveyOptions):
    """Options of a folder of DJI photos."""

    source: Annotated[Path, Option("source", "Folder of the photos, and of *_Timestamp.MRK.")]
    priors: Annotated[
        Path | None,
        Option("priors", "CSV of positions and angles that are not the RTK's, for matching."),
    ] = None
    rtk: Annotated[
        Literal["fixed", "any"],
        Option("rtk", "Photos whose position becomes truth: those with an RTK fix, or any."),
    ] = "fixed"
    camera: Annotated[
        Path | None, Option("camera", "Camera of all photos (JSON); default: what the photos say.")
    ] = None


class DjiFolders(Survey[DjiOptions]):
    """Photos whose own metadata are the truth: RTK position, gimbal angles."""

    about = about_of("dji")
    options = DjiOptions
    needs = ("dom",)

    def benchmark_protocols(self, options: DjiOptions, root: Path) -> BenchmarkProtocols:
        """Return the protocols of own photos; orientations are not trusted."""
        kept = []
        for protocol in super().benchmark_protocols(options, root).every:
            if isinstance(protocol, MatchingProtocol):
                scores = protocol.scores.model_copy(update={"orientation_is_trusted": False})
                protocol = protocol.model_copy(update={"scores": scores})
                if options.dsm is None:
                    continue
            kept.append(protocol)
        return BenchmarkProtocols(tuple(kept))

    def read(self, options: DjiOptions, scene: str, progress: Progress) -> NativeScene:
        """Read the photos' metadata, and tables of time stamps next to them."""
        images = options.images or options.source
        sizes = photo_sizes(images, progress)
        shown = list(progress(sorted(sizes), "metadata", len(sizes)))
        metadata = {name: read_prior(images / name) for name in shown}
        tags = {name: read_tags(images / name, sizes[name]) for name in shown}
        stamps, notes = photo_time_stamps(options.source, images, metadata)
        fixed_only = options.rtk == "fixed"
        kept, more = true_positions(metadata, tags, stamps, options.source, fixed_only=fixed_only)
        notes += more
        names = tuple(kept)
        kept, converted = _of_surface(options, kept)
        metadata, _ = _of_surface(options, {name: metadata[name] for name in names})
        notes += converted
        crs = _crs(options, kept, notes)
        poses = priors_to_poses(kept, crs)
        stated = [stamps[n].std_m if n in stamps else tags[n].std_m for n in names]
        accuracy = _stated_accuracy([std for std in stated if std is not None], notes)
        plane = options.plane_height
        if plane is None and options.dsm is None:
            plane = _take_off(kept, images, notes)
        priors = _priors(options, names, sizes, poses, crs, notes)
        of_kept = {name: sizes[name] for name in names}
        fix = "give the camera with --camera"
        cameras, said = photo_cameras(images, of_kept, tags, options.camera, fix)
        return NativeScene(
            scene,
            images,
            names,
            cameras,
            poses,
            crs,
            dom=options.dom,
            dsm=options.dsm,
            cloud=options.cloud,
            plane_height_m=plane,
            priors=priors,
            metadata=metadata,
            is_metadata=True,
            unposed=tuple(name for name in sorted(sizes) if name not in kept),
            notes=(*notes, *said),
            truth_accuracy_m=options.truth_accuracy or accuracy,
            poses_from=images,
            crs_from=f"--crs {options.crs}" if options.crs else str(options.dsm or options.dom),
        )


def _of_surface(
    options: DjiOptions, photos: dict[str, PhotoPrior]
) -> tuple[dict[str, PhotoPrior], tuple[str, ...]]:
    """Take the heights that are the truth to the surface model's, and say so."""
    given, dsm_vertical = options.vertical_crs, options.dsm_vertical_crs
    what = "heights of the poses"
    return surface_altitudes(photos, given, "--vertical-crs", options.dsm, dsm_vertical, what)


def _crs(options: DjiOptions, kept: Mapping[str, PhotoPrior], notes: list[str]) -> str:
    """Return the CRS that is stated, else the map's, else the UTM zone of the photos."""
    crs = stated_crs(options)
    if crs is None:
        crs = horizontal_crs(open_info(options.dsm or options.dom or Path()).crs)
    if crs.is_projected:
        return str(crs.to_string())
    if options.dsm is not None:
        raise UsageError(
            "the surface model is in degrees", where=options.dsm, fix="warp it to the UTM zone"
        )
    zone = CRS.from_user_input(
        utm_zone(np.array([(p.lon, p.lat) for p in kept.values()], np.float64))
    )
    notes.append(f"poses are in {zone.name}, the photos' zone")
    return str(zone.to_string())


def _stated_accuracy(stds: Sequence[tuple[float, float, float]], notes: list[str]) -> float | None:
    """Return how good positions are stated to be, in metres of all three axes, and say it."""
    if not stds:
        notes.append("photos do not state how good their positions are")
        return None
    values = np.array(stds)
    level = np.median(np.hypot(values[:, 0], values[:, 1]))
    notes.append(
        f"positions are stated good to {level:.3f} m in plan and {np.median(values[:, 2]):.3f} m "
        f"in height (medians of standard deviations of {len(stds)} photos); gimbal angles to no "
        "figure"
    )
    # A file of zeros states nothing.
    return round(float(np.median(np.linalg.norm(values, axis=1))), 4) or None


def _take_off(kept: Mapping[str, PhotoPrior], images: Path, notes: list[str]) -> float:
    """Return the height of the place of take-off, in the photos' altitudes."""
    known = [
        p.altitude_m - p.relative_altitude_m
        for p in kept.values()
        if p.altitude_m is not None and p.relative_altitude_m is not None
    ]
    if not known:
        raise UsageError(
            "there is no surface model, and photos have no RelativeAltitude",
            where=images,
            fix="give --dsm or --plane-height",
        )
    height = float(np.median(known))
    notes.append(
        f"the ground is a plane at {height:.2f} m, where the drone took off: absolute less "
        f"relative altitude, {np.ptp(known):.2f} m apart at most (--dsm for a surface)"
    )
    return height


def _priors(
    options: DjiOptions,
    names: tuple[str, ...],
    sizes: Mapping[str, tuple[int, int]],
    poses: Poses,
    crs: str,
    notes: list[str],
) -> Poses | None:
    """Return priors of another source than the truth; None where none are given."""
    if options.priors is None:
        return None
    given = read_prior_file(options.priors, sizes)
    every = {name: PhotoPrior(**given.get(name, {})) for name in names}
    vertical, what = options.priors_vertical_crs, "altitudes of --priors"
    every, converted = surface_altitudes(
        every, vertical, "--priors-vertical", options.dsm, options.dsm_vertical_crs, what
    )
    notes += converted
    priors = metadata_priors(every, crs)
    if priors is None:
        raise BenchmarkError(
            "gives no photo with an RTK position a whole prior",
            where=options.priors,
            expected="image, lon, lat, altitude_m, yaw_deg, pitch_deg, roll_deg",
        )
    away = np.nanmedian(np.linalg.norm(priors.centres - poses.centres, axis=1))
    if away < _SAME_PRIOR_M:
        raise BenchmarkError(
            f"its positions are the truth: {away:.4f} m from the RTK's (median)",
            where=options.priors,
            expected="positions of another source, such as the receiver without RTK",
            fix="leave --priors out: retrieval needs none",
        )
    return priors


@dataclass(frozen=True)
class DjiTags:
    """A photo's metadata on the quality of its position and on its lens.

    `rtk_flag` is 16 for a single point, 34 for a float solution. `std_m` are standard deviations to
    the east and north, and of the height; `lens` is empty where none is stated.
    """

    rtk_flag: int | None
    std_m: tuple[float, float, float] | None
    lens: dict[str, float]
    lens_from: str


def read_tags(path: Path, size: tuple[int, int]) -> DjiTags:
    """Read the quality of a photo's position, and its lens."""
    texts = read_dji_texts(path)
    try:
        flag, *stds = (
            next(iter(_numbers(texts, name, 1)), None)
            for name in ("RtkFlag", "RtkStdLon", "RtkStdLat", "RtkStdHgt")
        )
        lens = _dewarp(texts, size)
    except BenchmarkError as fault:
        raise fault.inside(path) from fault
    said = "DewarpData" + ", of photos without distortion" * (texts.get("DewarpFlag") == "1")
    film, millimetres = film_focal_px(path, size)
    if lens and film is not None and not are_alike(lens["fx"], film):
        raise BenchmarkError(
            f"DJI's DewarpData has fx = {lens['fx']:g} px, and the focal length of 35 mm film "
            f"makes {film:g} px in a photo of {size[0]}x{size[1]} px",
            where=path,
            expected="a photo of the size that the drone took it in",
            fix="take the original photos, or give the camera with --camera",
        )
    if not lens and film is not None:
        lens = {"fx": film}
        said = f"the focal length of 35 mm film ({millimetres} mm), without distortion"
    known = [std for std in stds if std is not None]
    std_m = (known[0], known[1], known[2]) if len(known) == 3 else None
    return DjiTags(None if flag is None else int(flag), std_m, lens, said)


def _numbers(texts: Mapping[str, str], name: str, count: int) -> list[float]:
    if not texts.get(name):
        return []
    try:
        values = [float(part) for part in texts[name].split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise BenchmarkError(
            f"DJI's {name} is {texts[name][:60]!r}", expected=f"{count} numbers, as the drone wrote"
        )
    return values


def _dewarp(texts: Mapping[str, str], size: tuple[int, int]) -> dict[str, float]:
    """Read ``date;fx,fy,cx,cy,k1,k2,p1,p2,k3``; cx, cy count from the middle of the photo."""
    stated = {"DewarpData": texts.get("DewarpData", "").rpartition(";")[2]}
    values = _numbers(stated, "DewarpData", len(_DEWARP))
    if not any(values):
        return {}
    lens = dict(zip(_DEWARP, values, strict=True))
    lens["cx"] += size[0] / 2
    lens["cy"] += size[1] / 2
    without = dict.fromkeys(_DEWARP[4:], 0.0) if texts.get("DewarpFlag") == "1" else {}
    return lens | without


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
    names = list(sizes)
    if given is not None:
        of_all = read_camera_file(given)
        lenses = [lens_of(of_all, sizes[name], given) for name in names]
        check_focal_lengths(home, dict.fromkeys(names, of_all), sizes, given)
        return cameras_of_lenses(lenses, names, sizes), [f"cameras are from {given.name}"]
    lacking = [name for name in names if not tags[name].lens]
    if lacking:
        raise CameraError(
            f"photos state no camera: {first_of(lacking, len(names))}",
            where=home,
            expected="DJI's DewarpData, or EXIF FocalLengthIn35mmFilm",
            fix=fix,
        )
    lenses = [lens_of(tags[name].lens, sizes[name], home / name) for name in names]
    said = sorted({tags[name].lens_from for name in names})
    return cameras_of_lenses(lenses, names, sizes), [f"cameras are from {what}" for what in said]


@dataclass(frozen=True)
class TimeStamp:
    """A line of a table of time stamps: where a photo was taken, above the ellipsoid."""

    number: int
    lat: float
    lon: float
    height_m: float
    std_m: tuple[float, float, float]
    flag: int


def read_time_stamps(path: Path) -> list[TimeStamp]:
    """Read a table of time stamps (.MRK), its numbers by their order."""
    stamps: dict[int, TimeStamp] = {}
    for number, line in enumerate(read_native_text(path).splitlines(), 1):
        values = [float(text) for text in _NUMBER.findall(line)]
        if not line.strip():
            continue
        if len(values) != _STAMP_NUMBERS or abs(values[6]) > 90 or int(values[0]) in stamps:
            raise BenchmarkError(
                f"is no time stamp, or the second of its number: {' '.join(line.split())[:120]!r}",
                where=f"{path}, line {number}",
                expected="photo, time, [week], N, E, V (mm), latitude, longitude, height, three "
                "standard deviations, flag; a flight in each folder",
                fix="take the file out of the folder, and positions come from the photos",
            )
        lat, lon, height, north, east, up, flag = values[6:]
        photo = int(values[0])
        stamps[photo] = TimeStamp(photo, lat, lon, height, (east, north, up), int(flag))
    return list(stamps.values())


def photo_time_stamps(
    source: Path, images: Path, metadata: Mapping[str, PhotoPrior]
) -> tuple[dict[str, TimeStamp], list[str]]:
    """Return each photo's time stamp, by its number from the table in its folder, and notes."""
    tables = sorted(p for p in source.rglob("*") if p.name.lower().endswith("timestamp.mrk"))
    found: dict[str, TimeStamp] = {}
    for table in tables:
        by_number = {stamp.number: stamp for stamp in read_time_stamps(table)}
        alone = sum(other.parent == table.parent for other in tables) == 1
        flight = re.sub(r"timestamp\.mrk$", "", table.name, flags=re.IGNORECASE)
        for name in metadata:
            numbers = _PHOTO_NUMBER.findall(PurePosixPath(name).stem)
            ours = (images / name).parent == table.parent
            same = alone or PurePosixPath(name).name.startswith(flight)
            if ours and same and numbers and int(numbers[-1]) in by_number:
                found[name] = by_number[int(numbers[-1])]
    if not tables:
        return {}, []
    own = [n for n, prior in metadata.items() if n in found and prior.lon is not None]
    stated = np.array([(metadata[n].lon, metadata[n].lat) for n in own], np.float64).reshape(-1, 2)
    stamped = np.array([(found[n].lon, found[n].lat) for n in own]).reshape(-1, 2)
    away = geodesic_distance_m(stated, stamped)
    far = [name for name, metres in zip(own, away, strict=True) if metres > _SAME_PLACE_M]
    if far or not found:
        raise BenchmarkError(
            f"time stamps are of other photos: none has their numbers, or they are more than "
            f"{_SAME_PLACE_M:g} m away ({first_of(far, len(own))})",
            where=tables[0],
            expected="the table of these photos, such as DJI_..._0001_V.JPG next to it",
            fix="take the table out of the folder, and positions come from the photos",
        )
    names = first_of([table.name for table in tables], noun="table")
    said = f"positions of {len(found)} of {len(metadata)} photos come from {names} of time stamps"
    return found, [f"{said}, above the ellipsoid"]


def true_positions(
    metadata: Mapping[str, PhotoPrior],
    tags: Mapping[str, DjiTags],
    stamps: Mapping[str, TimeStamp],
    where: Path,
    *,
    fixed_only: bool = True,
) -> tuple[dict[str, PhotoPrior], list[str]]:
    """Return the photos whose position can be truth, and notes on the others.

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
    whole = [name for name in metadata if name in placed and placed[name].is_complete]
    fixed = [name for name in whole if flags[name] in _FIXED]
    chosen = fixed if fixed_only else whole
    if not chosen:
        seen = Counter("no RtkFlag" if f is None else f"RtkFlag {f}" for f in flags.values())
        counts = ", ".join(f"{count} with {what}" for what, count in sorted(seen.items()))
        raise BenchmarkError(
            f"no photo has a fixed RTK position, an altitude and gimbal angles: {counts}",
            where=where,
            expected="photos as the drone wrote them, with EXIF GPS, DJI's XMP and RtkFlag 50",
            fix="give poses or positions from elsewhere (prepare poses, odm, colmap), or --rtk any "
            "if a truth that is metres off will do",
        )
    notes, unfixed = [], [name for name in whole if name not in fixed]
    if unfixed:
        what = "left out" if fixed_only else "taken nevertheless"
        notes.append(f"photos without an RTK fix, {what}: {first_of(unfixed, len(metadata))}")
    lacking = first_of([name for name in metadata if name not in whole], len(metadata))
    if len(whole) < len(metadata):
        what = "time stamp, position" if stamps else "position"
        notes.append(f"photos without {what}, altitude or angles: {lacking}")
    return {name: placed[name] for name in chosen}, notes


DJI = DjiFolders()
