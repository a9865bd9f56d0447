"""Scoring predictions of any track: from a file to records and a result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError, PredictionError, ProtocolError, UserError
from airzoo_bench.core.files import fingerprint, sha256_of, sha256_of_tree, stamps
from airzoo_bench.core.version import versions
from airzoo_bench.evaluation.given import Given, ReadBy, read_truths
from airzoo_bench.evaluation.parts import Resources, ScoredScene, Truth
from airzoo_bench.evaluation.truth_accuracy import accuracy_notes
from airzoo_bench.evaluation.untrusted import open_as_trusted
from airzoo_bench.protocol.lookup import load_protocol, protocol_files
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.comparable import other_settings
from airzoo_bench.results.result import (
    PredictionsUsed,
    ProtocolUsed,
    Result,
    TruthUsed,
    score_columns,
)
from airzoo_bench.results.scores import summarise

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Evaluation", "counts_apart", "evaluate", "namesake_notes"]


_CHANGED_PREDICTIONS = PredictionError(
    "was changed while it was scored",
    expected="predictions that stay as they are until the run is saved",
    fix="score them again when nobody writes there",
)
_CHANGED_TRUTH = BenchmarkError(
    "was changed while predictions were scored with it",
    expected="a benchmark that stays as it is until the run is saved",
    fix="score them again when nobody writes there",
)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A result, the records it was made from, and what figures need besides.

    Attributes
    ----------
    records : DataFrame
        A row a query, pair or cloud.
    truths, scene_predictions : list
        Of each scene.
    scored : dict
        Scored scenes by id.
    """

    result: Result
    records: pd.DataFrame
    given: Given
    benchmark: Benchmark
    truths: list[Any]
    scene_predictions: list[Any]
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
    read_by: ReadBy = ReadBy(),  # noqa: B008 - frozen
    begun: Callable[[], None] = lambda: None,
) -> Evaluation:
    """Score predictions."""
    with _unchanged([path], resources, _CHANGED_PREDICTIONS):
        return _evaluated(path, data, track, protocol, method, resources, read_by, begun)


@contextmanager
def _unchanged(paths: Iterable[Path], resources: Resources, fault: UserError) -> Iterator[None]:
    """Refuse what is made of files that change meanwhile: nobody could name their checksum."""
    begun = [(path, stamps(path)) for path in paths]
    try:
        yield
    finally:
        for path, before in begun:
            now = stamps(path)
            changed = sorted(file for file, stamp in before.items() if now.get(file) != stamp)
            if changed:
                if resources.scenes is not None:
                    resources.scenes.remove()
                raise fault.inside(changed[0])


def _evaluated(
    path: Path,
    data: Path,
    track: str | None,
    protocol: str | None,
    method: str | None,
    resources: Resources,
    read_by: ReadBy,
    begun: Callable[[], None],
) -> Evaluation:
    given = open_as_trusted(path, track, protocol, data, resources, read_by)
    of, predictions, chosen = given.track, given.predictions, given.protocol
    for error in of.validation_errors(predictions, chosen, thorough=False):
        raise error
    benchmark, truths = _open_truths(given, data)
    read_again = [file for truth in truths for file in of.read_while_scoring(truth)]
    with _unchanged(read_again, resources, _CHANGED_TRUTH):
        sha256 = sha256_of_tree(predictions.path)
        if resources.scenes is not None:
            resources.scenes.begin(_run_of(given, sha256, truths, read_by.names, resources))
        begun()
        assigned = of.assign(predictions, chosen, truths, data)
        scene_predictions = []
        for predicted in of.match(predictions, assigned, truths, chosen, resources):
            if isinstance(predicted, PredictionError):
                raise predicted
            scene_predictions.append(predicted)
        pairs = zip(scene_predictions, truths, strict=True)
        scored = [
            resources.finish(
                truth.scene, truth, partial(of.score, predicted, truth, chosen, resources)
            )
            for predicted, truth in pairs
        ]
    records = of.records(scored, chosen)
    notes = [
        *given.notes,
        *assigned.notes(),
        *of.notes(predictions, chosen, truths, scene_predictions, scored),
    ]
    result = _result(
        given, sha256, benchmark, truths, scored, records, method, len(assigned.strange), notes
    )
    by_scene = {truth.scene: scene for truth, scene in zip(truths, scored, strict=True)}
    return Evaluation(result, records, given, benchmark, truths, scene_predictions, by_scene)


def _open_truths(given: Given, data: Path) -> tuple[Benchmark, list[Any]]:
    """Return the truths that a reader was given, unless they are sealed, else read them."""
    if given.truths is not None and not given.truths[0].is_sealed:
        return given.truths
    return read_truths(given.track, given.protocol, data)


def _run_of(
    given: Given, sha256: str, truths: Sequence[Truth], names: Path | None, resources: Resources
) -> str:
    """Return a fingerprint of all that results of tasks depend on."""
    return fingerprint(
        {
            "track": given.track.name,
            "predictions": sha256,
            "reader": None if given.reader is None else given.reader.model_dump(mode="json"),
            "names": None if names is None else sha256_of(names),
            "protocol": given.protocol.fingerprint,
            "truth": {truth.scene: truth.fingerprint for truth in truths},
            "versions": versions(),
            "keep": resources.keep,
            "memory": resources.memory_bytes,  # how queries and clouds are cut
            "stamps": sorted(stamps(given.predictions.path).values()),
        }
    )


def _result(
    given: Given,
    sha256: str,
    benchmark: Benchmark,
    truths: Sequence[Truth],
    scored: Sequence[ScoredScene],
    records: pd.DataFrame,
    method: str | None,
    strange: int,
    notes: Sequence[str],
) -> Result:
    """Average the records, and collect all that a result states."""
    track, protocol, path = given.track, given.protocol, given.predictions.path
    scores = track.scores(protocol, scored)
    counts = {truth.scene: scene.counts for truth, scene in zip(truths, scored, strict=True)}
    return Result(
        track=track.name,
        protocol=_protocol_used(protocol),
        truth=TruthUsed(
            benchmark=benchmark.name,
            version=benchmark.file.version,
            fingerprint=truth_fingerprint(truths),
            scene_titles={scene.id: scene.title for scene in protocol.scenes},
        ),
        predictions=PredictionsUsed(
            file=path.name,
            sha256=sha256,
            kind=track.kind(given.predictions, scored),
            method=method or track.method(path),
            reader=given.reader,
        ),
        versions=dict(versions()),
        columns=score_columns(scores),
        counts=counts,
        extra_queries=strange,
        notes=(
            *namesake_notes(protocol, benchmark.folder),
            *counts_apart(protocol, counts),
            *accuracy_notes(
                protocol, {scene.id: scene.truth_accuracy_m for scene in benchmark.file.scenes}
            ),
            *notes,
        ),
        **asdict(summarise(records, scores, [scene.id for scene in protocol.scenes])),
        references=track.references(protocol, truths),
    ).with_checksum()


def truth_fingerprint(truths: Sequence[Truth]) -> str:
    """Return the SHA-256 over all that scores of some scenes depend on."""
    return fingerprint({truth.scene: truth.fingerprint for truth in truths})


def _protocol_used(protocol: Protocol) -> ProtocolUsed:
    return ProtocolUsed(
        name=protocol.name,
        version=protocol.version,
        fingerprint=protocol.fingerprint,
        settings=protocol.settings(),
    )


def namesake_notes(used: Protocol, data: Path) -> list[str]:
    """Note a protocol that has the name of a known one and measures something else."""
    path = protocol_files(data).get(used.name)
    try:
        known = None if path is None else load_protocol(path)
    except ProtocolError:  # a protocol that cannot be used is no namesake
        known = None
    if known is None or known.fingerprint == used.fingerprint:
        return []
    why = other_settings(known.settings(), used.settings())
    return [f"the protocol is not the {used.name} that all have: {why}"]


def counts_apart(protocol: Protocol, counts: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Note scenes whose number of queries is not the paper's."""
    return [
        f"scene {scene.title} has {counts[scene.id]['queries']:,} queries here, "
        f"{scene.queries:,} in the paper"
        for scene in protocol.scenes
        if scene.queries not in (None, counts[scene.id].get("queries", scene.queries))
    ]
