"""Mistakes that users cannot see: a check raises an error, or returns a doubt that becomes a note.

Poses are compared with the photos' own GPS positions and gimbal angles; where the true poses are
known, matches and heights are compared with these.
"""

from __future__ import annotations

from collections.abc import Iterator

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
from airzoo_bench.matching.metrics import count_near
from airzoo_bench.matching.predictions import Correspondences, PredictedPoses
from airzoo_bench.matching.protocol import MatchingProtocol
from airzoo_bench.matching.solving import lift
from airzoo_bench.matching.truth import MatchingTruth

NEAR_M, NEAR_DEG = 0.05, 0.1
"""An answer this near to its prior counts as the prior, however it was written or solved."""

_SLACK_PX = 1.0  # sub-pixel refinement oversteps a picture's border
_FEET = (1.0, 1.0, 0.3048)
_OPENGL = np.diag((1.0, -1.0, -1.0))  # from x right, y down, z forward to y up, z backward, or back
_CONVENTIONS = (
    "pixels (x, y) of the photo at its full size and of the whole map (of the crop with map_frame="
    "'crop'), corners being (0, 0); metres in the scene's CRS; world-to-camera poses, x_cam = R X "
    "+ t, camera axes x right, y down, z forward, quaternions w x y z"
)
_X_FIRST = "write x, the column, before y"


def check_scene(
    content: Correspondences | PredictedPoses,
    truth: MatchingTruth,
    answered: Bools,
    protocol: MatchingProtocol,
) -> tuple[str, ...]:
    """Check the answers for a scene, in pixels of the whole map, and return doubts about them."""
    if isinstance(content, PredictedPoses):
        doubts = _check_poses(content, truth, protocol)
    else:
        doubts = _check_matches(content, truth, answered)
    return tuple(f"scene {truth.scene}: {doubt}" for doubt in doubts)


# --- matches ---


def _check_matches(
    content: Correspondences, truth: MatchingTruth, answered: Bools
) -> Iterator[str]:
    sizes = np.stack([truth.cameras.width, truth.cameras.height], axis=1)
    stated = sizes if content.image_size is None else content.image_size
    other = np.flatnonzero(answered & (stated != sizes).any(axis=1))
    if other.size:
        (w, h), (width, height), named = stated[other[0]], sizes[other[0]], _name(truth, other)
        what = f"{w:g}x{h:g} px is not the size of {named}, the first of {width}x{height} px"
        fix = "write width before height; scale x and y by their ratio"
        raise _fault(what, "image_size", fix)
    of_match = sizes[content.query]
    fix = f"{_X_FIRST}, in pixels of the photo at its full size"
    _refuse_outside("query_xy", content.query_xy, of_match, content, truth, fix)
    if content.map_xy is not None and len(of_match) >= 100:
        corner, size = np.split(truth.crops[content.query], 2, axis=1)
        if (content.map_xy - corner < 0.6 * size).all():  # the margin of crops has no matches
            said = "no match lies beyond 60% of the crops' width and height"
            yield f"{said}: are the matches in the size of a smaller image?"
    what, name, fix = "x and y exchanged", "map_xy", _X_FIRST
    if content.points3d is None:
        _check_map_pixels(content, truth)
    else:
        what, name, fix = "heights in feet", "points3d", "multiply heights by 0.3048"
        _check_degrees(content.points3d, truth, name)
    if truth.has_poses and len(content.query_xy):
        clear = 0.05 * float(np.hypot(*sizes.T).max())
        given, seen, otherwise = _see_matches(content, truth)
        off, left = _misfit(given, seen), _misfit(given, otherwise)
        _refuse_other_reading(what, name, fix, off, left, clear, "px")
        larger = float(np.median(_length(seen) / (_length(given) + 1.0)))
        what, left = f"pixels of an image {larger:.2g} times smaller", _misfit(larger * given, seen)
        fix = "scale x and y to the photo at its full size"
        _refuse_other_reading(what, "query_xy", fix, off, left, clear, "px")


def _check_map_pixels(content: Correspondences, truth: MatchingTruth) -> None:
    """Refuse pixels of the map that lie in the crops only when x and y or the frame change."""
    corner, size = np.split(truth.crops[content.query], 2, axis=1)
    if content.map_xy is None or not len(corner):
        return
    fix = "say map_frame='map' for pixels of the whole map, map_frame='crop' for those of crops"
    if content.map_frame == "crop":
        _refuse_outside("map_xy", content.map_xy - corner, size, content, truth, fix)
    readings = {
        "as they are": content.map_xy - corner,
        "rows before columns": content.map_xy[:, ::-1] - corner,
    }
    if content.map_frame is None:  # a file that states it is believed
        readings["pixels of the crop"] = content.map_xy
    shares = {reading: float(_inside(xy, size).mean()) for reading, xy in readings.items()}
    stated, best = shares.pop("as they are"), max(shares, key=shares.__getitem__)
    if stated <= 0.8 and shares[best] >= 0.98:
        what = f"the map pixels look like {best}: read so, {shares[best]:.0%} lie in their crops"
        raise _fault(f"{what}; as they are, {stated:.0%}", "map_xy", f"{_X_FIRST}, and {fix}")


def _see_matches(content: Correspondences, truth: MatchingTruth) -> tuple[Floats, Floats, Floats]:
    """Return some pixels of photos, where the true poses see their matches, and with other reading.

    That is with x and y of the map exchanged; of 3D points, with heights in feet.
    """
    matched, found = np.flatnonzero(np.diff(content.offsets)).tolist(), []
    for query in matched[:: -(-len(matched) // 10)]:
        first, stop = content.offsets[query : query + 2]
        rows = np.linspace(first, stop - 1, 40).astype(int)
        if content.points3d is not None:
            readings = [content.points3d[rows], content.points3d[rows] * _FEET]
        else:
            assert content.map_xy is not None
            corner, known = truth.crops[query, :2], truth.map_of(query)
            away = content.map_xy[rows] - corner
            lifted = (corner + away, corner + away[:, ::-1])
            readings = [lift(xy, known.dom, known.dsm, jobs=1).points for xy in lifted]
        camera, pose = truth.cameras.take(query), truth.poses.take(query)
        seen = [project(camera, world_to_camera(pose, one[None]))[0] for one in readings]
        found.append((content.query_xy[rows], *seen))
    given, first, second = map(np.concatenate, zip(*found, strict=True))
    return given, first, second


def _misfit(given: Floats, seen: Floats) -> float:
    """Return the median distance of pixels; one that no camera sees is infinitely far away."""
    return float(np.median(np.nan_to_num(_length(seen - given), nan=np.inf)))


# --- poses ---


def _check_poses(
    content: PredictedPoses, truth: MatchingTruth, protocol: MatchingProtocol
) -> Iterator[str]:
    there, finest = content.has_pose, protocol.scores
    given, priors = content.poses.take(there), truth.priors.take(there)
    if not len(given):
        return
    _check_degrees(given.centres, truth, "poses")
    _check_camera_to_world(given, priors)
    _check_axes(given.rotation, priors.rotation)
    # After the convention, which decides the digits that count.
    limits = (*finest.translation_below_m, *(metres for metres, _ in finest.pose_below_m_deg))
    _check_digits(content, truth, min(limits))
    near = count_near(given, priors, NEAR_M, NEAR_DEG)
    if near and protocol.prior.is_measured:
        said = f"{near:,} of {counted(len(given), 'answer')} equal to the prior"
        yield f"{said}, the photo's own GPS and gimbal angles"
    if truth.has_poses and len(given) >= 5:
        true = truth.poses.centres[there]
        readings = (given.centres, given.centres * _FEET)
        off, left = (float(np.median(_length(one - true))) for one in readings)
        fix = "multiply heights by 0.3048"
        _refuse_other_reading("heights in feet", "centres", fix, off, left, 20.0, "m")
        yield from doubt_shift(given.centres, true)


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
    _refuse_other_reading("camera-to-world poses", "poses", fix, off, left, 0.0, "m from GPS")


def _check_axes(given: Floats, priors: Floats) -> None:
    """Refuse rotations far from the gimbal's that another reading brings near, by a factor of 3."""
    off, back, axes = _angle(given, priors), np.swapaxes(given, 1, 2), "OpenGL's camera axes"
    # Quarter turns, such as those of a map's tile, are no reading of a camera's.
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
        "quaternions in the order w x y z": np.swapaxes(quaternion_to_matrix(of_world), 1, 2),
    }
    errors = {name: _angle(rotation, priors) for name, rotation in readings.items()}
    near = [name for name, left in errors.items() if left < min(20.0, off / 3.0)]
    fitting = sorted(near, key=errors.__getitem__)
    if fitting:  # of cameras that look down several may fit
        what = f"looks like {' or '.join(fitting)}: they differ from the IMU's by {off:.1f} degrees"
        what += f", read so by {errors[fitting[0]]:.1f}"
        fix = "convert them; OpenGL's w2c becomes diag(1, -1, -1) @ R"
        fix = "transpose them: R.T" if fitting[0] == "camera-to-world rotations" else fix
        raise _fault(what, "rotations", fix)


def _check_digits(given: PredictedPoses, truth: MatchingTruth, finest_m: float) -> None:
    """Refuse poses whose digits leave open more than 1 cm, of centres a share of the threshold."""
    name, limit = "poses", COARSEST_M
    if given.centred:
        name, true = "centres", truth.poses if truth.has_poses else truth.priors
        limit = max(limit, 0.25 * finest_m, *centre_errors_m(true.centres))
    lost = np.nan_to_num(given.errors_m)
    coarse = np.flatnonzero(lost > limit)
    if coarse.size:
        what = f"too few digits in the {name} of {_name(truth, coarse)}: they move a camera by "
        what += f"{np.sqrt((lost[coarse] ** 2).mean()):.2g} m on average, more than {limit:g} m"
        fix = "write all digits (%.17g in text), or an .npz with rotations and centres"
        raise _fault(what, name, fix)


def doubt_shift(centres: Floats, true: Floats) -> Iterator[str]:
    """Doubt the map, the truth or a datum where poses differ from the truth by nearly one shift."""
    errors = (centres - true)[np.isfinite(centres).all(axis=1)]
    shift = np.median(errors, axis=0) if len(errors) >= 5 else np.zeros(3)
    length, spread = np.linalg.norm(shift), np.median([*_length(errors - shift), 0.0])
    if length >= 2.0 and spread <= 0.1 * length:
        said = "poses lie ({:+.1f}, {:+.1f}, {:+.1f}) m from the true ones, all alike".format(
            *shift
        )
        yield f"{said}: is the map shifted, or the truth, or is the vertical datum another?"


# --- both ---


def _refuse_other_reading(
    what: str, name: str, fix: str, off: float, left: float, clear: float, unit: str
) -> None:
    """Refuse a clear misfit if another reading leaves less than a tenth of it."""
    if off > clear and left < 0.1 * off:
        said = f"looks like {what}: {off:.4g} {unit} as it is, {left:.4g} {unit} read so (medians)"
        raise _fault(said, name, fix)


def _refuse_outside(
    name: str, xy: Floats, size: Ints, content: Correspondences, truth: MatchingTruth, fix: str
) -> None:
    """Refuse pixels (M, 2) outside pictures of these sizes (M, 2)."""
    outside = ~_inside(xy, size)
    if outside.any():
        (x, y), (width, height) = xy[outside][0], size[outside][0]
        what = f"{counted(int(outside.sum()), 'pixel')} outside the picture, in "
        what += _name(truth, np.unique(content.query[outside]))
        what += f"; the first is ({x:.1f}, {y:.1f}) in {width}x{height} px"
        if _inside(xy[:, ::-1], size).all():
            what += "; they look like x and y exchanged: read so, all are inside"
        raise _fault(what, name, fix)


def _fault(what: str, name: str, fix: str) -> PredictionError:
    return PredictionError(what, where=f"field '{name}'", expected=_CONVENTIONS, fix=fix)


def _inside(xy: Floats, size: Ints) -> Bools:
    return np.asarray(((xy >= -_SLACK_PX) & (xy <= size + _SLACK_PX)).all(axis=1))


def _length(vectors: Floats) -> Floats:
    with np.errstate(over="ignore"):
        return np.asarray(np.linalg.norm(vectors, axis=1))


def _angle(one: Floats, other: Floats) -> float:
    return float(np.median(rotation_angle_deg(one, other)))


def _name(truth: MatchingTruth, rows: Ints) -> str:
    return first_of(truth.queries["id"].iloc[rows], len(truth.queries), noun="query")
