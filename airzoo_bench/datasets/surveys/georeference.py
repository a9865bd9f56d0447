"""Bringing a model of its own frame to a projected CRS by a similarity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import BenchmarkError, UsageError, counted, first_of
from airzoo_bench.datasets.native_text import read_native_text
from airzoo_bench.datasets.photo_metadata import read_prior
from airzoo_bench.datasets.posed_photos import PosedPhotos
from airzoo_bench.datasets.similarity_file import read_matrix, similarity_of
from airzoo_bench.datasets.surveys.crs import map_crs, stated_crs
from airzoo_bench.datasets.surveys.names import match_names
from airzoo_bench.datasets.surveys.options import ColmapOptions
from airzoo_bench.datasets.surveys.survey import given
from airzoo_bench.geometry.crs import from_lonlat
from airzoo_bench.reconstruction.alignment.camera_sets import PosedCameras, RansacSettings
from airzoo_bench.reconstruction.alignment.cameras import Alignment, Residuals, align
from airzoo_bench.reconstruction.alignment.similarity import AlignmentError, Similarity

__all__ = ["PlacedPhotos", "georeferenced"]

_LEAST_AGREEING = 0.5
_LEAST_POSITIONS = 4  # three are always met


@dataclass(frozen=True, eq=False)
class PlacedPhotos:
    """Photos in a projected CRS, and how they came there.

    Attributes
    ----------
    photos : PosedPhotos
    notes : tuple of str
    accuracy_m : float or None
        What remains between the model and the positions that placed it (root mean square).
    """

    photos: PosedPhotos
    notes: tuple[str, ...] = ()
    accuracy_m: float | None = None


def georeferenced(options: ColmapOptions, photos: PosedPhotos) -> PlacedPhotos:
    """Bring the photos to a projected CRS."""
    if options.georeference is not None and options.from_exif:
        raise UsageError("--georeference and --from-exif exclude each other")
    stated = stated_crs(options)
    if options.georeference is None and not options.from_exif:
        if stated is None:
            raise UsageError(
                "where the model is, is not known",
                where=options.source,
                fix="give --from-exif, or --georeference FILE, or --crs if the model is in it",
            )
        return PlacedPhotos(replace(photos, crs=stated.to_string()))
    crs = map_crs(options) if stated is None else stated
    if options.georeference is None:
        transform, notes, left = _fitted(options, photos, _exif_positions(options, photos, crs))
    else:
        matrix = read_matrix(options.georeference)
        if matrix is not None:
            transform, notes, left = similarity_of(matrix, options.georeference), (), None
        else:
            positions = _named_positions(options.georeference, photos.names)
            transform, notes, left = _fitted(options, photos, positions)
    placed = replace(photos, poses=transform.apply_poses(photos.poses), crs=crs.to_string())
    return PlacedPhotos(placed, notes, left)


def _exif_positions(
    options: ColmapOptions, photos: PosedPhotos, crs: CRS
) -> dict[str, tuple[float, ...]]:
    images = given(options.images, "images")
    found = {name: read_prior(images / name) for name in photos.names}
    whole = {n: p for n, p in found.items() if p.lon is not None and p.altitude_m is not None}
    if not whole:
        raise BenchmarkError("no photo has a GPS position", where=images)
    places = np.array([(p.lon, p.lat, p.altitude_m) for p in whole.values()], dtype=np.float64)
    places[:, :2] = from_lonlat(crs, places[:, :2])
    return dict(zip(whole, map(tuple, places.tolist()), strict=True))


def _named_positions(path: Path, names: tuple[str, ...]) -> dict[str, tuple[float, ...]]:
    """Read lines of name, x, y, z, as COLMAP's model_aligner takes them."""
    rows: dict[str, tuple[float, ...]] = {}
    lines = (line.strip() for line in read_native_text(path).splitlines())
    for line in (line for line in lines if line and not line.startswith("#")):
        name, *numbers = line.replace(",", " ").rsplit(None, 3)
        try:
            place = tuple(float(number) for number in numbers)
        except ValueError:
            place = ()
        if len(place) != 3 or not np.isfinite(place).all() or name in rows:
            raise BenchmarkError(
                f"holds the line {line[:60]!r}" + " of a name that it had before" * (name in rows),
                where=path,
                expected="a 4 x 4 matrix, or lines of name, x, y, z, each name once",
            )
        rows[name] = place
    meant = match_names(rows, names, path)
    return {photo: rows[name] for name, photo in meant.items()}


def _fitted(
    options: ColmapOptions, photos: PosedPhotos, positions: dict[str, tuple[float, ...]]
) -> tuple[Similarity, tuple[str, ...], float | None]:
    where = options.georeference or options.images
    limit = options.inlier_m
    ransac = RansacSettings(
        min_trials=1000,
        max_trials=100_000,
        confidence=0.9999,
        sample_share=None,
        inlier_limit=limit,
        inlier_limit_deg=10.0,
        line_ratio=0.1,
        seed=0,
    )
    if len(positions) < _LEAST_POSITIONS:
        raise BenchmarkError(
            f"there are {counted(len(positions), 'position')} for a model",
            where=where,
            expected=f"at least {_LEAST_POSITIONS}, so that one can be held against the others",
        )
    model = PosedCameras(photos.names, photos.poses.centres, photos.poses.rotation)
    truth = PosedCameras(tuple(positions), np.array(list(positions.values())))
    try:
        found = align("sim3", model, truth, ransac)
    except AlignmentError as error:
        raise BenchmarkError(
            f"positions do not place the model: {error.what}",
            where=where,
            expected="positions that span an area",
            fix="give the similarity (--georeference with a 4 x 4 matrix)",
        ) from error
    left = found.inlier_centres
    if left is None or not found.robust or found.inliers < _LEAST_AGREEING * found.cameras:
        raise BenchmarkError(
            f"{found.inliers} of {counted(found.cameras, 'position')} agree with the model to "
            f"{limit:g} m",
            where=where,
            expected="at least half",
            fix="look at the positions, or give a larger --inlier-m",
        )
    notes = _residual_notes(found, left, positions)
    return found.transform, notes, round(left.rms, 4) or None


def _residual_notes(
    found: Alignment, left: Residuals, positions: dict[str, tuple[float, ...]]
) -> tuple[str, ...]:
    notes = [
        f"a similarity of scale {found.transform.scale:.6g} places the model by {found.inliers} "
        f"of {counted(found.cameras, 'position')}: {left.rms:.3f} m remain (root mean square), "
        f"{left.largest:.3f} m at most; no truth is better than these positions"
    ]
    out = [name for name in positions if name not in found.inlier_names]
    if out:
        notes.append(f"positions that do not fit: {first_of(out, len(positions))}")
    return tuple(notes)
