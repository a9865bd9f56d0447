"""Scoring predictions of whatever track: from a file to records and a result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import fingerprint, sha256_of_tree
from airzoo_bench.evaluation.given import Given, open_predictions, read_truths
from airzoo_bench.evaluation.notes import counts_apart, namesake_notes
from airzoo_bench.evaluation.parts import ScoredScene, Truth
from airzoo_bench.evaluation.resources import Resources
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import (
    PredictionsUsed,
    ProtocolUsed,
    Result,
    TruthUsed,
    score_columns,
    versions,
    with_summary,
)
from airzoo_bench.results.scores import summarise

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Evaluation", "evaluate"]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A result, the records it was made from, and what pictures need beside them, by scene.

    Attributes
    ----------
    result : Result
    records : DataFrame
        A row a query, pair or cloud.
    given : Given
    benchmark : Benchmark
    truths : list
    claims : list
    scored : dict
    """

    result: Result
    records: pd.DataFrame
    given: Given
    benchmark: Benchmark
    truths: list[Any]
    claims: list[Any]
    scored: dict[str, Any]

    @property
    def protocol(self) -> Any:
        """The protocol, of its track's own class."""
        return self.given.protocol


def evaluate(
    path: Path,
    *,
    data: Path,
    track: str | None = None,
    protocol: str | None = None,
    method: str | None = None,
    resources: Resources = Resources(),  # noqa: B008 - frozen
) -> Evaluation:
    """Score predictions.

    Parameters
    ----------
    path : Path
        A file, folder or archive.
    data : Path
        The benchmark folder, or the folder that holds it.
    track : str, optional
        By default found from the protocol, else from the file.
    protocol : str, optional
        Name or path; by default the file's own.
    method : str, optional
        What tables call it; by default the name of the file or folder.
    resources : Resources

    Raises
    ------
    UserError
        The predictions, the protocol or the benchmark folder are not as they must be.
    """
    given = open_predictions(path, track, protocol, data, resources)
    of, predictions, chosen = given.track, given.predictions, given.protocol
    for error in of.validation_errors(predictions, chosen, thorough=False):
        raise error
    benchmark, truths = read_truths(of, chosen, data)
    assigned = of.assign(predictions, chosen, truths, data)
    claims = []
    for claim in of.claims(predictions, assigned, truths, chosen, resources):
        if isinstance(claim, PredictionError):
            raise claim
        claims.append(claim)
    pairs = zip(claims, truths, strict=True)
    scored = [of.score(claim, truth, chosen, resources) for claim, truth in pairs]
    records = of.records(scored, chosen)
    notes = [*assigned.notes(), *of.notes(predictions, chosen, truths, claims, scored)]
    result = _result(
        given, benchmark, truths, scored, records, method, len(assigned.strange), notes
    )
    by_scene = {truth.scene: scene for truth, scene in zip(truths, scored, strict=True)}
    return Evaluation(result, records, given, benchmark, truths, claims, by_scene)


def _result(
    given: Given,
    benchmark: Benchmark,
    truths: Sequence[Truth],
    scored: Sequence[ScoredScene],
    records: pd.DataFrame,
    method: str | None,
    strange: int,
    notes: Sequence[str],
) -> Result:
    """Average records and put everything that is known of a run into a result."""
    track, protocol, path = given.track, given.protocol, given.predictions.path
    scores = track.scores(protocol, scored)
    counts = {truth.scene: scene.counts for truth, scene in zip(truths, scored, strict=True)}
    return Result(
        track=track.name,
        protocol=_protocol_used(protocol),
        truth=TruthUsed(
            benchmark=benchmark.name,
            version=benchmark.file.version,
            fingerprint=fingerprint({truth.scene: truth.fingerprint for truth in truths}),
            scene_titles={scene.id: scene.title for scene in protocol.scenes},
        ),
        predictions=PredictionsUsed(
            file=path.name,
            sha256=sha256_of_tree(path),
            kind=track.kind(given.predictions, scored),
            method=method or track.method(path),
        ),
        versions=versions(),
        columns=score_columns(scores),
        counts=counts,
        extra_queries=strange,
        notes=(
            *namesake_notes(protocol, benchmark.folder),
            *counts_apart(protocol, counts),
            *notes,
        ),
        **with_summary(summarise(records, scores, [scene.id for scene in protocol.scenes])),
        references=track.references(protocol, truths),
    ).sealed()


def _protocol_used(protocol: Protocol) -> ProtocolUsed:
    return ProtocolUsed(
        name=protocol.name,
        version=protocol.version,
        fingerprint=protocol.fingerprint,
        settings=protocol.settings(),
    )
