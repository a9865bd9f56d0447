"""Notes of the matching track: what a reader of its scores, or who checks a file, must know."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from airzoo_bench.core.plurals import agreeing, counted
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

__all__ = ["lifting_notes", "plausibility_warnings", "scored_notes"]

_Scene = tuple[MatchingTruth, ScenePredictions]

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
    predictions: MatchingPredictions,
    truths: Sequence[MatchingTruth],
    scene_predictions: Sequence[ScenePredictions],
) -> list[str]:
    """Return what `check` and `eval` both note, before any pose is solved."""
    scenes = list(zip(truths, scene_predictions, strict=True))
    return [
        *_lattice_notes(predictions.content, truths),
        *_scale_notes(scenes),
        *_crop_notes(scenes),
        *_inverted_notes(scenes),
        *(f"scene {truth.scene}: {one.doubt}" for truth, one in scenes if one.doubt),
    ]


def lifting_notes(
    predictions: MatchingPredictions,
    truths: Sequence[MatchingTruth],
    scene_predictions: Sequence[ScenePredictions],
    protocol: MatchingProtocol,
    jobs: int,
) -> list[str]:
    """Return what `eval` will note of given poses or of lifting, without solving."""
    given = [one for one in scene_predictions if one.poses is not None]
    if given:
        centres = [one.poses.centres for one in given if one.poses is not None]
        lost = sum(
            int((one.answered & np.isnan(there).any(axis=1)).sum())
            for one, there in zip(given, centres, strict=True)
        )
        near = 0
        if protocol.prior.is_measured:
            near = sum(
                count_near(one.poses, truth.priors, NEAR_M, NEAR_DEG)
                for truth, one in zip(truths, given, strict=True)
                if one.poses is not None
            )
        return [
            *_failed_notes({NOT_GIVEN: lost}),
            *_far_notes(truths, centres, predictions),
            *_prior_notes(near, truths),
        ]
    became = np.zeros(len(LiftStatus), np.int64)
    blind = beyond = 0
    for truth, predicted in zip(truths, scene_predictions, strict=True):
        _, status = lifted_points(truth, predicted, protocol.lift, jobs)
        for part in predicted.parts():
            counts = np.bincount(status[part], minlength=len(LiftStatus))
            blind += int(counts[LiftStatus.LIFTED] == 0 < counts[LiftStatus.NO_HEIGHT])
            beyond += max(0, int(counts[LiftStatus.LIFTED]) - protocol.solver.max_matches)
            became += counts
    dropped = {why: int(became[status]) for status, why in _NOT_LIFTED.items()}
    return _count_notes(int(became.sum()), dropped, blind, beyond)


def scored_notes(
    predictions: MatchingPredictions,
    truths: Sequence[MatchingTruth],
    scored: Sequence[ScoredScene],
) -> list[str]:
    """Return what is known once poses are solved: failures, lost matches, poses far away."""
    kind = predictions.content.kind
    reasons: Counter[str] = Counter()
    sums: Counter[str] = Counter()
    blind = 0
    for scene in scored:
        records = scene.records
        reasons.update(records["status"][records["failed"] & records["answered"]])
        sums.update(scene.counts)
        if "lifted" in records.columns:
            blind += int(((records["no_height"] > 0) & (records["lifted"] == 0)).sum())
    dropped = {why: sums[status.name.lower()] for status, why in _NOT_LIFTED.items()}
    return [
        f"scored from {kind}",
        *_failed_notes(dict(sorted(reasons.items()))),
        *_count_notes(sums["matches"], dropped, blind, sums["beyond_limit"]),
        *_far_notes(truths, [scene.centres for scene in scored], predictions),
        *_prior_notes(sums["near_prior"], truths),
    ]


def _far_notes(
    truths: Sequence[MatchingTruth], centres: Sequence[Floats], predictions: MatchingPredictions
) -> list[str]:
    """Suspect another frame or convention where poses lie beyond any GPS error."""
    offsets = np.concatenate([c - t.priors.centres for t, c in zip(truths, centres, strict=True)])
    with np.errstate(over="ignore"):
        far = int((np.linalg.norm(offsets, axis=1) > _FAR_M).sum())
    if not far:
        return []
    content = predictions.content
    centred = isinstance(content, GivenPoses) and content.centred
    return [
        f"{far:,} of {counted(int((~np.isnan(offsets).any(axis=1)).sum()), 'pose')} "
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


def _inverted_notes(scenes: Sequence[_Scene]) -> list[str]:
    notes = []
    for truth, predicted in scenes:
        if predicted.poses is not None:
            found = np.isfinite(predicted.poses.centres).all(axis=1)
            given, priors = predicted.poses.take(found), truth.priors.take(found)
            said = suspect_turned(given, priors) or suspect_inverted(given, priors)
            notes += [f"scene {truth.scene}: {said}"] if said else []
    return notes


def _crop_notes(scenes: Sequence[_Scene]) -> list[str]:
    """Count matches that the query's crop could not have given."""
    outside = 0
    for truth, predicted in scenes:
        if predicted.map_xy is not None:
            crop = np.repeat(truth.crops, np.diff(predicted.offsets), axis=0)
            local = predicted.map_xy - crop[:, :2]
            outside += int(((local < -1) | (local > crop[:, 2:] + 1)).any(axis=1).sum())
    lying = counted(outside, "map pixel lies", "map pixels lie")
    return [f"{lying} outside the query's crop"] if outside else []


def _scale_notes(scenes: Sequence[_Scene]) -> list[str]:
    """Suspect pixels of a smaller image: they would all lie in a corner of the photos."""
    notes = []
    for truth, predicted in scenes:
        count = len(predicted.query_xy)
        if count < _ENOUGH_MATCHES:
            continue
        size = np.stack([truth.cameras.width, truth.cameras.height], axis=1)
        reach = (predicted.query_xy / np.repeat(size, np.diff(predicted.offsets), axis=0)).max(
            axis=0
        )
        if (reach < (_CORNER if count < _MANY_MATCHES else _CORNER_OF_MANY)).all():
            notes.append(
                f"scene {truth.scene}: no match lies beyond {reach[0]:.0%} of the photos' width "
                f"and {reach[1]:.0%} of their height: are the matches in the size of a smaller "
                "image?"
            )
    return notes
