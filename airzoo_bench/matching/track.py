"""The matching track: matches are lifted, poses are solved for, and their errors recorded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.core.progress import Headed
from airzoo_bench.evaluation.queries import assign_queries, write_predictions
from airzoo_bench.evaluation.track import Assignment, Run, Scored, Track
from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.matching.checks import NEAR_DEG, NEAR_M, ScenePart, count_near, open_scene
from airzoo_bench.matching.info import INFO
from airzoo_bench.matching.lifting import Lifted, LiftStatus, lift
from airzoo_bench.matching.metrics import matching_scores, pose_columns, pose_errors
from airzoo_bench.matching.predictions import (
    Correspondences,
    GivenPoses,
    MatchingPredictions,
    read_matching,
)
from airzoo_bench.matching.settings import Lift, MatchingProtocol, MatchingScores
from airzoo_bench.matching.solving import PoseEstimate, Status, solve_queries
from airzoo_bench.matching.truth import MatchingTruth, read_truth
from airzoo_bench.results.result import Reference
from airzoo_bench.results.scores import Score, concatenate, summarise

_STATUSES = [status.name.lower() for status in LiftStatus]
_NOT_LIFTED = {
    "outside_map": "outside the map",
    "outside_dsm": "outside the surface model",
    "no_height": "where the surface model has no height",
}
_SAME_M, _SAME_DEG = 1e-3, 1e-3  # a prior that was copied went through a file at most
_TEMPLATE_MATCHES = 20  # of each query


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
        for place, truth in enumerate(truths):
            rows, assignment.parts[place] = assignment.parts[place].rows, None
            try:
                assignment.parts[place] = open_scene(predictions, truth, rows, protocol)
            except PredictionError as error:
                assignment.errors.append(error.inside(predictions.path))
        return assignment

    def score(
        self, part: ScenePart, truth: MatchingTruth, protocol: MatchingProtocol, run: Run
    ) -> Scored:
        """See `Track.score`."""
        content, of_matches = part.content, dict[str, Ints]()
        if isinstance(content, GivenPoses):
            estimates = _as_estimates(content.poses)
        else:
            estimates, of_matches = _solve(truth, content, protocol, run)
        poses, records = _record(truth, part.answered, estimates, of_matches, protocol.scores)
        counts = {
            "queries": len(records),
            "missing": int((~records["answered"]).sum()),
            "failed": int(records["failed"].sum()),
            "left_out": len(truth.excluded),
            **{name: int(column.sum()) for name, column in of_matches.items() if name != "inliers"},
            "equal_to_prior": 0,
        }
        if isinstance(content, GivenPoses):
            counts["equal_to_prior"] = count_near(poses, truth.priors, _SAME_M, _SAME_DEG)
        if protocol.prior.is_measured:
            counts["near_prior"] = count_near(poses, truth.priors, NEAR_M, NEAR_DEG)
        notes = [f"scene {truth.scene}: {note}" for note in _notes(records, counts)]
        details = (content, estimates) if run.keep else None
        return Scored(records, counts, content.kind, (*part.notes, *notes), details=details)

    def check(
        self, part: ScenePart, truth: MatchingTruth, protocol: MatchingProtocol, run: Run
    ) -> Scored:
        """See `Track.check`."""
        return Scored(counts={"queries": len(truth.queries)}, notes=part.notes)

    def scores(self, protocol: MatchingProtocol) -> list[Score]:
        """See `Track.scores`."""
        return matching_scores(protocol.scores)

    def notes(
        self,
        predictions: MatchingPredictions,
        truths: Sequence[MatchingTruth],
        protocol: MatchingProtocol,
        scored: Sequence[Scored],
    ) -> list[str]:
        """Say what was scored, which no scene says for itself."""
        return [f"scored from {one.kind}" for one in scored[:1] if one.kind]

    def references(
        self, protocol: MatchingProtocol, truths: Sequence[MatchingTruth]
    ) -> dict[str, Reference]:
        """Score the priors as if they were a method's poses; where none are measured, nothing."""
        if not protocol.prior.is_measured:
            return {}
        records = []
        for one in truths:
            answered, given = np.ones(len(one.queries), np.bool_), _as_estimates(one.priors)
            records.append(_record(one, answered, given, {}, protocol.scores)[1])
        scores, scenes = matching_scores(protocol.scores), [truth.scene for truth in truths]
        summary = summarise(concatenate(records), scores, scenes)
        meaning = "what the photos' own GPS and gimbal angles score, without any matching"
        return {"Prior itself": Reference(meaning=meaning, **asdict(summary))}

    def template(
        self,
        out: Path,
        truths: Sequence[MatchingTruth],
        protocol: MatchingProtocol,
        kind: str,
        seed: int,
    ) -> str | None:
        """Match random pixels of every query to random pixels of its crop."""
        random = np.random.default_rng(seed)
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
        return None


def _as_estimates(poses: Poses) -> list[PoseEstimate]:
    """Return poses that need no solving, NaN where there is none."""
    none, found = np.zeros(0, np.bool_), np.isfinite(poses.centres).all(axis=1)
    status = np.where(found, Status.GIVEN, Status.NOT_GIVEN).tolist()
    rows = zip(poses.rotation, poses.centres, status, strict=True)
    return [PoseEstimate(rotation, centre, none, Status(one)) for rotation, centre, one in rows]


def _solve(
    truth: MatchingTruth, matches: Correspondences, protocol: MatchingProtocol, run: Run
) -> tuple[list[PoseEstimate], dict[str, Ints]]:
    """Lift matches and solve for poses; return these, and counts of each query's matches."""
    points, status = _lift_matches(truth, matches, protocol.lift, run.jobs)
    given = np.diff(matches.offsets)
    enough = (given >= protocol.solver.least_matches)[matches.query]
    lifted = (status == LiftStatus.LIFTED) & enough
    offsets = np.concatenate([[0], np.cumsum(lifted)])[matches.offsets]
    pairs = Correspondences(offsets, matches.query_xy[lifted], points3d=points[lifted])
    run = replace(run, progress=Headed(truth.scene, run.progress))
    solved = solve_queries(truth.cameras, pairs, protocol.solver, run, f"scene {truth.scene}")
    inliers = np.zeros(len(lifted), np.bool_)
    inliers[lifted] = np.concatenate([np.zeros(0, np.bool_), *(one.inliers for one in solved)])
    parts = zip(solved, matches.parts(), strict=True)
    estimates = [replace(one, inliers=inliers[part]) for one, part in parts]

    def count(chosen: Bools) -> Ints:
        return np.bincount(matches.query[chosen], minlength=len(given))

    counts = {"matches": given}
    counts |= {name: count(status == code) for code, name in enumerate(_STATUSES)}
    counts["beyond_limit"] = np.array([one.left_out for one in estimates], np.int64)
    return estimates, counts | {"inliers": count(inliers)}


def _lift_matches(
    truth: MatchingTruth, matches: Correspondences, lifting: Lift, jobs: int
) -> Lifted:
    """Lift the matches of a scene; points that were given need no lifting."""
    if matches.map_xy is None:
        assert matches.points3d is not None
        lifted = np.full(len(matches.points3d), LiftStatus.LIFTED, np.uint8)
        return Lifted(matches.points3d, lifted)
    heights = None if lifting.heights_above_m == "any" else lifting.heights_above_m
    map_xy = matches.map_xy + (0.5 if lifting.map_pixel_centres == "integer" else 0.0)
    parts: Sequence[slice] = matches.parts() if truth.own_maps else [slice(None)]
    found = [
        lift(map_xy[part], one.dom, one.dsm, heights_above_m=heights, jobs=jobs)
        for part, one in zip(parts, truth.maps, strict=True)
    ]
    return Lifted(*map(np.concatenate, zip(*found, strict=True)))


def _record(
    truth: MatchingTruth,
    answered: Bools,
    estimates: Sequence[PoseEstimate],
    of_matches: dict[str, Ints],
    settings: MatchingScores,
) -> tuple[Poses, pd.DataFrame]:
    """Return the estimates as poses, and the records of their errors."""
    rotation = np.array([one.rotation for one in estimates]).reshape(-1, 3, 3)
    centres = np.array([one.centre for one in estimates]).reshape(-1, 3)
    true = truth.poses.rotation if settings.orientation_is_trusted else None
    errors = pose_errors(rotation, centres, true, truth.poses.centres)
    status = [one.status.value for one in estimates]
    columns = {
        "scene": truth.scene,
        "query": truth.queries["id"].to_numpy(),
        "answered": answered,
        "status": np.where(answered, status, Status.MISSING.value),
        "failed": ~np.isfinite(errors.translation_m),
        **of_matches,
        **pose_columns(errors, settings),
    }
    records = pd.concat([pd.DataFrame(columns), truth.conditions], axis=1)
    return Poses(rotation=rotation, centres=centres), records


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


TRACK = MatchingTrack()
