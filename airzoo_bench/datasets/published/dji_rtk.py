"""True positions and cameras of photos of a DJI drone with RTK, by the best that is there."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import CameraError, first_of
from airzoo_bench.datasets.photo_metadata import PhotoPrior
from airzoo_bench.datasets.priors import read_prior_file
from airzoo_bench.datasets.surveys.dji_stamps import TimeStamp, read_time_stamps
from airzoo_bench.datasets.surveys.dji_tags import FIXED, DjiTags
from airzoo_bench.datasets.surveys.lenses import lens_of, read_camera_file
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.frames import geodesic_distance_m

__all__ = ["TruePositions", "stated_cameras", "true_positions"]

_PHOTO_NUMBER = re.compile(r"_(\d{4})(?:_[A-Z])?$")
_SAME_PLACE_M = 100.0  # of a table's position and the photo's own


@dataclass(frozen=True)
class TruePositions:
    """Where photos were taken.

    Attributes
    ----------
    positions : mapping of str to PhotoPrior
        True position and the gimbal's angles, by the photo's name.
    said : str
        Where they are from, a sentence for the user.
    path : Path or None
        Their file.
    """

    positions: Mapping[str, PhotoPrior]
    said: str
    path: Path | None = None


def true_positions(
    metadata: Mapping[str, PhotoPrior],
    tags: Mapping[str, DjiTags],
    tables: Sequence[Path],
    given: Path | None,
) -> TruePositions:
    """Return true positions: those of a file, else of RTK tables, else of the photos themselves.

    Tables count where they have a fixed solution for every photo, told by the number in its name;
    of the photos' own positions those that say that they are fixed RTK. Sources are not mixed.

    Parameters
    ----------
    metadata : mapping of str to PhotoPrior
        By the photos' names.
    tags : mapping of str to DjiTags
    tables : sequence of Path
        DJI's time stamps (.MRK).
    given : Path or None
        A CSV, see `priors.read_prior_file`.

    Raises
    ------
    BenchmarkError
        A file is damaged.
    """
    if given is not None:
        rows = read_prior_file(given, metadata)
        found = {name: replace(metadata[name], **values) for name, values in rows.items()}
        return _complete(found, f"true positions are those of {given.name}", given)
    by_table, why = _of_tables(metadata, tables)
    if by_table:
        names = first_of([table.name for table in tables], noun="table")
        said = f"true positions are the fixed RTK solutions of {names}"
        return _complete(by_table, said, tables[0])
    own = {name: prior for name, prior in metadata.items() if tags[name].rtk_flag in FIXED}
    said = f"true positions are those of the metadata of {len(own)} of {len(metadata)} photos, "
    return _complete(own, f"{said}fixed RTK by their RtkFlag{why}")


def _complete(
    found: Mapping[str, PhotoPrior], said: str, path: Path | None = None
) -> TruePositions:
    whole = {name: prior for name, prior in found.items() if prior.is_complete}
    return TruePositions(whole, f"{said}; orientations are the gimbal's, and not trusted", path)


def _of_tables(
    metadata: Mapping[str, PhotoPrior], tables: Sequence[Path]
) -> tuple[dict[str, PhotoPrior], str]:
    """Return positions where tables have one for every photo, else why they are not used."""
    if not tables:
        return {}, ""
    stamps = [stamp for table in tables for stamp in read_time_stamps(table)]
    found: dict[str, PhotoPrior] = {}
    for name, prior in metadata.items():
        match = _PHOTO_NUMBER.search(Path(name).stem)
        number = int(match[1]) if match is not None else None
        fitting = [one for one in stamps if one.number == number and _near(one, prior)]
        if len(fitting) == 1 and fitting[0].flag in FIXED:
            (one,) = fitting
            found[name] = replace(prior, lon=one.lon, lat=one.lat, altitude_m=one.height_m)
    if len(found) == len(metadata):
        return found, ""
    lacking = [name for name in metadata if name not in found]
    named = first_of([table.name for table in tables])
    return {}, (
        f" ({named} not used: no single fixed solution within {_SAME_PLACE_M:g} m of "
        f"{first_of(lacking, len(metadata))})"
    )


def _near(stamp: TimeStamp, prior: PhotoPrior) -> bool:
    if prior.lon is None or prior.lat is None:
        return True
    places = np.array(((stamp.lon, stamp.lat), (prior.lon, prior.lat)))
    return float(geodesic_distance_m(places[:1], places[1:])[0]) < _SAME_PLACE_M


def stated_cameras(
    home: Path,
    sizes: Mapping[str, tuple[int, int]],
    tags: Mapping[str, DjiTags],
    given: Path | None,
    scene: str,
) -> tuple[Cameras, tuple[str, ...]]:
    """Return cameras: of a file, else as the photos state them; and what states them.

    Parameters
    ----------
    home : Path
    sizes : mapping of str to (width, height)
        By the photo's name.
    tags : mapping of str to DjiTags
    given : Path or None
        JSON, see `surveys.lenses.read_camera_file`.
    scene : str
        For messages.

    Raises
    ------
    UserError
        A photo states no camera.
    """
    lacking = [name for name in sizes if given is None and not tags[name].lens]
    if lacking:
        raise CameraError(
            f"photos state no camera: {first_of(lacking, len(sizes))}",
            where=home,
            expected="DJI's DewarpData, or EXIF FocalLengthIn35mmFilm",
            fix=f"--camera {scene}=FILE, JSON with fx (px), or focal_mm and sensor_mm, or fov_deg",
        )
    of_all = None if given is None else read_camera_file(given)
    lenses = [
        lens_of(tags[name].lens if of_all is None else of_all, size, given or home / name)
        for name, size in sizes.items()
    ]
    matrices, distortion = (np.array([lens[part] for lens in lenses]) for part in (0, 1))
    width, height = np.array(list(sizes.values())).T
    cameras = Cameras.from_matrices(matrices, width, height, distortion, names=list(sizes))
    stating = {given.name} if given is not None else {tags[name].lens_from for name in sizes}
    return cameras, tuple(f"cameras are from {what}" for what in sorted(stating))
