"""Scoring a scene of the matching track: lift its matches, solve for poses, record their errors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.core.errors import counted
from airzoo_bench.core.progress import Headed
from airzoo_bench.evaluation.track import Run, Scored
from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.matching.checks import NEAR_DEG, NEAR_M, count_near
from airzoo_bench.matching.lifting import Lifted, LiftStatus, lift
from airzoo_bench.matching.metrics import pose_columns, pose_errors
from airzoo_bench.matching.predictions import Correspondences, GivenPoses, ScenePredictions
from airzoo_bench.matching.settings import Lift, MatchingProtocol, MatchingScores
from airzoo_bench.matching.solving import PoseEstimate, PoseQueries, Status, solve_queries
from airzoo_bench.matching.truth import MatchingTruth

_STATUSES = [status.name.lower() for status in LiftStatus]
RECORDED = frozenset(
    ("scene", "query", "answered", "status", "failed", "matches", *_STATUSES, "beyond_limit")
) | {"inliers"}
"""Columns of the records that are neither scores nor conditions of the queries."""

_NOT_LIFTED = {
    "outside_map": "outside the map",
    "outside_dsm": "outside the surface model",
    "no_height": "where the surface model has no height",
}
_SAME_M, _SAME_DEG = 1e-3, 1e-3  # a prior that was copied went through a file at most


def score_scene(
    truth: MatchingTruth, predicted: ScenePredictions, protocol: MatchingProtocol, run: Run
) -> Scored:
    """Score every query of a scene."""
    content, of_matches = predicted.content, dict[str, Ints]()
    if isinstance(content, GivenPoses):
        estimates = _as_estimates(content.poses)
    else:
        estimates, of_matches = _solve(truth, content, protocol, run)
    records = _records(truth, predicted.answered, estimates, of_matches, protocol.scores)
    poses, priors, are_given = _poses_of(estimates), truth.priors, isinstance(content, GivenPoses)
    counts = {
        "queries": len(records),
        "missing": int((~records["answered"]).sum()),
        "failed": int(records["failed"].sum()),
        "left_out": len(truth.excluded),
        **{name: int(column.sum()) for name, column in of_matches.items() if name != "inliers"},
        "equal_to_prior": count_near(poses, priors, _SAME_M, _SAME_DEG) if are_given else 0,
    }
    if protocol.prior.is_measured:
        counts["near_prior"] = count_near(poses, priors, NEAR_M, NEAR_DEG)
    notes = [f"scene {truth.scene}: {note}" for note in _notes(records, counts)]
    seconds = {"seconds": [round(one.seconds, 6) for one in estimates]}
    details = (content, estimates) if run.keep else None
    return Scored(records, counts, content.kind, (*predicted.notes, *notes), seconds, details)


def score_priors(truth: MatchingTruth, settings: MatchingScores) -> pd.DataFrame:
    """Return the records of a method that answers every query by its prior pose."""
    answered = np.ones(len(truth.queries), np.bool_)
    return _records(truth, answered, _as_estimates(truth.priors), {}, settings)


def _notes(records: pd.DataFrame, counts: Mapping[str, int]) -> Iterator[str]:
    """Yield notes on failures by their reason, and on matches that were not used."""
    failures = Counter(records["status"][records["failed"] & records["answered"]])
    if failures:
        who = counted(failures.total(), "answered query has", "answered queries have")
        yield f"{who} no pose ({_listed(failures)}): infinite errors"
    lost = {reason: counts.get(name, 0) for name, reason in _NOT_LIFTED.items()}
    if dropped := sum(lost.values()):
        what = f"{dropped:,} of {counts['matches']:,} matches could not be lifted"
        yield f"{what} and were dropped: {_listed(lost)}"
    if beyond := counts.get("beyond_limit"):
        what = f"{beyond:,} of {counted(counts['matches'], 'match')}"
        yield f"{what} are more than the protocol solves of a query: left out by a seeded choice"


def _listed(reasons: Mapping[str, int]) -> str:
    return ", ".join(f"{count:,} {reason}" for reason, count in sorted(reasons.items()) if count)


def _poses_of(estimates: Sequence[PoseEstimate]) -> Poses:
    return Poses(
        rotation=np.array([one.rotation for one in estimates]).reshape(-1, 3, 3),
        centres=np.array([one.centre for one in estimates]).reshape(-1, 3),
    )


def _as_estimates(poses: Poses) -> list[PoseEstimate]:
    """Return poses that need no solving, NaN where there is none."""
    no_matches = np.zeros(0, np.bool_)
    return [
        PoseEstimate(
            rotation,
            centre,
            no_matches,
            Status.GIVEN if np.isfinite(centre).all() else Status.NOT_GIVEN,
        )
        for rotation, centre in zip(poses.rotation, poses.centres, strict=True)
    ]


def _solve(
    truth: MatchingTruth, matches: Correspondences, protocol: MatchingProtocol, run: Run
) -> tuple[list[PoseEstimate], dict[str, Ints]]:
    """Lift matches and solve for poses; return these, and counts of each query's matches."""
    points, status = _lift_matches(truth, matches, protocol.lift, run.jobs)
    given = np.diff(matches.offsets)
    enough = np.repeat(given >= protocol.solver.least_matches, given)
    lifted = (status == LiftStatus.LIFTED) & enough
    offsets = np.concatenate([[0], np.cumsum(lifted)])[matches.offsets]
    name = f"scene {truth.scene}"
    queries = PoseQueries(name, truth.cameras, offsets, matches.query_xy[lifted], points[lifted])
    progress = Headed(truth.scene, run.progress)
    solved = solve_queries(queries, protocol.solver, replace(run, progress=progress))
    inliers = np.zeros(len(lifted), np.bool_)
    inliers[lifted] = np.concatenate([np.zeros(0, np.bool_), *(one.inliers for one in solved)])
    estimates = [
        replace(one, inliers=inliers[part])
        for one, part in zip(solved, matches.parts(), strict=True)
    ]
    counts = {"matches": given}
    counts |= {name: _count(status == code, matches) for code, name in enumerate(_STATUSES)}
    counts["beyond_limit"] = np.array([one.left_out for one in estimates], np.int64)
    return estimates, counts | {"inliers": _count(inliers, matches)}


def _lift_matches(
    truth: MatchingTruth, matches: Correspondences, lifting: Lift, jobs: int
) -> Lifted:
    """Lift the matches of a scene; points that were given need no lifting."""
    if matches.points3d is not None:
        points = matches.points3d
        return Lifted(points, np.full(len(points), LiftStatus.LIFTED, np.uint8))
    assert matches.map_xy is not None
    heights = None if lifting.heights_above_m == "any" else lifting.heights_above_m
    map_xy = matches.map_xy + (0.5 if lifting.map_pixel_centres == "integer" else 0.0)
    parts: Sequence[slice] = matches.parts() if truth.own_maps else [slice(None)]
    lifted = [
        lift(map_xy[part], one.dom, one.dsm, heights_above_m=heights, jobs=jobs)
        for part, one in zip(parts, truth.maps, strict=True)
    ]
    if len(lifted) == 1:
        return lifted[0]
    points = np.concatenate([np.zeros((0, 3)), *(one.points for one in lifted)])
    return Lifted(points, np.concatenate([np.zeros(0, np.uint8), *(one.status for one in lifted)]))


def _count(chosen: NDArray[np.bool_], matches: Correspondences) -> Ints:
    """Count what is chosen of each query's matches."""
    return np.diff(np.concatenate([[0], np.cumsum(chosen)])[matches.offsets])


def _records(
    truth: MatchingTruth,
    answered: Bools,
    estimates: Sequence[PoseEstimate],
    of_matches: dict[str, Ints],
    settings: MatchingScores,
) -> pd.DataFrame:
    true, poses = truth.poses, _poses_of(estimates)
    rotation = true.rotation if settings.orientation_is_trusted else None
    errors = pose_errors(poses.rotation, poses.centres, rotation, true.centres)
    status = [one.status.value for one in estimates]
    columns: dict[str, Any] = {
        "scene": truth.scene,
        "query": truth.queries["id"].to_numpy(),
        "answered": answered,
        "status": np.where(answered, status, Status.MISSING.value),
        "failed": ~np.isfinite(errors.translation_m),
        **of_matches,
        **pose_columns(errors, settings),
    }
    return pd.concat([pd.DataFrame(columns), truth.conditions], axis=1)
