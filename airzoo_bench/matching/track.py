"""The matching track: matches are lifted, poses are solved for, and their errors recorded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import conditions_of
from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.evaluation.predictions import assign_queries, write_predictions
from airzoo_bench.evaluation.track import Assignment, Run, SceneScores, Track
from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.matching.checks import NEAR_DEG, NEAR_M, check_scene, doubt_shift
from airzoo_bench.matching.info import INFO
from airzoo_bench.matching.metrics import count_near, matching_scores, pose_columns, pose_errors
from airzoo_bench.matching.predictions import (
    Correspondences,
    MatchingPredictions,
    PredictedPoses,
    read_matching,
)
from airzoo_bench.matching.protocol import Lift, MatchingProtocol, MatchingScores
from airzoo_bench.matching.solving import Lifted, LiftStatus, Status, lift, solve_queries
from airzoo_bench.matching.truth import MatchingTruth, read_truth
from airzoo_bench.results.result import Reference, ScoreColumn, summarise

_STATUSES = [status.name.lower() for status in LiftStatus]
_COUNTED = ("matches", *_STATUSES, "beyond_limit")
_SAME = (1e-3, 1e-3)  # m and degrees: a prior that was copied went through a file at most
_TEMPLATE_MATCHES = 20  # of each query


class SceneAnswers(NamedTuple):
    """The predictions for the Q queries of a scene, in their order."""

    answered: Bools  # (Q,), which queries the file has
    content: Correspondences | PredictedPoses  # in pixels of the whole map
    doubts: tuple[str, ...]


class MatchingTrack(Track):
    """Cross-view matching; see `Track`."""

    info = INFO
    protocol = MatchingProtocol
    recorded = frozenset(
        ("scene", "query", "answered", "status", "failed", "matches", "inliers", "beyond_limit")
    ) | {*_STATUSES}

    def open(self, path: Path, memory_bytes: int) -> MatchingPredictions:
        """See `Track.open`."""
        return read_matching(path, memory_bytes)

    def truth(self, benchmark: Benchmark, scene: str) -> MatchingTruth:
        """See `Track.truth`."""
        return read_truth(benchmark, scene)

    def assign(
        self,
        predictions: MatchingPredictions,
        truths: Sequence[MatchingTruth],
        protocol: MatchingProtocol,
    ) -> Assignment:
        """See `Track.assign`; errors of all scenes are found before any pose is solved."""
        assignment = assign_queries(predictions, truths, protocol)
        assignment.facts.append(f"{predictions.content.kind} are scored")
        assignment.facts.extend(_fine_thresholds(truths, protocol.scores))
        for number, truth in enumerate(truths):
            rows, assignment.parts[number] = assignment.parts[number].rows, None
            content, answered = predictions.content.take(rows), rows >= 0
            if isinstance(content, Correspondences):
                content = content.on_map(truth.crops)
            try:
                doubts = check_scene(content, truth, answered, protocol)
                assignment.parts[number] = SceneAnswers(answered, content, doubts)
            except PredictionError as error:
                assignment.errors.append(error.inside(predictions.path))
        return assignment

    def score(
        self, part: SceneAnswers, truth: MatchingTruth, protocol: MatchingProtocol, run: Run
    ) -> SceneScores:
        """See `Track.score`."""
        content, given = part.content, isinstance(part.content, PredictedPoses)
        if isinstance(content, PredictedPoses):
            poses, columns, inliers = content.poses, dict[str, NDArray[Any]](), None
        else:
            poses, columns, inliers = _solve(truth, content, protocol, run)
        records = _record(truth, part.answered, poses, columns, protocol.scores)
        counts = {"queries": len(records), "missing": int((~part.answered).sum())}
        counts |= {"failed": int(records["failed"].sum()), "left_out": len(truth.excluded)}
        counts |= {name: int(columns[name].sum()) for name in _COUNTED if name in columns}
        counts["equal_to_prior"] = count_near(poses, truth.priors, *_SAME) if given else 0
        if protocol.prior.is_measured:
            counts["near_prior"] = count_near(poses, truth.priors, NEAR_M, NEAR_DEG)
        found = [*_notes(counts)]
        # Poses that were given are doubted by their check.
        found += () if given else doubt_shift(poses.centres, truth.poses.centres)
        notes = [f"scene {truth.scene}: {note}" for note in found]
        details = (content, poses, inliers) if run.keep else None
        return SceneScores(records, counts, content.kind, (*part.doubts, *notes), {}, details)

    def check(
        self, part: SceneAnswers, truth: MatchingTruth, protocol: MatchingProtocol, run: Run
    ) -> SceneScores:
        """See `Track.check`."""
        return SceneScores(counts={"queries": len(truth.queries)}, notes=part.doubts)

    def scores(self, protocol: MatchingProtocol) -> list[ScoreColumn]:
        """See `Track.scores`."""
        return matching_scores(protocol.scores)

    def references(
        self, protocol: MatchingProtocol, truths: Sequence[MatchingTruth]
    ) -> dict[str, Reference]:
        """Score the priors as if they were a method's poses; where none are measured, nothing."""
        if not protocol.prior.is_measured:
            return {}
        records = [
            _record(one, np.ones(len(one.queries), np.bool_), one.priors, {}, protocol.scores)
            for one in truths
        ]
        scores, scenes = matching_scores(protocol.scores), [truth.scene for truth in truths]
        summary = summarise(pd.concat(records, ignore_index=True), scores, scenes)
        meaning = "what the priors score as poses, without any matching"
        return {"Prior itself": Reference(meaning=meaning, **asdict(summary))}

    def template(
        self,
        out: Path,
        truths: Sequence[MatchingTruth],
        protocol: MatchingProtocol,
        kind: str,
    ) -> None:
        """Match random pixels of every query to random pixels of its crop."""
        random = np.random.default_rng(0)
        sizes = [np.stack([t.cameras.width, t.cameras.height], axis=1) for t in truths]
        size = np.repeat(np.concatenate(sizes), _TEMPLATE_MATCHES, axis=0)
        crop = np.repeat(np.concatenate([t.crops for t in truths]), _TEMPLATE_MATCHES, axis=0)
        ids = np.concatenate([t.queries["id"].to_numpy(str) for t in truths])
        arrays = {
            "query_ids": ids,
            "offsets": np.arange(len(ids) + 1) * _TEMPLATE_MATCHES,
            "query_xy": random.uniform(0, size),
            "map_xy": crop[:, :2] + random.uniform(0, crop[:, 2:]),
        }
        write_predictions(out, protocol.name, arrays)


def _solve(
    truth: MatchingTruth, matches: Correspondences, protocol: MatchingProtocol, run: Run
) -> tuple[Poses, dict[str, NDArray[Any]], Bools]:
    """Solve for the poses of a scene; return these, columns of records, and a mask of inliers."""
    points, status = _lift_matches(truth, matches, protocol.lift, run.jobs)
    of_query = np.diff(matches.offsets)
    enough = (of_query >= protocol.solver.least_matches)[matches.query]
    lifted = (status == LiftStatus.LIFTED) & enough
    offsets = np.concatenate([[0], np.cumsum(lifted)])[matches.offsets]
    pairs = Correspondences(offsets, matches.query_xy[lifted], points3d=points[lifted])
    solved = solve_queries(truth.cameras, pairs, protocol.solver, run, f"scene {truth.scene}")
    inliers = np.zeros(len(lifted), np.bool_)
    inliers[lifted] = np.concatenate([np.zeros(0, np.bool_), *(one.inliers for one in solved)])

    def count(chosen: Bools) -> Ints:
        return np.bincount(matches.query[chosen], minlength=len(of_query))

    columns = {"status": np.array([one.status.value for one in solved], str), "matches": of_query}
    columns |= {name: count(status == code) for code, name in enumerate(_STATUSES)}
    columns["beyond_limit"] = np.array([one.beyond_limit for one in solved], np.int64)
    rotation = np.array([one.rotation for one in solved]).reshape(-1, 3, 3)
    centres = np.array([one.centre for one in solved]).reshape(-1, 3)
    poses = Poses(rotation=rotation, centres=centres)
    return poses, columns | {"inliers": count(inliers)}, inliers


def _lift_matches(
    truth: MatchingTruth, matches: Correspondences, lifting: Lift, jobs: int
) -> Lifted:
    """Lift the matches of a scene; points that were given need no lifting."""
    if matches.points3d is not None:
        return Lifted(matches.points3d, np.zeros(len(matches.points3d), np.uint8))
    assert matches.map_xy is not None
    heights = None if lifting.heights_above_m == "any" else lifting.heights_above_m
    map_xy = matches.map_xy + (0.5 if lifting.map_pixel_centres == "integer" else 0.0)
    slices: Sequence[slice] = matches.row_slices() if truth.map_per_query else [slice(None)]
    lifted = [
        lift(map_xy[part], one.dom, one.dsm, heights_above_m=heights, jobs=jobs)
        for part, one in zip(slices, truth.maps, strict=True)
    ]
    return Lifted(*map(np.concatenate, zip(*lifted, strict=True)))


def _record(
    truth: MatchingTruth,
    answered: Bools,
    poses: Poses,
    columns: Mapping[str, NDArray[Any]],
    scores: MatchingScores,
) -> pd.DataFrame:
    """Return the errors and scores of poses, a row a query; without a status they were given."""
    true = truth.poses.rotation if scores.orientation_is_trusted else None
    errors = pose_errors(poses.rotation, poses.centres, true, truth.poses.centres)
    failed = ~np.isfinite(errors.translation_m)
    status = columns.get("status", np.where(failed, Status.NOT_GIVEN.value, Status.GIVEN.value))
    known = {
        "scene": truth.scene,
        "query": truth.queries["id"].to_numpy(),
        "answered": answered,
        "status": np.where(answered, status, Status.MISSING.value),
        "failed": failed,
    }
    table = pd.DataFrame(known | {**columns, **known} | pose_columns(errors, scores))
    return pd.concat([table, conditions_of(truth.queries)], axis=1)


def _fine_thresholds(truths: Sequence[MatchingTruth], scores: MatchingScores) -> list[str]:
    """Return a note on thresholds finer than three times the true positions' standard error."""
    error = max(truth.accuracy_m for truth in truths)
    limits = {f"@{m:g}m": m for m in scores.translation_below_m}
    if scores.orientation_is_trusted:
        limits |= {f"@{m:g}m,{deg:g}°": m for m, deg in scores.pose_below_m_deg}
    fine = ", ".join(name for name, m in limits.items() if m < 3 * error)
    return [f"the truth is good to {error:g} m: {fine} measure it too"] if fine else []


def _notes(counts: Mapping[str, int]) -> Iterator[str]:
    """Yield notes on failures, and on matches that were not used."""
    if failed := counts["failed"] - counts["missing"]:
        who = counted(failed, "answered query has", "answered queries have")
        yield f"{who} no pose: infinite errors"
    matches = counted(counts.get("matches", 0), "match")
    if lost := sum(counts.get(name, 0) for name in _STATUSES[1:]):
        yield f"{lost:,} of {matches} lie where the map has no height, and were dropped"
    if beyond := counts.get("beyond_limit"):
        what = f"{beyond:,} of {matches}"
        yield f"{what} are more than the protocol solves of a query: left out by a seeded choice"


TRACK = MatchingTrack()
