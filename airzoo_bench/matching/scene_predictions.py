"""The predictions of one scene, by query, and the refusal of what they cannot mean."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from airzoo_bench.geometry.precision import COARSEST_M, rounding_errors, was_rounded_to
from airzoo_bench.geometry.rasters import gsd_m
from airzoo_bench.matching.conventions import (
    refuse_other_conventions,
    suspect_heights,
    suspect_points,
)
from airzoo_bench.matching.predictions import (
    Correspondences,
    GivenPoses,
    MatchingPredictions,
    check_digits,
)
from airzoo_bench.matching.settings import MatchingScores
from airzoo_bench.matching.truth import MatchingTruth

__all__ = ["ScenePredictions", "count_near", "match_scene"]


# Coordinates may lie this far outside a picture: sub-pixel refinement oversteps its border.
_SLACK_PX = 1.0
# Pixels count as those of crops, or as rows before columns, where at least the first share fits
# that reading, and at most the second share fits what they should be.
_NEARLY_ALL, _SOME = 0.98, 0.8
# A prior that was copied went through a file at most.
_SAME_M, _SAME_DEG = 1e-3, 1e-3


@dataclass(frozen=True, eq=False)
class ScenePredictions:
    """The predictions for the Q queries of one scene: matches, pairs, or poses (NaN where none).

    A missing query has no rows; query q has the rows ``offsets[q]:offsets[q + 1]``. `map_xy`
    are pixels of the whole map, `points` lie in the scene's CRS; `doubt` says what looks wrong.
    """

    answered: Bools
    offsets: Ints
    query_xy: Floats
    map_xy: Floats | None
    points: Floats
    poses: Poses | None
    doubt: str | None = None

    def equal_to_prior(self, truth: MatchingTruth) -> int:
        """Count the poses that are the photo's own GPS position and gimbal angles."""
        if self.poses is None:
            return 0
        return count_near(self.poses, truth.priors, _SAME_M, _SAME_DEG)

    def parts(self) -> list[slice]:
        """Return the rows of each query."""
        return [
            slice(int(start), int(stop))
            for start, stop in zip(self.offsets[:-1], self.offsets[1:], strict=True)
        ]


def count_near(poses: Poses, priors: Poses, metres: float, degrees: float) -> int:
    """Count the poses, NaN where there is none, that lie as near to their priors as that."""
    with np.errstate(over="ignore"):
        apart = np.linalg.norm(poses.centres - priors.centres, axis=1)
    turned = rotation_angle_deg(poses.rotation, priors.rotation)
    return int(((apart < metres) & (turned < degrees)).sum())


def match_scene(
    predictions: MatchingPredictions,
    truth: MatchingTruth,
    rows: NDArray[np.intp],
    scores: MatchingScores,
) -> ScenePredictions:
    """Return the predictions for the queries of a scene; refuse what cannot be meant as written."""
    content = predictions.content
    try:
        if isinstance(content, GivenPoses):
            matched = _match_poses(content, truth, rows)
            # After the convention: it decides which digits count.
            around = truth.poses if truth.has_poses else truth.priors
            check_digits(content, predictions.query_ids, scores.finest_m, around.centres)
            return matched
        return _match_correspondences(content, truth, rows)
    except PredictionError as error:
        raise error.inside(predictions.path) from error


def _match_poses(
    given: GivenPoses, truth: MatchingTruth, rows: NDArray[np.intp]
) -> ScenePredictions:
    answered = rows >= 0
    there = answered & given.found[rows]
    rotation = np.where(there[:, None, None], given.poses.rotation[rows], np.nan)
    centres = np.where(there[:, None], given.poses.centres[rows], np.nan)
    poses = Poses(rotation=rotation, centres=centres)
    refuse_other_conventions(
        poses.take(there), truth.priors.take(there), quaternions=given.quaternions
    )
    doubt = None
    if truth.has_poses:
        doubt = suspect_heights(poses.take(there), truth.poses.take(there))
    nothing = np.zeros((0, 2))
    return ScenePredictions(
        answered, np.zeros(len(rows) + 1, np.int64), nothing, None, np.zeros((0, 3)), poses, doubt
    )


def _match_correspondences(
    matches: Correspondences, truth: MatchingTruth, rows: NDArray[np.intp]
) -> ScenePredictions:
    answered = rows >= 0
    counts = np.where(answered, np.diff(matches.offsets)[rows], 0)
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    query = np.repeat(np.arange(len(rows)), counts)
    taken = np.repeat(matches.offsets[rows], counts) + np.arange(offsets[-1]) - offsets[query]
    query_xy = matches.query_xy[taken]
    _check_image_size(matches, truth, rows)
    _check_query_pixels(query_xy, truth, query)
    map_xy = None if matches.map_xy is None else matches.map_xy[taken]
    if not matches.rounded:
        _refuse_coarse_pixels(query_xy, map_xy, truth)
    if map_xy is not None and matches.map_frame == "crop":
        _check_crop_pixels(map_xy, truth, query)
        map_xy = map_xy + truth.crops[query, :2]
    elif map_xy is not None:
        _refuse_other_frame(map_xy, truth, query, stated=matches.map_frame is not None)
    points = np.zeros((0, 3)) if matches.points3d is None else matches.points3d[taken]
    found = ScenePredictions(answered, offsets, query_xy, map_xy, points, None)
    if not truth.has_poses:
        return found
    return replace(found, doubt=suspect_points(truth, found.parts(), query_xy, map_xy, points))


def _refuse_coarse_pixels(query_xy: Floats, map_xy: Floats | None, truth: MatchingTruth) -> None:
    """Refuse pixels that float16 has moved by more than a centimetre of ground."""
    gsd = max(float(np.mean(gsd_m(one.dom))) for one in truth.maps)
    fields = {"query_xy": (query_xy, gsd * _zoom(truth)), "map_xy": (map_xy, gsd)}
    for name, (values, metres) in fields.items():
        if values is None or not was_rounded_to(values, np.float16):
            continue
        error = float(np.sqrt((rounding_errors(values) ** 2).mean()))
        if error * metres > COARSEST_M:
            raise PredictionError(
                f"the pixels went through float16, which keeps one such as {values.max():.0f} to "
                f"{np.spacing(np.float16(values.max())):g} px: on average {error:.2g} px or "
                f"{error * metres:.2g} m of ground are lost",
                where=f"field '{name}'",
                expected="float32 or float64",
                fix="keep pixels in float32 from the method to the file",
            )


def _zoom(truth: MatchingTruth) -> float:
    """Return how many map pixels wide a pixel of a photo is, by the diagonals of the crops."""
    cameras = truth.cameras
    photo = np.hypot(cameras.width, cameras.height)
    return float(np.median(np.hypot(*truth.crops[:, 2:].T) / photo))


def _refuse_other_frame(map_xy: Floats, truth: MatchingTruth, query: Ints, *, stated: bool) -> None:
    """Refuse pixels that fit the crops, or rows and columns exchanged, and not the map."""
    if not len(map_xy):
        return
    crop = truth.crops[query]
    as_map = _share_inside(map_xy - crop[:, :2], crop)
    if as_map > _SOME:
        return
    readings = {
        "rows before columns": (map_xy[:, ::-1] - crop[:, :2], "write x, the column, before y"),
        "pixels of the crop": (
            map_xy,
            "say map_frame='crop', or map_frame='map' if they are pixels of the map all the same",
        ),
    }
    for what, (local, fix) in list(readings.items())[: 1 if stated else 2]:
        inside = _share_inside(local, crop)
        if inside >= _NEARLY_ALL:
            raise PredictionError(
                f"the map pixels look like {what}: read so, {inside:.0%} lie in the crop of their "
                f"query; as pixels (x, y) of the whole map, {as_map:.0%}",
                where="field 'map_xy'",
                expected="pixels (x, y) of the whole map, or of the crop with map_frame='crop'",
                fix=fix,
            )


def _share_inside(local: Floats, crop: Ints) -> float:
    inside = (local >= -_SLACK_PX) & (local <= crop[:, 2:] + _SLACK_PX)
    return float(inside.all(axis=1).mean())


def _check_image_size(
    matches: Correspondences, truth: MatchingTruth, rows: NDArray[np.intp]
) -> None:
    if matches.image_size is None:
        return
    cameras = truth.cameras
    true = np.stack([cameras.width, cameras.height], axis=1)
    stated = matches.image_size[rows]
    bad = np.flatnonzero((rows >= 0) & (stated != true).any(axis=1))
    if bad.size:
        first = bad[0]
        raise PredictionError(
            f"matches in another image size than the query's: {_named(truth, bad)}; the "
            f"first is {true[first, 0]}x{true[first, 1]} px, its matches are for "
            f"{stated[first, 0]}x{stated[first, 1]}",
            where="field 'image_size'",
            fix="write x, the column, before y, and width before height"
            if (stated[bad] == true[bad, ::-1]).all()
            else "multiply x and y by the ratio of the widths and of the heights",
        )


def _check_query_pixels(query_xy: Floats, truth: MatchingTruth, query: Ints) -> None:
    cameras = truth.cameras
    size = np.stack([cameras.width, cameras.height], axis=1)[query]
    _refuse_outside(
        query_xy,
        size,
        truth,
        query,
        ("pixel", "photo"),
        where="field 'query_xy'",
        expected="pixels of the photo at its full size, the corner being (0, 0)",
        fix="write x, the column, before y: the other way round all lie inside"
        if (query_xy[:, ::-1] <= size + _SLACK_PX).all()
        else "scale them from the size that the method worked in",
    )


def _check_crop_pixels(map_xy: Floats, truth: MatchingTruth, query: Ints) -> None:
    _refuse_outside(
        map_xy,
        truth.crops[query, 2:],
        truth,
        query,
        ("map pixel", "crop"),
        where="field 'map_xy'",
        expected="pixels of the query's crop, the corner being (0, 0)",
        fix="say map_frame='map' if they are pixels of the whole map; crops.csv has the crops",
    )


def _refuse_outside(
    xy: Floats, size: Ints, truth: MatchingTruth, query: Ints, nouns: tuple[str, str], **error: str
) -> None:
    """Refuse pixels (M, 2) outside the picture of their query, of these sizes (M, 2)."""
    outside = ((xy < -_SLACK_PX) | (xy > size + _SLACK_PX)).any(axis=1)
    if outside.any():
        pixel, picture = nouns
        first, (width, height) = xy[outside][0], size[outside][0]
        raise PredictionError(
            f"{counted(int(outside.sum()), pixel)} outside the {picture}, in "
            f"{_named(truth, np.unique(query[outside]))}; the first is ({first[0]:.1f}, "
            f"{first[1]:.1f}) in a {picture} of {width}x{height} px",
            **error,
        )


def _named(truth: MatchingTruth, rows: NDArray[np.intp]) -> str:
    return first_of(truth.queries["id"].iloc[rows], len(truth.queries), noun="query")
