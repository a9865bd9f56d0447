"""True positions of photos of a DJI drone with RTK, by the best that is there."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import first_of
from airzoo_bench.datasets.photo_metadata import PhotoPrior
from airzoo_bench.datasets.priors import read_prior_file
from airzoo_bench.datasets.surveys.dji_stamps import TimeStamp, read_time_stamps
from airzoo_bench.datasets.surveys.dji_tags import FIXED, DjiTags
from airzoo_bench.geometry.crs import geodesic_distance_m

__all__ = ["TruePositions", "true_positions"]

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
    """Return true positions: those of a file, else of RTK tables, else of the photos themselves."""
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
