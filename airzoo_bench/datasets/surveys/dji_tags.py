"""What DJI's photos state beyond position and angles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.datasets.photo_metadata import PhotoPrior, read_dji_texts
from airzoo_bench.datasets.surveys.lenses import (
    cameras_of_lenses,
    focal_of_unknown_size,
    lens_of,
    read_camera_file,
)
from airzoo_bench.formats.photos import opened_photo
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import angles_to_rotations, rotation_angle_deg

__all__ = [
    "FIXED",
    "DjiTags",
    "check_focal_lengths",
    "photo_cameras",
    "read_tags",
    "stated_accuracy",
    "turned_note",
]

FIXED = (48, 49, 50)
"""RtkFlag of a fixed solution: 50, or its finer 48 and 49."""
_EXIF_IFD, _FOCAL_35MM = 0x8769, 0xA405
_MOST_RATIO = 1.3  # between two focal lengths of one camera
_DIAGONAL_MM = math.hypot(36.0, 24.0)
_TURNED_DEG = 135.0
_WIDEST, _LONGEST = 0.2, 20.0  # focal lengths in widths of the photo


@dataclass(frozen=True)
class DjiTags:
    """What a photo states.

    Attributes
    ----------
    rtk_flag : int or None
        See `FIXED`; 16 a single point, 34 a float solution.
    std_m : tuple of 3 float, or None
        Standard deviations to the east and north, and of the height.
    lens : dict of str to float
        See `lenses.lens_of`; empty where the photo states none.
    lens_from : str
        What states the lens.
    flight_yaw_deg : float or None
        Where the drone's nose points.
    """

    rtk_flag: int | None
    std_m: tuple[float, float, float] | None
    lens: dict[str, float]
    lens_from: str
    flight_yaw_deg: float | None


def read_tags(path: Path, size: tuple[int, int]) -> DjiTags:
    """Read the quality of a photo's position, and its lens."""
    texts = read_dji_texts(path)
    try:
        flag = _numbers(texts, "RtkFlag", 1)
        stds = [_numbers(texts, f"RtkStd{axis}", 1) for axis in ("Lon", "Lat", "Hgt")]
        flight_yaw = _numbers(texts, "FlightYawDegree", 1)
        lens, lens_from = _dewarp(texts, size)
    except BenchmarkError as fault:
        raise fault.inside(path) from fault
    of_film, film_from = _film(path, size)
    if lens and of_film:
        _check_lens(path, size, lens["fx"], of_film["fx"])
    if not lens:
        lens, lens_from = of_film, film_from
    known = [std[0] for std in stds if std]
    std_m = (known[0], known[1], known[2]) if len(known) == 3 else None
    yaw = flight_yaw[0] if flight_yaw else None
    return DjiTags(int(flag[0]) if flag else None, std_m, lens, lens_from, yaw)


def turned_note(priors: Mapping[str, PhotoPrior], tags: Mapping[str, DjiTags]) -> list[str]:
    """Warn where most photos have gimbal angles that turn them about against the drone's nose."""
    angles = np.array([(p.yaw_deg, p.pitch_deg, p.roll_deg) for p in priors.values()], np.float64)
    yaw, pitch, roll = angles.T
    stated = [tags[name].flight_yaw_deg for name in priors]
    nose = np.array([own if yaw is None else yaw for own, yaw in zip(yaw, stated, strict=True)])
    given = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    level = angles_to_rotations(nose, pitch, np.zeros_like(roll), convergence_deg=0.0)
    turned = rotation_angle_deg(given, level) > _TURNED_DEG
    if turned.mean() <= 0.5:
        return []
    names = [name for name, is_turned in zip(priors, turned, strict=True) if is_turned]
    return [
        f"WARNING: gimbal angles turn cameras by more than {_TURNED_DEG:g} degrees against the "
        f"drone's nose (FlightYawDegree) and a level horizon: {first_of(names, len(priors))}; "
        "where photos were not taken so, GimbalYawDegree or GimbalRollDegree is 180 degrees off, "
        "and so is the truth: give poses from elsewhere (prepare poses, odm, colmap)"
    ]


def _numbers(texts: dict[str, str], name: str, count: int) -> list[float]:
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


def _dewarp(texts: dict[str, str], size: tuple[int, int]) -> tuple[dict[str, float], str]:
    """Read ``date;fx,fy,cx,cy,k1,k2,p1,p2,k3``; cx, cy count from the middle of the photo."""
    if "DewarpData" not in texts:
        return {}, ""
    values = _numbers({"DewarpData": texts["DewarpData"].rpartition(";")[2]}, "DewarpData", 9)
    keys = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    lens = dict(zip(keys, values, strict=True))
    if not any(values):
        return {}, ""
    for key in ("fx", "fy"):
        if not _WIDEST * size[0] < lens[key] < _LONGEST * size[0]:
            raise BenchmarkError(
                f"DJI's DewarpData has {key} = {lens[key]:g} px in a photo {size[0]} px wide",
                expected="the focal length in pixels of the photo",
                fix="give the camera with --camera",
            )
    lens["cx"] += size[0] / 2
    lens["cy"] += size[1] / 2
    if texts.get("DewarpFlag") == "1":
        return lens | dict.fromkeys(keys[4:], 0.0), "DewarpData, of photos without distortion"
    return lens, "DewarpData"


def photo_cameras(
    home: Path,
    sizes: Mapping[str, tuple[int, int]],
    tags: Mapping[str, DjiTags],
    given: Path | None,
    fix: str,
) -> tuple[Cameras, list[str]]:
    """Return cameras: of a file, else as the photos state them; and sentences on what states them.

    Parameters
    ----------
    home : Path
        Folder of the photos.
    sizes : mapping of str to (width, height)
        By the photo's name.
    tags : mapping of str to DjiTags
    given : Path or None
        JSON, see `lenses.read_camera_file`.
    fix : str
        How the file is given, for the message.

    Raises
    ------
    UserError
        A photo states no camera, or the file's is of photos of another size.
    """
    names = list(sizes)
    if given is not None:
        of_all = read_camera_file(given)
        lenses = [lens_of(of_all, sizes[name], given) for name in names]
        focal_px, said = focal_of_unknown_size([of_all] * len(names), names), [given.name]
        checked = [check_focal_lengths(home, focal_px, sizes, given)] if focal_px else []
    else:
        lacking = [name for name in names if not tags[name].lens]
        if lacking:
            raise CameraError(
                f"photos state no camera: {first_of(lacking, len(names))}",
                where=home,
                expected="DJI's DewarpData, or EXIF FocalLengthIn35mmFilm",
                fix=fix,
            )
        lenses = [lens_of(tags[name].lens, sizes[name], home / name) for name in names]
        said, checked = sorted({tags[name].lens_from for name in names}), []
    cameras = cameras_of_lenses(lenses, names, sizes)
    return cameras, [*(f"cameras are from {what}" for what in said), *checked]


def check_focal_lengths(
    images: Path, focal_px: Mapping[str, float], sizes: Mapping[str, tuple[int, int]], where: Path
) -> str:
    """Hold focal lengths in pixels to those of 35 mm film in EXIF; return a note on the size."""
    film = {name: _film(images / name, sizes[name])[0].get("fx") for name in focal_px}
    pairs = {name: (focal_px[name], fx) for name, fx in film.items() if fx is not None}
    off = [name for name, pair in pairs.items() if not _alike(*pair)]
    if off:
        fx, of_film = pairs[off[0]]
        width, height = sizes[off[0]]
        raise CameraError(
            f"fx is {fx:g} px, and the focal length of 35 mm film makes {of_film:g} px in a photo "
            f"of {width}x{height} px: {first_of(off, len(pairs))}",
            where=where,
            expected="the focal length in pixels of photos of this size",
            fix=f'scale fx to the photos; if it is right, give --camera with "width": {width} and '
            f'"height": {height}',
        )
    shown = sorted({f"{width}x{height}" for width, height in map(sizes.__getitem__, focal_px)})
    stated = f"by EXIF in {len(pairs)} of {len(focal_px)}" if pairs else "which no EXIF confirms"
    return f"fx is taken for photos of {first_of(shown, noun='size')} px, {stated}"


def _alike(first: float, second: float) -> bool:
    return 1 / _MOST_RATIO < first / second < _MOST_RATIO


def _check_lens(path: Path, size: tuple[int, int], dewarp: float, film: float) -> None:
    """Refuse DewarpData of a photo that was made smaller afterwards."""
    if not _alike(dewarp, film):
        raise BenchmarkError(
            f"DJI's DewarpData has fx = {dewarp:g} px, and the focal length of 35 mm film makes "
            f"{film:g} px in a photo of {size[0]}x{size[1]} px",
            where=path,
            expected="a photo of the size that the drone took it in",
            fix="take the original photos, or give the camera with --camera",
        )


def _film(path: Path, size: tuple[int, int]) -> tuple[dict[str, float], str]:
    with opened_photo(path) as image:
        focal = image.getexif().get_ifd(_EXIF_IFD).get(_FOCAL_35MM)
    if not isinstance(focal, int) or not 0 < focal < 10_000:
        return {}, ""
    return (
        {"fx": focal / _DIAGONAL_MM * math.hypot(*size)},
        f"the focal length of 35 mm film ({focal} mm), without distortion",
    )


def stated_accuracy(
    stated: Sequence[tuple[float, float, float] | None],
) -> tuple[str, float | None]:
    """Say how good positions are stated to be; in metres of all three axes too, if they are."""
    stds = np.array([std for std in stated if std is not None])
    if not len(stds):
        return "photos do not state how good their positions are", None
    level = np.median(np.hypot(stds[:, 0], stds[:, 1]))
    said = (
        f"positions are stated good to {level:.3f} m in plan and {np.median(stds[:, 2]):.3f} m in "
        f"height (medians of standard deviations of {len(stds)} photos); gimbal angles to no figure"
    )
    # A file of zeros states nothing.
    return said, round(float(np.median(np.linalg.norm(stds, axis=1))), 4) or None
