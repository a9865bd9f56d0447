"""Scoring one scene of the matching track: its predictions become records, a row a query."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.progress import Headed
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.matching.lifting import LiftStatus, lift
from airzoo_bench.matching.metrics import pose_errors
from airzoo_bench.matching.scene_predictions import ScenePredictions, count_near
from airzoo_bench.matching.scores import pose_columns
from airzoo_bench.matching.settings import Lift, MatchingProtocol, MatchingScores
from airzoo_bench.matching.solving import PoseQueries, QueryPoses, solve_queries
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
STATUS_COLUMNS = {
    LiftStatus.LIFTED: "lifted",
    LiftStatus.OUTSIDE_MAP: "outside_map",
    LiftStatus.OUTSIDE_DSM: "outside_dsm",
    LiftStatus.NO_HEIGHT: "no_height",
}
"""Columns of the records that count matches by how lifting ended."""
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


def score_scene(
    truth: MatchingTruth,
    predicted: ScenePredictions,
    protocol: MatchingProtocol,
    run: Run,
) -> ScoredScene:
    """Score every query of a scene."""
    of_matches: dict[str, Ints] = {}
    if predicted.poses is not None:
        found = _given_poses(predicted.poses)
    else:
        found, of_matches = _solve(truth, predicted, protocol, run)
    records = _records(truth, predicted.answered, found, of_matches, protocol.scores)
    counts = _result_counts(truth, records) | {"equal_to_prior": predicted.equal_to_prior(truth)}
    if protocol.prior.is_measured:
        poses = Poses(rotation=found.rotations, centres=found.centres)
        counts["near_prior"] = count_near(poses, truth.priors, NEAR_M, NEAR_DEG)
    inliers = [found.inliers[part] for part in predicted.parts()]
    return ScoredScene(records, found.centres, inliers, found.seconds, counts)


def _result_counts(truth: MatchingTruth, records: pd.DataFrame) -> dict[str, int]:
    counts = {
        "queries": len(records),
        "missing": int((~records["answered"]).sum()),
        "failed": int(records["failed"].sum()),
        "left_out": len(truth.excluded),
    }
    for name in ("matches", *STATUS_COLUMNS.values(), "beyond_limit"):
        if name in records.columns:
            counts[name] = int(records[name].sum())
    return counts


def _records(
    truth: MatchingTruth,
    answered: Bools,
    found: QueryPoses,
    of_matches: dict[str, Ints],
    settings: MatchingScores,
) -> pd.DataFrame:
    import pandas as pd

    true = truth.poses
    rotation = true.rotation if settings.orientation_is_trusted else None
    errors = pose_errors(found.rotations, found.centres, rotation, true.centres)
    columns: dict[str, Any] = {
        "scene": truth.scene,
        "query": truth.queries["id"].to_numpy(),
        "answered": answered,
        "status": np.where(answered, found.status, MISSING),
        "failed": ~np.isfinite(errors.translation_m),
        **of_matches,
        **pose_columns(errors, settings),
    }
    return pd.concat([pd.DataFrame(columns), truth.conditions], axis=1)


def score_priors(truth: MatchingTruth, settings: MatchingScores) -> pd.DataFrame:
    """Return the records of a method that answers every query by its prior pose."""
    answered = np.ones(len(truth.queries), np.bool_)
    return _records(truth, answered, _given_poses(truth.priors), {}, settings)


def _given_poses(poses: Poses) -> QueryPoses:
    status = np.where(np.isfinite(poses.centres).all(axis=1), GIVEN, NOT_GIVEN).tolist()
    none = np.zeros(len(poses), np.int64)
    no_inliers = np.zeros(0, np.bool_)
    return QueryPoses(
        poses.rotation, poses.centres, status, no_inliers, none, none.astype(np.float64)
    )


def _solve(
    truth: MatchingTruth,
    predicted: ScenePredictions,
    protocol: MatchingProtocol,
    run: Run,
) -> tuple[QueryPoses, dict[str, Ints]]:
    """Lift matches and solve for poses; return these, and counts of each query's matches."""
    solver = protocol.solver
    points, status = lifted_points(truth, predicted, protocol.lift, run.jobs)
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
    progress = Headed(truth.scene, run.progress)
    found = solve_queries(queries, settings, replace(run, progress=progress))
    inliers = np.zeros(len(lifted), np.bool_)
    inliers[lifted] = found.inliers
    counts = {"matches": given}
    for kind, name in STATUS_COLUMNS.items():
        counts[name] = _sums(status == kind, predicted.offsets)
    counts |= {"beyond_limit": found.left_out, "inliers": _sums(inliers, predicted.offsets)}
    return found._replace(inliers=inliers), counts


def _sums(chosen: Bools, offsets: Ints) -> Ints:
    """Count what is chosen of each query's matches."""
    total = np.concatenate([[0], np.cumsum(chosen)])
    return np.diff(total[offsets])


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
