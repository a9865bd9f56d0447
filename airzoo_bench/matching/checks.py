"""Mistakes that users cannot see: a check raises an error, or returns a doubt that becomes a note.

Poses are compared with the photos' own GPS positions and gimbal angles; where the true poses are
known, matches and heights are compared with these.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from airzoo_bench.core.errors import PredictionError, counted, first_of
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
from airzoo_bench.matching.predictions import Correspondences, GivenPoses, MatchingPredictions
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.matching.truth import MatchingTruth

NEAR_M, NEAR_DEG = 0.05, 0.1
"""An answer this near to its prior counts as the prior, however it was written or solved."""

_SLACK_PX = 1.0  # sub-pixel refinement oversteps a picture's border
_LEAST_PHOTOS = 5  # that a doubt about heights needs
_FEET = (1.0, 1.0, 0.3048)
_OPENGL = np.diag((1.0, -1.0, -1.0))  # from x right, y down, z forward to y up, z backward, or back
_CONVENTIONS = (
    "pixels (x, y) of the photo at its full size and of the whole map (of the crop with map_frame="
    "'crop'), corners being (0, 0); metres in the scene's CRS; world-to-camera poses, x_cam = R X "
    "+ t, camera axes x right, y down, z forward, quaternions w x y z"
)
_X_FIRST = "write x, the column, before y"


@dataclass(frozen=True, eq=False)
class ScenePart:
    """The predictions for the Q queries of a scene, in their order, in pixels of the whole map."""

    answered: Bools  # (Q,), which queries the file has
    content: Correspondences | GivenPoses
    notes: tuple[str, ...]  # on what looks wrong


def open_scene(
    predictions: MatchingPredictions, truth: MatchingTruth, rows: Ints, protocol: MatchingProtocol
) -> ScenePart:
    """Return the rows (Q,) for the queries of a scene, -1 for none, in pixels of the map."""
    content, answered = predictions.content.take(rows), rows >= 0
    if isinstance(content, GivenPoses):
        doubts = _check_poses(content, truth, protocol)
    else:
        if content.map_xy is not None and content.map_frame == "crop":
            content = replace(content, map_xy=content.map_xy + truth.crops[content.query, :2])
        doubts = _check_matches(content, truth, answered)
    notes = tuple(f"scene {truth.scene}: {doubt}" for doubt in doubts if doubt)
    return ScenePart(answered, content, notes)


def _check_matches(
    content: Correspondences, truth: MatchingTruth, answered: Bools
) -> Iterator[str | None]:
    sizes = np.stack([truth.cameras.width, truth.cameras.height], axis=1)
    stated = sizes if content.image_size is None else content.image_size
    other = np.flatnonzero(answered & (stated != sizes).any(axis=1))
    if other.size:
        what = f"another image size than that of {_name(truth, other)}: "
        what += f"{_sides(stated[other[0]])}, the first is {_sides(sizes[other[0]])}"
        raise _fault(what, "image_size", "write width before height; scale x and y by their ratio")
    of_match = sizes[content.query]
    exchanged = _inside(content.query_xy[:, ::-1], of_match).all()
    fix = f"{_X_FIRST}: the other way round all lie inside" if exchanged else "scale them to it"
    _refuse_outside("query_xy", content.query_xy, of_match, content, truth, fix)
    _check_map_pixels(content, truth)
    far, shares = 0.6 if len(of_match) < 2000 else 0.9, content.query_xy / of_match
    if len(of_match) >= 100 and (shares < far).all():
        said = f"no match lies beyond {far:.0%} of the photos' width and height"
        yield f"{said}: are the matches in the size of a smaller image?"
    if content.points3d is not None:
        _check_degrees(content.points3d, truth, "points3d")
        yield _doubt_crs(content.points3d, truth.priors.centres[content.query], "point", 10_000.0)
    if truth.has_poses:
        _check_points(content, truth, float(np.hypot(*sizes.T).max(initial=0.0)))


def _check_poses(
    content: GivenPoses, truth: MatchingTruth, protocol: MatchingProtocol
) -> Iterator[str | None]:
    given, priors = content.poses.take(content.has_pose), truth.priors.take(content.has_pose)
    if not len(given):
        return
    true = truth.poses if truth.has_poses else truth.priors
    _check_degrees(given.centres, truth, "poses")
    _check_camera_to_world(given, priors)
    _check_axes(given.rotation, priors.rotation)
    # After the convention, which decides the digits that count.
    yield _check_digits(content, truth, true.centres, protocol.scores.finest_m)
    yield _doubt_crs(given.centres, priors.centres, "pose", 1_000.0)
    near = count_near(given, priors, NEAR_M, NEAR_DEG)
    if near and protocol.prior.is_measured:
        said = f"{near:,} of {counted(len(given), 'answer')} equal to the prior"
        yield f"{said}, the photo's own GPS and gimbal angles"
    if truth.has_poses:
        yield _check_heights(given.centres, true.centres[content.has_pose])


# --- matches ---


def _check_map_pixels(content: Correspondences, truth: MatchingTruth) -> None:
    """Refuse pixels of the map that lie in the crops only when x and y or the frame change."""
    if content.map_xy is None or not len(content.map_xy):
        return
    corner, size = np.split(truth.crops[content.query], 2, axis=1)
    if content.map_frame == "crop":
        fix = "say map_frame='map' if they are pixels of the whole map; crops.csv has the crops"
        _refuse_outside("map_xy", content.map_xy - corner, size, content, truth, fix)
    readings = content.map_xy - corner, content.map_xy[:, ::-1] - corner, content.map_xy
    as_map, exchanged, of_crop = (float(_inside(xy, size).mean()) for xy in readings)
    if content.map_frame == "map":
        of_crop = 0.0  # a file that states their frame is believed
    if as_map > 0.8 or max(exchanged, of_crop) < 0.98:
        return
    what, share, fix = "pixels of the crop", of_crop, "say map_frame='crop', or map_frame='map'"
    if exchanged >= 0.98:
        what, share, fix = "rows before columns", exchanged, _X_FIRST
    said = f"the map pixels look like {what}: read so, {share:.0%} lie in their crops"
    raise _fault(f"{said}; as they are, {as_map:.0%}", "map_xy", fix)


def _check_points(content: Correspondences, truth: MatchingTruth, diagonal: float) -> None:
    """Judge by the true poses whether x and y are exchanged, or heights of points are in feet."""
    what, name, fix = "x and y exchanged", "map_xy", _X_FIRST
    if content.map_xy is None:
        what, name, fix = "heights in feet", "points3d", "multiply heights by 0.3048"
    off, left = (_misfit_px(content, truth, diagonal, otherwise=one) for one in (False, True))
    _judge(what, name, fix, off, left, 0.05 * diagonal, "px")


def _misfit_px(
    content: Correspondences, truth: MatchingTruth, diagonal: float, *, otherwise: bool
) -> float:
    """Return how far some matches lie from where the true poses see them, read in one of two ways.

    What no camera sees is as far away as can be.
    """
    parts = [(query, part) for query, part in enumerate(content.parts()) if part.stop > part.start]
    off = [np.zeros(1)]
    for query, part in parts[:: -(-len(parts) // 10) or 1]:
        rows = np.linspace(part.start, part.stop - 1, 40).astype(int)
        if content.map_xy is not None:
            corner, reference = truth.crops[query, :2], truth.map_of(query)
            xy = corner + (content.map_xy[rows] - corner)[:, :: -1 if otherwise else 1]
            points = lift(xy, reference.dom, reference.dsm, jobs=1).points
        else:
            assert content.points3d is not None
            points = content.points3d[rows] * (_FEET if otherwise else 1.0)
        seen = world_to_camera(truth.poses.take(query), points[None])
        away = project(truth.cameras.take(query), seen)[0] - content.query_xy[rows]
        off.append(np.fmin(_length(away), diagonal))
    return float(np.median(np.concatenate(off[1:] or off)))


# --- poses ---


def _check_degrees(coordinates: Floats, truth: MatchingTruth, name: str) -> None:
    are_degrees = len(coordinates) and (np.abs(coordinates[:, :2]) <= (180.0, 90.0)).all()
    if are_degrees and np.abs(truth.priors.centres[:, :2]).min() > 1000.0:
        x, y = coordinates[0, :2]
        fix = "convert longitude and latitude to the CRS that benchmark.toml states"
        raise _fault(f"looks like degrees: the first lies at ({x:.5f}, {y:.5f})", name, fix)


def _check_camera_to_world(given: Poses, priors: Poses) -> None:
    fix, back = "invert them: R.T and -R.T @ t", np.swapaxes(given.rotation, 1, 2)
    if _angle(given.rotation, priors.rotation) < _angle(back, priors.rotation):
        fix = "the rotations are right and the last column is the centre: t = -R @ centre"
    off, left = (
        float(np.median(_length(places - priors.centres)))
        for places in (given.centres, given.translation)
    )
    _judge("camera-to-world poses", "poses", fix, off, left, 0.0, "m from GPS")


def _check_axes(given: Floats, priors: Floats) -> None:
    """Refuse rotations far from the gimbal's that another reading brings near, by a factor of 3.

    Yaw may be wrong by 180 degrees in a few photos, which does not move medians. Quarter turns,
    such as those of a map's tile, are no reading of a camera's.
    """
    off, back, axes = _angle(given, priors), np.swapaxes(given, 1, 2), "OpenGL's camera axes"
    if off <= 20.0 or np.isin(np.abs(np.round(given, 12)), (0.0, 1.0)).all():
        return
    of_world = np.roll(matrix_to_quaternion(back), -1, axis=1)
    readings = {
        "camera-to-world rotations": back,
        f"{axes} (x right, y up, z backward)": _OPENGL @ given,
        f"camera-to-world rotations with {axes}": _OPENGL @ back,
        "quaternions read in the order x y z w": quaternion_to_matrix(
            np.roll(matrix_to_quaternion(given), 1, axis=1)
        ),
        # Of camera-to-world ones, as TUM has them and CUT3R has not.
        "quaternions in the order w x y z": np.swapaxes(quaternion_to_matrix(of_world), 1, 2),
    }
    errors = {name: _angle(rotation, priors) for name, rotation in readings.items()}
    fitting = {name: left for name, left in errors.items() if left < min(20.0, off / 3.0)}
    if fitting:
        # Of cameras that look down several may fit.
        what = f"looks like {' or '.join(sorted(fitting, key=fitting.__getitem__))}: they differ "
        what += f"from the IMU's by {off:.4g} degrees, read so by {min(fitting.values()):.4g}"
        raise _fault(what, "rotations", "convert them; OpenGL's w2c becomes diag(1, -1, -1) @ R")


def _check_digits(
    given: GivenPoses, truth: MatchingTruth, true_centres: Floats, finest_m: float
) -> str | None:
    """Refuse poses with digits that leave more than a centimetre open; doubt centres on a lattice.

    Centres may be off by half of the finest threshold: whole metres lose 0.5 m, which passes beside
    1 m; six digits lose 2.9 m of a northing, which does not beside 5 m. Centres of a made-up scene
    may lie on a lattice themselves.
    """
    name, fix = "poses", "write all digits (%.17g in text), or an .npz with rotations and centres"
    limit = least = COARSEST_M
    if given.centred:
        name, fix = "centres", "write all digits, as float64"
        least = max(COARSEST_M, float(centre_errors_m(true_centres).max(initial=0.0)))
        limit = max(least, 0.55 * finest_m)
    lost = np.nan_to_num(given.errors_m)
    coarse = np.flatnonzero(lost > limit)
    if coarse.size:
        what = f"too few digits in the {name} of {_name(truth, coarse)}: they move a camera by "
        what += f"{np.sqrt((lost[coarse] ** 2).mean()):.2g} m on average, more than {limit:g} m"
        raise _fault(what, name, fix)
    most = float(lost.max(initial=0.0))
    said = f"centres lie on a lattice: if they were rounded to it, they are {most:.2g} m off"
    return said if most > least else None


def _check_heights(centres: Floats, true: Floats) -> str | None:
    """Judge whether heights are in feet; doubt them if all are alike above or below the truth."""
    if len(centres) < _LEAST_PHOTOS:
        return None
    shift = np.median(centres[:, 2] - true[:, 2])
    readings = (centres, centres * _FEET, centres - (0.0, 0.0, shift))
    off, left, moved = (float(np.median(_length(reading - true))) for reading in readings)
    _judge("heights in feet", "centres", "multiply heights by 0.3048", off, left, 20.0, "m")
    if abs(shift) < 5.0 or moved > 1.0:
        return None
    return f"heights of another vertical datum? They lie {shift:+.1f} m from the true ones (median)"


def _doubt_crs(places: Floats, gps: Floats, noun: str, limit: float) -> str | None:
    """Doubt places that lie beyond any error of GPS, and any view."""
    far = int((_length(places - gps) > limit).sum())
    said = f"{far:,} of {counted(len(places), noun)} more than {limit:,g} m from the photo's GPS"
    return f"{said} position: are all coordinates in the scene's CRS?" if far else None


def count_near(poses: Poses, priors: Poses, metres: float, degrees: float) -> int:
    """Count the poses, NaN where there is none, that lie as near to their priors as that."""
    turned = rotation_angle_deg(poses.rotation, priors.rotation)
    return int(((_length(poses.centres - priors.centres) < metres) & (turned < degrees)).sum())


# --- several checks ---


def _fault(what: str, name: str, fix: str) -> PredictionError:
    return PredictionError(what, where=f"field '{name}'", expected=_CONVENTIONS, fix=fix)


def _judge(
    what: str, name: str, fix: str, off: float, left: float, clear: float, unit: str
) -> None:
    """Refuse a clear misfit if another reading leaves less than a tenth of it."""
    if off > clear and left < 0.1 * off:
        said = f"looks like {what}: {off:.4g} {unit} as it is, {left:.4g} {unit} read so (medians)"
        raise _fault(said, name, fix)


def _length(vectors: Floats) -> Floats:
    with np.errstate(over="ignore"):
        return np.asarray(np.linalg.norm(vectors, axis=1))


def _angle(one: Floats, other: Floats) -> float:
    return float(np.median(rotation_angle_deg(one, other)))


def _inside(xy: Floats, size: Ints) -> Bools:
    return np.asarray(((xy >= -_SLACK_PX) & (xy <= size + _SLACK_PX)).all(axis=1))


def _refuse_outside(
    name: str, xy: Floats, size: Ints, content: Correspondences, truth: MatchingTruth, fix: str
) -> None:
    """Refuse pixels (M, 2) outside pictures of these sizes (M, 2)."""
    outside = ~_inside(xy, size)
    if outside.any():
        x, y = xy[outside][0]
        what = f"{counted(int(outside.sum()), 'pixel')} outside the picture, in "
        what += _name(truth, np.unique(content.query[outside]))
        what += f"; the first is ({x:.1f}, {y:.1f}) in {_sides(size[outside][0])}"
        raise _fault(what, name, fix)


def _sides(size: Ints | Floats) -> str:
    return f"{size[0]:g}x{size[1]:g} px"


def _name(truth: MatchingTruth, rows: Ints) -> str:
    return first_of(truth.queries["id"].iloc[rows], len(truth.queries), noun="query")
