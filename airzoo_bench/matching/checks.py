"""Mistakes that users cannot see: a check raises an error, or returns a doubt that becomes a note.

Poses are compared with the photos' own GPS positions and gimbal angles; where the true poses are
known, matches and heights are compared with these.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, agreeing, counted, first_of
from airzoo_bench.core.ids import check_ids
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.poses import (
    Poses,
    matrix_to_quaternion,
    quaternion_to_matrix,
    rotation_angle_deg,
    world_to_camera,
)
from airzoo_bench.geometry.precision import COARSEST_M, centre_errors_m
from airzoo_bench.matching.lifting import lift
from airzoo_bench.matching.predictions import (
    Correspondences,
    GivenPoses,
    MatchingPredictions,
    ScenePredictions,
)
from airzoo_bench.matching.settings import MatchingScores
from airzoo_bench.matching.truth import MatchingTruth

NEAR_M, NEAR_DEG = 0.05, 0.1
"""An answer this near to its prior counts as the prior, however it was written or solved."""

_SLACK_PX = 1.0  # sub-pixel refinement oversteps a picture's border
_LEAST_PHOTOS = 5  # that a doubt needs
_FEET = (1.0, 1.0, 0.3048)
_OPENGL = np.diag((1.0, -1.0, -1.0))  # from x right, y down, z forward to y up, z backward, or back


def check_file(predictions: MatchingPredictions, finest_m: float | None) -> None:
    """Refuse what is wrong whatever the truth; `finest_m` is None where truth decides on digits."""
    content, ids = predictions.content, predictions.query_ids
    try:
        check_ids(ids, "field 'query_ids'")
        if isinstance(content, Correspondences):
            _check_offsets(content, ids)
            _check_finite(content, ids)
        elif finest_m is not None:
            _check_digits(content, ids, _coarsest_m(content, finest_m))
    except PredictionError as error:
        raise error.inside(predictions.path) from None


def open_scene(
    predictions: MatchingPredictions, truth: MatchingTruth, rows: Ints, scores: MatchingScores
) -> ScenePredictions:
    """Return the rows (Q,) for the queries of a scene, -1 for none, in pixels of the map."""
    content = predictions.content.take(rows)
    if isinstance(content, GivenPoses):
        doubts = _check_poses(content, truth, scores.finest_m)
    else:
        if content.map_xy is not None and content.map_frame == "crop":
            content = replace(content, map_xy=content.map_xy + truth.crops[content.query, :2])
        doubts = _check_matches(content, truth, np.flatnonzero(rows >= 0))
    notes = tuple(f"scene {truth.scene}: {doubt}" for doubt in doubts if doubt)
    return ScenePredictions(rows >= 0, content, notes)


def _check_matches(
    content: Correspondences, truth: MatchingTruth, answered: Ints
) -> Iterator[str | None]:
    _check_image_size(content, truth, answered)
    _check_photo_pixels(content, truth)
    yield _check_map_pixels(content, truth)
    yield _doubt_image_size(content, truth)
    if content.points3d is not None:
        _check_degrees(content.points3d, truth, "field 'points3d'")
        yield _doubt_crs(content.points3d, truth.priors.centres[content.query], "point", 10_000.0)
    if truth.has_poses:
        yield _check_points(content, truth)


def _check_poses(
    content: GivenPoses, truth: MatchingTruth, finest_m: float
) -> Iterator[str | None]:
    given, priors = content.poses.take(content.found), truth.priors.take(content.found)
    true = truth.poses.centres if truth.has_poses else truth.priors.centres
    _check_degrees(given.centres, truth, "the poses")
    _check_camera_to_world(given, priors)
    _check_axes(given.rotation, priors.rotation, quaternions=content.quaternions)
    # After the convention, which decides the digits that count. Centres of a made-up scene may
    # lie on a lattice themselves.
    meant = float(centre_errors_m(true).max(initial=0.0)) if content.centred else 0.0
    ids = truth.queries["id"].to_numpy(str)
    _check_digits(content, ids, max(meant, _coarsest_m(content, finest_m)))
    yield _doubt_lattice(content, max(meant, COARSEST_M))
    yield _doubt_crs(given.centres, priors.centres, "pose", 1_000.0)
    yield _doubt_copies(given, priors)
    if truth.has_poses:
        yield _check_heights(given.centres, true[content.found])


# --- matches ---


def _check_offsets(content: Correspondences, query_ids: NDArray[np.str_]) -> None:
    offsets, rows, count = content.offsets, len(content.query_xy), len(query_ids)
    # Compared, not subtracted: the difference of two large integers may wrap around.
    falling = np.flatnonzero(offsets[1:] < offsets[:-1])
    if len(offsets) != count + 1 or falling.size or offsets[0] != 0 or offsets[-1] != rows:
        said = f"they are {len(offsets):,} for {counted(count, 'query')}"
        if len(offsets) == count + 1:
            said = f"from {offsets[0]} to {offsets[-1]}"
            said += f", falling first at query {query_ids[falling[0]]}" if falling.size else ""
        raise PredictionError(
            f"the offsets do not add up: {said}",
            where="field 'offsets'",
            expected=f"{count + 1:,} numbers that rise from 0 to {rows}, the rows of query_xy",
            fix="np.concatenate([[0], np.cumsum(number of matches of each query)])",
        )


def _check_finite(content: Correspondences, query_ids: NDArray[np.str_]) -> None:
    for name in ("query_xy", "map_xy", "points3d"):
        values = getattr(content, name)
        if values is None or np.isfinite(values).all():
            continue
        bad = ~np.isfinite(values).all(axis=1)
        raise PredictionError(
            f"{counted(int(bad.sum()), 'row is', 'rows are')} NaN or infinite, in "
            f"{first_of(query_ids[np.unique(content.query[bad])], len(query_ids), noun='query')}",
            where=f"field '{name}'",
            expected="finite coordinates",
            fix="leave out what was not matched",
        )


def _check_image_size(content: Correspondences, truth: MatchingTruth, answered: Ints) -> None:
    """Refuse pixels that are stated to belong to images of another size than the photos'."""
    if content.image_size is None:
        return
    true, stated = _photo_sizes(truth)[answered], content.image_size[answered]
    bad = np.flatnonzero((stated != true).any(axis=1))
    if bad.size:
        fix = "multiply x and y by the ratio of the widths and of the heights"
        if (stated[bad] == true[bad, ::-1]).all():
            fix = "write x, the column, before y, and width before height"
        raise PredictionError(
            f"matches in another image size than the query's: {_name(truth, answered[bad])}; the "
            f"first is {_sides(true[bad[0]])} px, its matches are for {_sides(stated[bad[0]])}",
            where="field 'image_size'",
            fix=fix,
        )


def _check_photo_pixels(content: Correspondences, truth: MatchingTruth) -> None:
    size = _photo_sizes(truth)[content.query]
    fix = "scale them from the size that the method worked in"
    if _inside(content.query_xy[:, ::-1], size).all():
        fix = "write x, the column, before y: the other way round all lie inside"
    _refuse_outside(
        *(content.query_xy, size, content.query, truth, "photo"),
        where="field 'query_xy'",
        expected="pixels of the photo at its full size, the corner being (0, 0)",
        fix=fix,
    )


def _check_map_pixels(content: Correspondences, truth: MatchingTruth) -> str | None:
    """Refuse pixels of the map that lie in the crops only when x and y or the frame change.

    A file that states that they are the map's is believed.
    """
    if content.map_xy is None or not len(content.map_xy):
        return None
    corner, size = np.split(truth.crops[content.query], 2, axis=1)
    if content.map_frame == "crop":
        _refuse_outside(
            *(content.map_xy - corner, size, content.query, truth, "crop"),
            where="field 'map_xy'",
            expected="pixels of the query's crop, the corner being (0, 0)",
            fix="say map_frame='map' if they are pixels of the whole map; crops.csv has the crops",
        )
    as_map = _inside(content.map_xy - corner, size).mean()
    if as_map > 0.8:
        return None
    fix = "say map_frame='crop', or map_frame='map' if they are pixels of the map all the same"
    readings = (
        ("rows before columns", content.map_xy[:, ::-1] - corner, "write x, the column, before y"),
        ("pixels of the crop", content.map_xy, fix),
    )
    for reading, local, fix in readings:
        share = _inside(local, size).mean()
        if share < 0.98:
            continue
        said = f"the map pixels look like {reading}: read so, {share:.0%} lie in their crops"
        if content.map_frame == "map" and local is content.map_xy:
            return said
        raise PredictionError(
            f"{said}; as pixels (x, y) of the whole map, {as_map:.0%}",
            where="field 'map_xy'",
            expected="pixels (x, y) of the whole map, or of the crop with map_frame='crop'",
            fix=fix,
        )
    return None


def _doubt_image_size(content: Correspondences, truth: MatchingTruth) -> str | None:
    """Doubt pixels that all lie in a corner of the photos, if there are enough of them."""
    count = len(content.query_xy)
    if count < 100:
        return None
    reach = (content.query_xy / _photo_sizes(truth)[content.query]).max(axis=0)
    if (reach >= (0.6 if count < 2000 else 0.9)).any():
        return None
    return (
        f"no match lies beyond {reach[0]:.0%} of the photos' width and {reach[1]:.0%} of their "
        "height: are the matches in the size of a smaller image?"
    )


def _check_points(content: Correspondences, truth: MatchingTruth) -> str | None:
    """Judge by the true poses whether x and y are exchanged, or heights of points are in feet."""
    diagonal = float(np.hypot(*_photo_sizes(truth).T).max(initial=0.0))
    off, clear = _misfit_px(content, truth, diagonal, otherwise=False), 0.05 * diagonal
    left = _misfit_px(content, truth, diagonal, otherwise=True) if off > clear else off
    if content.map_xy is None:
        return _judge("heights in feet", "field 'points3d'", off, left, clear, "px")
    return _judge("x and y exchanged", "field 'map_xy'", off, left, clear, "px")


def _misfit_px(
    content: Correspondences, truth: MatchingTruth, diagonal: float, *, otherwise: bool
) -> float:
    """Return how far some matches lie from where the true poses see them, read in one of two ways.

    What no camera sees is as far away as can be.
    """
    parts = [(query, part) for query, part in enumerate(content.parts()) if part.stop > part.start]
    off = []
    for query, part in parts[:: -(-len(parts) // 10) or 1]:
        rows = np.linspace(part.start, part.stop - 1, 40).astype(int)
        if content.points3d is not None:
            points = content.points3d[rows] * (_FEET if otherwise else 1.0)
        else:
            assert content.map_xy is not None
            corner, reference = truth.crops[query, :2], truth.map_of(query)
            xy = corner + (content.map_xy[rows] - corner)[:, :: -1 if otherwise else 1]
            points = lift(xy, reference.dom, reference.dsm, jobs=1).points
        seen = world_to_camera(truth.poses.take([query]), points[None])
        pixels = project(truth.cameras.take([query]), seen)[0]
        off.append(np.linalg.norm(pixels - content.query_xy[rows], axis=1))
    return float(np.median(np.fmin(np.concatenate(off), diagonal))) if off else 0.0


# --- poses ---


def _check_degrees(coordinates: Floats, truth: MatchingTruth, where: str) -> None:
    """Refuse longitudes and latitudes where the scene's coordinates are metres."""
    are_degrees = len(coordinates) and (np.abs(coordinates[:, :2]) <= (180.0, 90.0)).all()
    if are_degrees and np.abs(truth.priors.centres[:, :2]).min() > 1000.0:
        x, y = coordinates[0, :2]
        raise PredictionError(
            f"looks like degrees: the first lies at ({x:.5f}, {y:.5f})",
            where=where,
            expected="metres, in the scene's projected CRS",
            fix="convert longitude and latitude to the CRS that benchmark.toml states",
        )


def _check_camera_to_world(given: Poses, priors: Poses) -> None:
    """Refuse poses if most translations lie ten times nearer to GPS than the centres do."""
    as_given, inverted = (
        _distance(places, priors.centres) for places in (given.centres, given.translation)
    )
    if not len(given) or np.mean(inverted * 10.0 < as_given) <= 0.5:
        return
    fix, back = "invert them: R.T and -R.T @ t", np.swapaxes(given.rotation, 1, 2)
    if _angle(given.rotation, priors.rotation) < _angle(back, priors.rotation):
        fix = "the rotations are right and the last column is the centre: t = -R @ centre"
    raise PredictionError(
        f"the poses look camera-to-world: taken so, cameras lie {np.median(inverted):.1f} m "
        f"from their GPS positions; as world-to-camera, {np.median(as_given):.1f} m",
        where="field 'poses'",
        expected="world-to-camera, x_cam = R X + t, in the scene's CRS",
        fix=fix,
    )


def _check_axes(given: Floats, priors: Floats, *, quaternions: bool) -> None:
    """Refuse rotations far from the gimbal's that another reading brings near, by a factor of 3.

    If cameras look down, a rotation and its inverse differ by little more than the tilt. Yaw may be
    wrong by 180 degrees in a few photos, which does not move medians. Quarter turns, such as those
    of a map's tile, are no reading of a camera's.
    """
    if not len(given) or np.isin(np.abs(np.round(given, 12)), (0.0, 1.0)).all():
        return
    off = _angle(given, priors)
    readings = _read_otherwise(given, quaternions=quaternions)
    errors = {name: _angle(rotation, priors) for name, rotation in readings.items()}
    fitting = [name for name, left in errors.items() if left < 20.0 < off and left * 3.0 < off]
    # Of cameras that look down and north, OpenGL's matrices fit that order of quaternions too.
    likely = [name for name in fitting if quaternions or "x y z w" not in name] or fitting
    if likely:
        best = min(likely, key=errors.__getitem__)
        hint = "; OpenGL's w2c becomes diag(1, -1, -1) @ R" if "OpenGL" in best else ""
        raise PredictionError(
            f"the rotations look like {best}: they differ from the IMU's by {off:.0f} degrees, "
            f"read so by {errors[best]:.0f}",
            where="the poses",
            expected="world-to-camera rotations, x_cam = R X + t, camera axes x right, y down, "
            "z forward, quaternions as w x y z",
            fix=f"convert them before you write the file{hint}",
        )


def _read_otherwise(given: Floats, *, quaternions: bool) -> dict[str, Floats]:
    """Return rotations (N, 3, 3) as they would be if they had been written in another way."""
    back, order = np.swapaxes(given, 1, 2), "quaternions in the order x y z w"
    axes = "OpenGL's camera axes (x right, y up, z backward)"
    reordered = quaternion_to_matrix(np.roll(matrix_to_quaternion(given), 1, axis=1))
    readings = {
        "camera-to-world": back,
        f"those of {axes}": _OPENGL @ given,
        f"camera-to-world with {axes}": _OPENGL @ back,
        order if quaternions else f"matrices made of {order}": reordered,
    }
    if quaternions:  # of camera-to-world ones, as TUM has them and CUT3R has not
        first = quaternion_to_matrix(np.roll(matrix_to_quaternion(back), -1, axis=1))
        readings["quaternions in the order w x y z"] = np.swapaxes(first, 1, 2)
    return readings


def _coarsest_m(given: GivenPoses, finest_m: float) -> float:
    """Return how far the digits of a file may move cameras: a centimetre.

    Of centres that are given, half of the finest threshold: whole metres lose 0.5 m, which passes
    beside 1 m; six digits lose 2.9 m of a northing, which does not beside 5 m.
    """
    return max(COARSEST_M, 0.55 * finest_m) if given.centred else COARSEST_M


def _check_digits(given: GivenPoses, query_ids: NDArray[np.str_], limit: float) -> None:
    coarse = np.flatnonzero(given.errors_m > limit)
    if coarse.size:
        what, hint = "centres", ""
        if not given.centred:
            what, hint = "poses", ", or write an .npz with rotations and centres"
        raise PredictionError(
            f"too few digits in the {what} of "
            f"{first_of(query_ids[coarse], len(query_ids), noun='query')}: what they leave out "
            f"moves a camera by {np.sqrt((given.errors_m[coarse] ** 2).mean()):.2g} m on average",
            where=f"field '{what}'",
            expected=f"digits that fix camera centres to {limit:g} m",
            fix=f"compute in float64 and write all digits (%.17g in text){hint}",
        )


def _doubt_lattice(given: GivenPoses, limit: float) -> str | None:
    lost = float(given.errors_m.max(initial=0.0))
    if not given.centred or lost <= limit:
        return None
    return (
        "centres lie on a lattice, such as whole metres: if they were rounded to it, they are "
        f"{lost:.2g} m off on average"
    )


def _check_heights(centres: Floats, true: Floats) -> str | None:
    """Judge whether heights are in feet; doubt them if all are alike above or below the truth."""
    if len(centres) < _LEAST_PHOTOS:
        return None
    with np.errstate(over="ignore"):
        in_feet = centres * _FEET
        shift = np.median(centres[:, 2] - true[:, 2])
    readings = (centres, in_feet, centres - (0.0, 0.0, shift))
    off, left, moved = (float(np.median(_distance(reading, true))) for reading in readings)
    if feet := _judge("heights in feet", "the poses", off, left, 20.0, "m"):
        return feet
    if abs(shift) < 5.0 or moved > 1.0:
        return None
    return f"heights of another vertical datum? They lie {shift:+.1f} m from the true ones (median)"


def _judge(what: str, where: str, off: float, left: float, clear: float, unit: str) -> str | None:
    """Refuse a clear misfit if another reading leaves a tenth of it, doubt it if a half."""
    said = f"they are {off:.4g} {unit} off as they stand, {left:.4g} {unit} read so (medians)"
    if off > clear and left < 0.1 * off:
        raise PredictionError(
            f"looks like {what}: {said}",
            where=where,
            expected="metres, and pixels as x, the column, before y",
            fix="convert them before you write the file",
        )
    return f"{what}? {said}" if off > clear and left < 0.5 * off else None


def _doubt_crs(places: Floats, gps: Floats, noun: str, limit: float) -> str | None:
    """Doubt places that lie beyond any error of GPS, and any view."""
    far = int((_distance(places, gps) > limit).sum())
    lying = f"{far:,} of {counted(len(places), noun)} {agreeing(far, 'lies', 'lie')}"
    doubt = f"more than {limit:,g} m from the photo's GPS position"
    return f"{lying} {doubt}: are all coordinates in the scene's CRS?" if far else None


def _doubt_copies(given: Poses, priors: Poses) -> str | None:
    near = count_near(given, priors, NEAR_M, NEAR_DEG)
    what = f"{near:,} of {counted(len(given), 'answer')} {agreeing(near, 'equals', 'equal')}"
    return f"{what} the prior, the photo's own GPS and gimbal angles" if near else None


def count_near(poses: Poses, priors: Poses, metres: float, degrees: float) -> int:
    """Count the poses, NaN where there is none, that lie as near to their priors as that."""
    turned = rotation_angle_deg(poses.rotation, priors.rotation)
    return int(((_distance(poses.centres, priors.centres) < metres) & (turned < degrees)).sum())


# --- what several checks need ---


def _distance(one: Floats, other: Floats) -> Floats:
    with np.errstate(over="ignore"):
        distance: Floats = np.linalg.norm(one - other, axis=1)
    return distance


def _angle(one: Floats, other: Floats) -> float:
    return float(np.median(rotation_angle_deg(one, other)))


def _photo_sizes(truth: MatchingTruth) -> Ints:
    cameras = truth.cameras
    return np.stack([cameras.width, cameras.height], axis=1)


def _inside(xy: Floats, size: Ints) -> Bools:
    return np.asarray(((xy >= -_SLACK_PX) & (xy <= size + _SLACK_PX)).all(axis=1))


def _refuse_outside(
    xy: Floats, size: Ints, query: Ints, truth: MatchingTruth, picture: str, **error: str
) -> None:
    """Refuse pixels (M, 2) outside the picture of their query, of these sizes (M, 2)."""
    outside = ~_inside(xy, size)
    if outside.any():
        x, y = xy[outside][0]
        raise PredictionError(
            f"{counted(int(outside.sum()), 'pixel')} outside the {picture}, in "
            f"{_name(truth, np.unique(query[outside]))}; the first is ({x:.1f}, {y:.1f}) in a "
            f"{picture} of {_sides(size[outside][0])} px",
            **error,
        )


def _sides(size: Ints) -> str:
    return f"{size[0]}x{size[1]}"


def _name(truth: MatchingTruth, rows: Ints) -> str:
    return first_of(truth.queries["id"].iloc[rows], len(truth.queries), noun="query")
