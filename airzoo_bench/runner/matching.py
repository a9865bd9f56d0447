"""The matching track: from a prediction file to records and a result."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark import Benchmark, find_benchmark
from airzoo_bench.files import atomic_write
from airzoo_bench.matching.claims import SceneClaim, claim_of_scene
from airzoo_bench.matching.predictions import MatchingPredictions, PoseClaim, faults
from airzoo_bench.matching.scores import matching_scores
from airzoo_bench.matching.track import ScoredScene, score_scene
from airzoo_bench.matching.truth import MatchingTruth, read_truth
from airzoo_bench.progress import Progress, silent
from airzoo_bench.protocol import MatchingProtocol
from airzoo_bench.readers.matching import read_matching
from airzoo_bench.runner.common import (
    Checked,
    Evaluation,
    Run,
    check_against_benchmark,
    choose_protocol,
    concatenate,
    make_result,
    match_queries,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "MatchingEvaluation",
    "check_matching",
    "evaluate_matching",
    "read_matching_truths",
    "save_timings",
]

# Pixels that all lie within this share of the photo are suspected, if there are enough of them.
_ENOUGH_MATCHES = 100
_CORNER = 0.6
# Beyond any error of GPS, and of poses that mean the right place.
_FAR_M = 1000.0


@dataclass(frozen=True, eq=False)
class MatchingEvaluation:
    """An evaluation, and what pictures need beside it; by scene."""

    evaluation: Evaluation
    protocol: MatchingProtocol
    truths: list[MatchingTruth]
    claims: list[SceneClaim]
    scored: list[ScoredScene]


def evaluate_matching(
    path: Path,
    *,
    data: Path,
    protocol: str | None = None,
    method: str | None = None,
    memory_bytes: int,
    jobs: int = 1,
    progress: Progress = silent,
) -> MatchingEvaluation:
    """Score a prediction file of the matching track.

    Parameters
    ----------
    path : Path
        The predictions: matches, 2D-3D pairs, or poses.
    data : Path
        The benchmark folder, or the folder that holds it.
    protocol : str, optional
        Name or path; by default the file's own.
    method : str, optional
        What tables call it; by default the file's stem.
    memory_bytes : int
        The most that one array of the file may take.
    jobs : int
        Threads for lifting and solving; the numbers do not depend on it.
    progress : Progress
        Shows poses as they are solved.

    Raises
    ------
    UserError
        The predictions, the protocol or the benchmark folder are not as they must be.
    """
    predictions = read_matching(path, memory_bytes)
    chosen = choose_protocol(path, predictions.protocol, protocol, data, MatchingProtocol)
    for fault in faults(predictions):
        raise fault
    benchmark = find_benchmark(chosen.benchmark, data)
    truths = read_matching_truths(benchmark, chosen)
    rows, extra = match_queries(path, predictions.query_ids, chosen, data, truths)
    pairs = list(zip(truths, rows, strict=True))
    claims = [claim_of_scene(predictions, truth, found) for truth, found in pairs]
    scored = [
        score_scene(
            truth,
            claim,
            chosen.lift,
            chosen.solver,
            chosen.scores,
            workers=jobs,
            progress=progress,
        )
        for truth, claim in zip(truths, claims, strict=True)
    ]
    records = concatenate([scene.records for scene in scored])
    run = Run(
        path,
        method or path.stem,
        predictions.kind,
        chosen,
        benchmark,
        {truth.scene: truth.fingerprint for truth in truths},
    )
    counts = {truth.scene: _counts(truth, records) for truth in truths}
    notes = [
        *_notes(records, predictions),
        *_scale_notes(predictions, truths),
        *_far_notes(truths, scored),
        *_crop_notes(truths, claims),
    ]
    result = make_result(run, records, matching_scores(chosen.scores), counts, extra, notes)
    return MatchingEvaluation(Evaluation(result, records), chosen, truths, claims, scored)


def check_matching(path: Path, *, data: Path, protocol: str | None, memory_bytes: int) -> Checked:
    """Find all that is wrong with a prediction file, without looking at true poses.

    Where the benchmark folder is there, ids are held against its queries, pixels against photos
    and crops, and poses against the priors.

    Raises
    ------
    UserError
        The file cannot be read at all, or the protocol is unknown.
    """
    predictions = read_matching(path, memory_bytes)
    chosen = choose_protocol(path, predictions.protocol, protocol, data, MatchingProtocol)
    found = list(faults(predictions))
    if found:
        return Checked(found, [])
    return check_against_benchmark(
        path,
        predictions.query_ids,
        chosen,
        data,
        lambda: read_matching_truths(find_benchmark(chosen.benchmark, data), chosen),
        lambda truth, rows: claim_of_scene(predictions, truth, rows),
        lambda truths: _scale_notes(predictions, truths),
    )


def read_matching_truths(benchmark: Benchmark, protocol: MatchingProtocol) -> list[MatchingTruth]:
    """Read the truth of every scene of a protocol, in its order."""
    benchmark.check_fits(protocol)
    return [read_truth(benchmark, scene.id) for scene in protocol.scenes]


def save_timings(evaluation: MatchingEvaluation, folder: Path) -> None:
    """Write ``timings.csv``: seconds of the solver for each query, which differ by run."""
    parts = [
        scene.records[["scene", "query"]].assign(seconds=np.round(scene.seconds, 6))
        for scene in evaluation.scored
    ]
    with atomic_write(folder / "timings.csv", "w") as stream:
        concatenate(parts).to_csv(stream, index=False, lineterminator="\n")


def _counts(truth: MatchingTruth, records: pd.DataFrame) -> dict[str, int]:
    rows = records[records["scene"] == truth.scene]
    counts = {
        "queries": len(rows),
        "missing": int((~rows["answered"]).sum()),
        "failed": int(rows["failed"].sum()),
        "left_out": len(truth.excluded),
    }
    for name in ("matches", "lifted", "outside_map", "outside_dsm", "no_height"):
        if name in rows.columns:
            counts[name] = int(rows[name].sum())
    return counts


def _notes(records: pd.DataFrame, predictions: MatchingPredictions) -> list[str]:
    notes = [f"scored from {predictions.kind}"]
    failed = records[records["failed"] & records["answered"]]
    if len(failed):
        reasons = failed["status"].value_counts().sort_index()
        listed = ", ".join(f"{count} {reason}" for reason, count in reasons.items())
        who = "1 answered query has" if len(failed) == 1 else f"{len(failed)} answered queries have"
        notes.append(f"{who} no pose ({listed}): infinite errors")
    if "lifted" in records.columns:
        notes += _lifting_notes(records)
    return notes


def _lifting_notes(records: pd.DataFrame) -> list[str]:
    given, lifted = int(records["matches"].sum()), int(records["lifted"].sum())
    notes = []
    if lifted < given:
        notes.append(f"{given - lifted} of {given} matches could not be lifted and were dropped")
    blind = ((records["no_height"] > 0) & (records["lifted"] == 0)).sum()
    if blind:
        notes.append(f"the surface model has no height under any match of {blind} queries")
    return notes


def _far_notes(truths: list[MatchingTruth], scored: list[ScoredScene]) -> list[str]:
    """Suspect another frame or convention where poses lie beyond any GPS error."""
    offsets = [s.centres - t.priors.centres for t, s in zip(truths, scored, strict=True)]
    away = np.linalg.norm(np.concatenate(offsets), axis=1)
    far = int((away > _FAR_M).sum())
    if not far:
        return []
    return [
        f"{far} of {np.isfinite(away).sum()} poses lie more than {_FAR_M:g} m from the photo's GPS "
        "position: are they world-to-camera, and all coordinates in the scene's CRS?"
    ]


def _crop_notes(truths: list[MatchingTruth], claims: list[SceneClaim]) -> list[str]:
    """Count matches that the query's crop could not have given."""
    outside = 0
    for truth, claim in zip(truths, claims, strict=True):
        if claim.map_xy is not None:
            crop = np.repeat(truth.crops, np.diff(claim.offsets), axis=0)
            local = claim.map_xy - crop[:, :2]
            outside += int(((local < -1) | (local > crop[:, 2:] + 1)).any(axis=1).sum())
    return [f"{outside} map pixels lie outside their query's crop"] if outside else []


def _scale_notes(predictions: MatchingPredictions, truths: list[MatchingTruth]) -> list[str]:
    """Suspect pixels of a smaller image: they would all lie in a corner of the photo."""
    claim = predictions.claim
    if isinstance(claim, PoseClaim) or len(claim.query_xy) < _ENOUGH_MATCHES:
        return []
    size = np.array([[t.cameras.width.max(), t.cameras.height.max()] for t in truths]).max(axis=0)
    reach = claim.query_xy.max(axis=0)
    if (reach < _CORNER * size).all():
        return [
            f"no query pixel lies beyond ({reach[0]:.0f}, {reach[1]:.0f}) in photos of "
            f"{size[0]}x{size[1]} px: are the matches in the size of a smaller image?"
        ]
    return []
