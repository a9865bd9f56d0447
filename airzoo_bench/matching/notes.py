"""Notes of the matching track: what a reader of its scores, or who checks a file, must know."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from airzoo_bench.core.errors import agreeing, counted
from airzoo_bench.evaluation.track import Scored
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.precision import COARSEST_M
from airzoo_bench.matching.conventions import suspect_inverted, suspect_turned
from airzoo_bench.matching.lifting import LiftStatus
from airzoo_bench.matching.predictions import (
    Correspondences,
    GivenPoses,
    MatchingPredictions,
    lattice_m,
)
from airzoo_bench.matching.scene_predictions import ScenePredictions, count_near
from airzoo_bench.matching.scoring import NEAR_DEG, NEAR_M, NOT_GIVEN, ScoredScene, lifted_points
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.matching.truth import MatchingTruth

__all__ = ["all_notes", "lifting_facts", "plausibility_warnings", "scored_facts"]

# Pixels that all lie within this share of the photo are suspected, if there are enough of them.
_ENOUGH_MATCHES, _MANY_MATCHES = 100, 2000
_CORNER, _CORNER_OF_MANY = 0.6, 0.9
# Beyond any error of GPS, and of poses that mean the right place.
_FAR_M = 1000.0
_NOT_LIFTED = {
    LiftStatus.OUTSIDE_MAP: "outside the map",
    LiftStatus.OUTSIDE_DSM: "outside the surface model",
    LiftStatus.NO_HEIGHT: "where the surface model has no height",
}
_DOUBTS = {
    "poses": "are they world-to-camera, and all coordinates in the scene's CRS?",
    "centres": "are all coordinates in the scene's CRS?",
    "pairs": "poor pairs make such poses, and points that are not in the scene's CRS",
    "matches": "poor matches make such poses",
}


def plausibility_warnings(
    content: Correspondences | GivenPoses, truth: MatchingTruth, predicted: ScenePredictions
) -> list[str]:
    """Return what `check` and `eval` both note of a scene, before any pose is solved."""
    return [
        *_scale_notes(truth, predicted),
        *_inverted_notes(truth, predicted),
        *([f"scene {truth.scene}: {predicted.doubt}"] if predicted.doubt else []),
    ]


def lifting_facts(
    truth: MatchingTruth, predicted: ScenePredictions, protocol: MatchingProtocol, jobs: int
) -> dict[str, Any]:
    """Return those of `scored_facts` that are known of given poses or of lifting alone."""
    facts: dict[str, Any] = {"outside_crop": _outside_crop(truth, predicted)}
    if predicted.poses is not None:
        centres = predicted.poses.centres
        lost = int((predicted.answered & np.isnan(centres).any(axis=1)).sum())
        near = 0
        if protocol.prior.is_measured:
            near = count_near(predicted.poses, truth.priors, NEAR_M, NEAR_DEG)
        return facts | {
            "reasons": {NOT_GIVEN: lost} if lost else {},
            "near_prior": near,
            **_far_facts(centres, truth),
        }
    _, status = lifted_points(truth, predicted, protocol.lift, jobs)
    blind = beyond = 0
    for part in predicted.parts():
        counts = np.bincount(status[part], minlength=len(LiftStatus))
        blind += int(counts[LiftStatus.LIFTED] == 0 < counts[LiftStatus.NO_HEIGHT])
        beyond += max(0, int(counts[LiftStatus.LIFTED]) - protocol.solver.max_matches)
    lost_by = {one.name.lower(): int((status == one).sum()) for one in _NOT_LIFTED}
    return facts | {"matches": len(status), "blind": blind, "beyond_limit": beyond, **lost_by}


def scored_facts(
    found: ScoredScene, truth: MatchingTruth, predicted: ScenePredictions
) -> dict[str, Any]:
    """Return what `all_notes` needs of a scene whose poses are solved, and the times it took."""
    records, blind = found.records, 0
    if "lifted" in records.columns:
        blind = int(((records["no_height"] > 0) & (records["lifted"] == 0)).sum())
    failed = records["status"][records["failed"] & records["answered"]]
    return {
        "outside_crop": _outside_crop(truth, predicted),
        "reasons": {str(why): int(n) for why, n in failed.value_counts().sort_index().items()},
        "blind": blind,
        **found.counts,
        **_far_facts(found.centres, truth),
        "seconds": np.round(found.seconds, 6).tolist(),
    }


def _far_facts(centres: Floats, truth: MatchingTruth) -> dict[str, int]:
    offsets = centres - truth.priors.centres
    with np.errstate(over="ignore"):
        far = int((np.linalg.norm(offsets, axis=1) > _FAR_M).sum())
    return {"far": far, "posed": int((~np.isnan(offsets).any(axis=1)).sum())}


def all_notes(
    predictions: MatchingPredictions, truths: Sequence[MatchingTruth], scored: Sequence[Scored]
) -> list[str]:
    """Return what there is to say of all scenes: failures, lost matches, poses far away."""
    sums: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    for scene in scored:
        sums.update({key: n for key, n in scene.facts.items() if isinstance(n, int)})
        reasons.update(scene.facts.get("reasons", {}))
    dropped = {why: sums[status.name.lower()] for status, why in _NOT_LIFTED.items()}
    outside = counted(sums["outside_crop"], "map pixel lies", "map pixels lie")
    return [
        *([f"scored from {predictions.content.kind}"] if "seconds" in scored[0].facts else []),
        *_failed_notes(dict(sorted(reasons.items()))),
        *_count_notes(sums["matches"], dropped, sums["blind"], sums["beyond_limit"]),
        *_far_notes(sums["far"], sums["posed"], predictions),
        *_prior_notes(sums["near_prior"], truths),
        *_lattice_notes(predictions.content, truths),
        *([f"{outside} outside the query's crop"] if sums["outside_crop"] else []),
    ]


def _far_notes(far: int, posed: int, predictions: MatchingPredictions) -> list[str]:
    """Suspect another frame or convention where poses lie beyond any GPS error."""
    if not far:
        return []
    content = predictions.content
    centred = isinstance(content, GivenPoses) and content.centred
    return [
        f"{far:,} of {counted(posed, 'pose')} "
        f"{agreeing(far, 'lies', 'lie')} more than {_FAR_M:,g} m from the "
        f"photo's GPS position: {_DOUBTS['centres' if centred else content.kind]}"
    ]


def _failed_notes(reasons: dict[str, int]) -> list[str]:
    count = sum(reasons.values())
    if not count:
        return []
    listed = ", ".join(f"{number:,} {reason}" for reason, number in reasons.items())
    who = counted(count, "answered query has", "answered queries have")
    return [f"{who} no pose ({listed}): infinite errors"]


def _count_notes(given: int, lost: dict[str, int], blind: int, beyond: int) -> list[str]:
    """Return how many matches were lost before solving, and why."""
    notes = []
    if dropped := sum(lost.values()):
        reasons = ", ".join(f"{number:,} {why}" for why, number in lost.items() if number)
        notes.append(
            f"{dropped:,} of {given:,} matches could not be lifted and were dropped: {reasons}"
        )
    if blind:
        queries = counted(blind, "query", "queries")
        notes.append(f"the surface model has no height under any match of {queries}")
    if beyond:
        notes.append(
            f"{beyond:,} of {counted(given, 'match')} {agreeing(beyond, 'is', 'are')} more than "
            "the protocol solves of a query: left out by a seeded choice"
        )
    return notes


def _prior_notes(near: int, truths: Sequence[MatchingTruth]) -> list[str]:
    if not near:
        return []
    total = sum(len(truth.queries) for truth in truths)
    return [
        f"{near:,} of {total:,} answers equal the prior, the photo's own GPS and gimbal angles, "
        f"within {NEAR_M * 100:g} cm and {NEAR_DEG:g} degrees"
    ]


def _lattice_notes(
    content: Correspondences | GivenPoses, truths: Sequence[MatchingTruth]
) -> list[str]:
    """Say how much centres lose that are all places of a lattice, such as whole metres."""
    if not (isinstance(content, GivenPoses) and content.centred):
        return []
    lost = float(content.errors_m.max(initial=0.0))
    if lost <= max(COARSEST_M, *(lattice_m(truth.poses.centres) for truth in truths)):
        return []
    return [
        f"centres lie on a lattice, such as whole metres: if they were rounded to it, they are "
        f"{lost:.2g} m off on average"
    ]


def _inverted_notes(truth: MatchingTruth, predicted: ScenePredictions) -> list[str]:
    if predicted.poses is None:
        return []
    found = np.isfinite(predicted.poses.centres).all(axis=1)
    given, priors = predicted.poses.take(found), truth.priors.take(found)
    said = suspect_turned(given, priors) or suspect_inverted(given, priors)
    return [f"scene {truth.scene}: {said}"] if said else []


def _outside_crop(truth: MatchingTruth, predicted: ScenePredictions) -> int:
    """Count matches that the query's crop could not have given."""
    if predicted.map_xy is None:
        return 0
    crop = np.repeat(truth.crops, np.diff(predicted.offsets), axis=0)
    local = predicted.map_xy - crop[:, :2]
    return int(((local < -1) | (local > crop[:, 2:] + 1)).any(axis=1).sum())


def _scale_notes(truth: MatchingTruth, predicted: ScenePredictions) -> list[str]:
    """Suspect pixels of a smaller image: they would all lie in a corner of the photos."""
    count = len(predicted.query_xy)
    if count < _ENOUGH_MATCHES:
        return []
    size = np.stack([truth.cameras.width, truth.cameras.height], axis=1)
    reach = (predicted.query_xy / np.repeat(size, np.diff(predicted.offsets), axis=0)).max(axis=0)
    if not (reach < (_CORNER if count < _MANY_MATCHES else _CORNER_OF_MANY)).all():
        return []
    return [
        f"scene {truth.scene}: no match lies beyond {reach[0]:.0%} of the photos' width "
        f"and {reach[1]:.0%} of their height: are the matches in the size of a smaller image?"
    ]
