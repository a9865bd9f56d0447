"""The matching track: from a prediction file to records and a result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.evaluation.common import (
    Checked,
    Run,
    check_against_benchmark,
    concatenate,
    make_result,
    match_queries,
)
from airzoo_bench.evaluation.run_files import Evaluation
from airzoo_bench.matching.claims import SceneClaim, claim_of_scene
from airzoo_bench.matching.notes import (
    claim_notes,
    equal_to_prior,
    lifting_notes,
    scored_notes,
)
from airzoo_bench.matching.predictions import PoseClaim, check_digits, faults
from airzoo_bench.matching.reading import read_matching
from airzoo_bench.matching.scores import matching_scores
from airzoo_bench.matching.scoring import ScoredScene, score_priors, score_scene
from airzoo_bench.matching.truth import MatchingTruth, read_truth
from airzoo_bench.protocol.choice import choose_protocol, refuse_other_track
from airzoo_bench.protocol.lookup import MatchingProtocol
from airzoo_bench.results.result import Reference, with_summary
from airzoo_bench.results.scores import summarise

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "PRIOR_ITSELF",
    "MatchingEvaluation",
    "check_matching",
    "evaluate_matching",
    "read_matching_truths",
    "save_timings",
    "score_claims",
]

PRIOR_ITSELF = "Prior itself"
"""The reference of every result of the track."""

_CHECKING_THREADS = 1


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
    refuse_other_track(path, protocol, data, MatchingProtocol, memory_bytes)
    predictions = read_matching(path, memory_bytes)
    chosen = choose_protocol(path, predictions.protocol, protocol, data, MatchingProtocol)
    for fault in faults(predictions):
        raise fault
    benchmark = find_benchmark(chosen.benchmark, data)
    truths = read_matching_truths(benchmark, chosen)
    assigned = match_queries(path, predictions.query_ids, chosen, data, truths)
    pairs = list(zip(truths, assigned.rows, strict=True))
    claims = [claim_of_scene(predictions, truth, found) for truth, found in pairs]
    scored = score_claims(chosen, truths, claims, jobs=jobs, progress=progress)
    records = concatenate([scene.records for scene in scored])
    run = Run(
        path,
        method or path.stem,
        predictions.kind,
        chosen,
        benchmark,
        {truth.scene: truth.fingerprint for truth in truths},
    )
    counts = {
        truth.scene: _counts(truth, records) | {"equal_to_prior": equal_to_prior(truth, claim)}
        for truth, claim in zip(truths, claims, strict=True)
    }
    notes = [
        *assigned.notes(),
        *scored_notes(records, predictions, truths, scored),
        *claim_notes(predictions, truths, claims),
    ]
    scores = matching_scores(chosen.scores)
    extra, references = len(assigned.strange), _references(chosen, truths)
    result = make_result(run, records, scores, counts, extra, notes, references)
    return MatchingEvaluation(Evaluation(result, records), chosen, truths, claims, scored)


def score_claims(
    protocol: MatchingProtocol,
    truths: Sequence[MatchingTruth],
    claims: Sequence[SceneClaim],
    *,
    jobs: int,
    progress: Progress = silent,
) -> list[ScoredScene]:
    """Score the claim about each scene by a protocol."""
    return [
        score_scene(
            truth,
            claim,
            protocol.lift,
            protocol.solver,
            protocol.scores,
            workers=jobs,
            progress=progress,
        )
        for truth, claim in zip(truths, claims, strict=True)
    ]


def _references(
    protocol: MatchingProtocol, truths: Sequence[MatchingTruth]
) -> dict[str, Reference]:
    """Score the priors as if they were a method's poses; where they are the truth, nothing."""
    if protocol.prior.source == "truth":
        return {}
    records = concatenate([score_priors(truth, protocol.scores) for truth in truths])
    scores, scenes = matching_scores(protocol.scores), [truth.scene for truth in truths]
    floor = Reference(
        meaning="what the photos' own GPS and gimbal angles score, without any matching",
        **with_summary(summarise(records, scores, scenes)),
    )
    return {PRIOR_ITSELF: floor}


def check_matching(path: Path, *, data: Path, protocol: str | None, memory_bytes: int) -> Checked:
    """Find all that is wrong with a prediction file, without looking at true poses.

    Where the benchmark folder is there, ids are held against its queries, pixels against photos
    and crops, and poses against the priors.

    Raises
    ------
    UserError
        The file cannot be read at all, or the protocol is unknown.
    """
    refuse_other_track(path, protocol, data, MatchingProtocol, memory_bytes)
    predictions = read_matching(path, memory_bytes)
    chosen = choose_protocol(path, predictions.protocol, protocol, data, MatchingProtocol)
    found = list(faults(predictions))
    if found:
        return Checked(found, [])
    claims: list[SceneClaim] = []
    checked = check_against_benchmark(
        path,
        predictions.query_ids,
        chosen,
        data,
        lambda: read_matching_truths(find_benchmark(chosen.benchmark, data), chosen),
        lambda truth, rows: claims.append(claim_of_scene(predictions, truth, rows)),
        lambda truths: [
            *lifting_notes(truths, claims, chosen.lift, chosen.solver, _CHECKING_THREADS),
            *claim_notes(predictions, truths, claims),
        ],
    )
    if not checked.faults and isinstance(predictions.claim, PoseClaim):
        try:  # as claims do, where the benchmark is not there to make them
            check_digits(predictions.claim, predictions.query_ids)
        except PredictionError as error:
            return Checked([error.inside(path)], checked.notes)
    return checked


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
    for name in ("matches", "lifted", "outside_map", "outside_dsm", "no_height", "beyond_limit"):
        if name in rows.columns:
            counts[name] = int(rows[name].sum())
    return counts
