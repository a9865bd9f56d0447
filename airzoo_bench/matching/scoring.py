"""Scoring one scene of the matching track: its predictions become records, a row a query."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.progress import Headed
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.matching.lifting import LiftStatus, lift
from airzoo_bench.matching.metrics import pose_errors
from airzoo_bench.matching.pose_tasks import PoseQueries, solve_queries
from airzoo_bench.matching.scene_predictions import ScenePredictions, count_near
from airzoo_bench.matching.scores import pose_columns
from airzoo_bench.matching.settings import Lift, MatchingProtocol, MatchingScores
from airzoo_bench.matching.truth import MatchingTruth

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "NEAR_DEG",
    "NEAR_M",
    "NOT_GIVEN",
    "ScoredScene",
    "lifted_points",
    "score_priors",
    "score_scene",
]


MISSING = "missing from the predictions"
NOT_GIVEN = "no pose given"
GIVEN = "given"
NEAR_M, NEAR_DEG = 0.05, 0.1
"""An answer this near to its prior counts as the prior, however it was written or solved."""


@dataclass(frozen=True, eq=False)
class ScoredScene:
    """Records of a scene, and what figures need besides.

    Attributes
    ----------
    records : DataFrame
        A row a query.
    centres : (Q, 3) float64
        Estimated camera centres; NaN for failures.
    inliers : list of (m,) bool
        Of the matches of each query; empty where poses were given.
    seconds : (Q,) float64
        Spent in the solver. Not part of the records, which are the same for the same input.
    counts : dict of str to int
        What a result states of the scene.
    """

    records: pd.DataFrame
    centres: Floats
    inliers: list[Bools]
    seconds: Floats
    counts: dict[str, int]


@dataclass(frozen=True, eq=False)
class _Posed:
    """Poses of Q queries, given or solved, and the counts of their matches."""

    rotations: Floats
    centres: Floats
    status: list[str]
    inliers: list[Bools]
    seconds: Floats
    counts: dict[str, Ints]


def score_scene(
    truth: MatchingTruth,
    predicted: ScenePredictions,
    protocol: MatchingProtocol,
    resources: Resources,
) -> ScoredScene:
    """Score every query of a scene."""
    if predicted.poses is not None:
        posed = _given(predicted.poses)
    else:
        posed = _solved(truth, predicted, protocol, resources)
    records = _records(truth, predicted.answered, posed, protocol.scores)
    counts = _result_counts(truth, records) | {"equal_to_prior": predicted.equal_to_prior(truth)}
    if protocol.prior.is_measured:
        poses = Poses(rotation=posed.rotations, centres=posed.centres)
        counts["near_prior"] = count_near(poses, truth.priors, NEAR_M, NEAR_DEG)
    return ScoredScene(records, posed.centres, posed.inliers, posed.seconds, counts)


def _result_counts(truth: MatchingTruth, records: pd.DataFrame) -> dict[str, int]:
    counts = {
        "queries": len(records),
        "missing": int((~records["answered"]).sum()),
        "failed": int(records["failed"].sum()),
        "left_out": len(truth.excluded),
    }
    for name in ("matches", "lifted", "outside_map", "outside_dsm", "no_height", "beyond_limit"):
        if name in records.columns:
            counts[name] = int(records[name].sum())
    return counts


def _records(
    truth: MatchingTruth, answered: Bools, posed: _Posed, settings: MatchingScores
) -> pd.DataFrame:
    import pandas as pd

    true = truth.poses
    rotation = true.rotation if settings.orientation_is_trusted else None
    errors = pose_errors(posed.rotations, posed.centres, rotation, true.centres)
    columns: dict[str, Any] = {
        "scene": truth.scene,
        "query": truth.queries["id"].to_numpy(),
        "answered": answered,
        "status": np.where(answered, posed.status, MISSING),
        "failed": ~np.isfinite(errors.translation_m),
        **posed.counts,
        **pose_columns(errors, settings),
    }
    return pd.concat([pd.DataFrame(columns), truth.conditions], axis=1)


def score_priors(truth: MatchingTruth, settings: MatchingScores) -> pd.DataFrame:
    """Return the records of a method that answers every query by its prior pose."""
    answered = np.ones(len(truth.queries), np.bool_)
    return _records(truth, answered, _given(truth.priors), settings)


def _given(poses: Poses) -> _Posed:
    none: Bools = np.zeros(0, np.bool_)
    found: Bools = np.asarray(np.isfinite(poses.centres).all(axis=1))
    return _Posed(
        poses.rotation,
        poses.centres,
        np.where(found, GIVEN, NOT_GIVEN).tolist(),
        [none] * len(found),
        np.zeros(len(found)),
        {},
    )


def _solved(
    truth: MatchingTruth,
    predicted: ScenePredictions,
    protocol: MatchingProtocol,
    resources: Resources,
) -> _Posed:
    solver = protocol.solver
    points, status = lifted_points(truth, predicted, protocol.lift, resources.jobs)
    given = np.diff(predicted.offsets)
    lifted = (status == LiftStatus.LIFTED) & np.repeat(given >= solver.least_matches, given)
    queries = PoseQueries(
        f"scene {truth.scene}",
        truth.cameras,
        np.concatenate([[0], np.cumsum(lifted)])[predicted.offsets],
        predicted.query_xy[lifted],
        points[lifted],
    )
    settings: Any = solver.model_dump(exclude={"name", "least_matches"}) | {"solver": solver.name}
    progress = Headed(truth.scene, resources.progress)
    found = solve_queries(queries, settings, replace(resources, progress=progress))
    of_all = np.zeros(len(lifted), np.bool_)
    of_all[lifted] = found.inliers
    inliers = [of_all[part] for part in predicted.parts()]
    counts = _counts(predicted, status)
    counts["beyond_limit"] = found.left_out
    counts["inliers"] = np.array([part.sum() for part in inliers], np.int64)
    return _Posed(
        found.rotations,
        found.centres,
        found.status,
        inliers,
        found.seconds,
        counts,
    )


def lifted_points(
    truth: MatchingTruth, predicted: ScenePredictions, lifting: Lift, jobs: int
) -> tuple[Floats, NDArray[np.uint8]]:
    """Return points (M, 3) and a LiftStatus each; points that were given need no lifting."""
    if predicted.map_xy is None:
        return predicted.points, np.full(len(predicted.points), LiftStatus.LIFTED, np.uint8)
    heights = None if lifting.heights_above_m == "any" else lifting.heights_above_m
    shift = 0.5 if lifting.map_pixel_centres == "integer" else 0.0
    map_xy, parts = predicted.map_xy + shift, predicted.parts() if truth.own_maps else [slice(None)]
    lifted = [
        lift(map_xy[part], one.dom, one.dsm, heights_above_m=heights, jobs=jobs)
        for part, one in zip(parts, truth.maps, strict=True)
    ]
    if len(lifted) == 1:
        return lifted[0].points, lifted[0].status
    points = [np.zeros((0, 3)), *(one.points for one in lifted)]
    status = [np.zeros(0, np.uint8), *(one.status for one in lifted)]
    return np.concatenate(points), np.concatenate(status)


def _counts(predicted: ScenePredictions, status: NDArray[np.uint8]) -> dict[str, Ints]:
    names = {
        "lifted": LiftStatus.LIFTED,
        "outside_map": LiftStatus.OUTSIDE_MAP,
        "outside_dsm": LiftStatus.OUTSIDE_DSM,
        "no_height": LiftStatus.NO_HEIGHT,
    }
    parts = predicted.parts()
    counts = {"matches": np.array([part.stop - part.start for part in parts], np.int64)}
    for name, kind in names.items():
        counts[name] = np.array([(status[part] == kind).sum() for part in parts], np.int64)
    return counts
