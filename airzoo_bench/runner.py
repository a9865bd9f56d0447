"""From a protocol, a benchmark folder and a prediction file to records and a result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark import Benchmark, find_benchmark
from airzoo_bench.errors import PredictionError, ProtocolError, UsageError, first_of
from airzoo_bench.files import (
    atomic_write,
    check_output_folder,
    fingerprint,
    sha256_of,
    write_npz,
)
from airzoo_bench.progress import Progress, silent
from airzoo_bench.protocol import Protocol, find_protocol, load_protocol, protocol_files
from airzoo_bench.readers.retrieval import read_retrieval
from airzoo_bench.result import (
    PredictionsUsed,
    ProtocolUsed,
    Result,
    TruthUsed,
    score_columns,
    versions,
    with_summary,
    write_result,
)
from airzoo_bench.retrieval.claims import assign_queries, rank_scene
from airzoo_bench.retrieval.predictions import (
    RetrievalPredictions,
    deep_faults,
    faults,
    scene_of,
)
from airzoo_bench.retrieval.scores import retrieval_scores
from airzoo_bench.retrieval.template import descriptor_template, ranked_template
from airzoo_bench.retrieval.track import score_scene
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth
from airzoo_bench.scores import summarise

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Evaluation", "check_retrieval", "evaluate_retrieval", "save", "write_template"]


@dataclass(frozen=True)
class Evaluation:
    """A result and the records that it was made from."""

    result: Result
    records: pd.DataFrame


def evaluate_retrieval(
    path: Path,
    *,
    data: Path,
    protocol: str | None = None,
    method: str | None = None,
    memory_bytes: int,
    jobs: int = 1,
    progress: Progress = silent,
) -> Evaluation:
    """Score a prediction file of the retrieval track.

    Parameters
    ----------
    path : Path
        The predictions.
    data : Path
        The benchmark folder, or the folder that holds it.
    protocol : str, optional
        Name or path; by default the file's own.
    method : str, optional
        What tables call it; by default the file's stem.
    memory_bytes : int
        The most that one array of the file, and the ranking of descriptors, may take.
    jobs : int
        Threads for ranking descriptors; the numbers do not depend on it.
    progress : Progress
        Shows scenes as they are done.

    Raises
    ------
    UserError
        The predictions, the protocol or the benchmark folder are not as they must be.
    """
    predictions = read_retrieval(path, memory_bytes)
    chosen = choose_protocol(predictions, protocol, data)
    for fault in faults(predictions, chosen.scores.depth):
        raise fault
    benchmark = find_benchmark(chosen.benchmark, data)
    truths = read_truths(benchmark, chosen)
    rows, extra = assign_queries(predictions, truths)
    if all((found < 0).all() for found in rows):
        example = str(truths[0].queries["id"].iloc[0])
        raise _other_benchmark(predictions, chosen, data, example)
    parts = []
    for truth, found in progress(zip(truths, rows, strict=True), "scenes", len(truths)):
        ranking = rank_scene(
            predictions, truth, found, chosen.scores, memory_bytes=memory_bytes, workers=jobs
        )
        parts.append(score_scene(truth, ranking, found >= 0, chosen.scores))
    records = _concatenate(parts)
    used = PredictionsUsed(
        file=path.name,
        sha256=sha256_of(path),
        kind=predictions.kind,
        method=method or path.stem,
    )
    result = _result(records, chosen, benchmark, truths, used, extra)
    return Evaluation(result, records)


def check_retrieval(
    path: Path, *, data: Path, protocol: str | None, memory_bytes: int
) -> list[PredictionError]:
    """Return all that is wrong with a prediction file, without looking at truth.

    Raises
    ------
    UserError
        The file cannot be read at all, or the protocol is unknown.
    """
    predictions = read_retrieval(path, memory_bytes)
    chosen = choose_protocol(predictions, protocol, data)
    found = [*faults(predictions, chosen.scores.depth), *deep_faults(predictions)]
    scenes = {scene.id for scene in chosen.scenes}
    if not scenes & set(np.unique(scene_of(predictions.query_ids))):
        found.append(_other_benchmark(predictions, chosen, data))
    return found


def save(evaluation: Evaluation, folder: Path) -> None:
    """Write ``result.json`` and ``records.csv`` into a folder, each whole or not at all."""
    check_output_folder(folder, ("result.json", "records.csv"))
    with atomic_write(folder / "records.csv", "w") as stream:
        evaluation.records.to_csv(stream, index=False, lineterminator="\n")
    write_result(folder / "result.json", evaluation.result)


def choose_protocol(predictions: RetrievalPredictions, named: str | None, data: Path) -> Protocol:
    """Return the protocol that was named, else the one that the file names.

    Raises
    ------
    PredictionError
        Neither names one.
    ProtocolError
        It is unknown.
    """
    if named is None and predictions.protocol is not None:
        try:
            return find_protocol(predictions.protocol, data)
        except ProtocolError as error:
            raise error.inside(f"{predictions.path}, field 'protocol'") from error
    if named is None:
        raise PredictionError(
            "does not say which protocol it is for",
            where=predictions.path,
            expected="a field 'protocol', such as 'uav-visloc-retrieval'",
            mend="add the field, or name it with --protocol",
        )
    return find_protocol(named, data)


def read_truths(benchmark: Benchmark, protocol: Protocol) -> list[RetrievalTruth]:
    """Read the truth of every scene of a protocol, in its order."""
    benchmark.check_fits(protocol)
    return [read_truth(benchmark.scene_folder(scene.id), scene.id) for scene in protocol.scenes]


def _concatenate(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    import pandas as pd

    return pd.concat(parts, ignore_index=True)


def _result(
    records: pd.DataFrame,
    protocol: Protocol,
    benchmark: Benchmark,
    truths: list[RetrievalTruth],
    used: PredictionsUsed,
    extra: int,
) -> Result:
    scores = retrieval_scores(protocol.scores)
    counts = {truth.scene: _counts(truth, benchmark, records) for truth in truths}
    return Result(
        track=protocol.track,
        protocol=ProtocolUsed(
            name=protocol.name,
            version=protocol.version,
            fingerprint=protocol.fingerprint,
            settings=protocol.settings(),
        ),
        truth=TruthUsed(
            benchmark=benchmark.name,
            version=benchmark.file.version,
            fingerprint=fingerprint({truth.scene: truth.fingerprint for truth in truths}),
            scene_titles={scene.id: scene.title for scene in protocol.scenes},
        ),
        predictions=used,
        versions=versions(),
        columns=score_columns(scores),
        counts=counts,
        extra_queries=extra,
        notes=tuple(_notes(protocol, counts, extra)),
        **with_summary(summarise(records, scores, [truth.scene for truth in truths])),
    ).sealed()


def _counts(truth: RetrievalTruth, benchmark: Benchmark, records: pd.DataFrame) -> dict[str, int]:
    rows = records[records["scene"] == truth.scene]
    return {
        "queries": len(rows),
        "tiles": len(truth.tiles),
        "missing": int((~rows["answered"]).sum()),
        "tie_dependent": int(rows["tie_dependent"].sum()),
        "without_positive": len(truth.excluded) + int((rows["positives"] == 0).sum()),
        "without_ground_point": benchmark.scene(truth.scene).without_ground_point,
    }


def _notes(protocol: Protocol, counts: dict[str, dict[str, int]], extra: int) -> list[str]:
    total = {
        key: sum(scene[key] for scene in counts.values()) for key in ("missing", "tie_dependent")
    }
    notes = []
    if total["missing"]:
        notes.append(f"{total['missing']} queries are missing from the predictions and score 0")
    if extra:
        notes.append(f"{extra} ids of the predictions are no queries and were left aside")
    if total["tie_dependent"]:
        notes.append(
            f"{total['tie_dependent']} queries depend on ties, which were broken against the method"
        )
    for scene in protocol.scenes:
        found = counts[scene.id]["queries"]
        if scene.queries is not None and scene.queries != found:
            notes.append(
                f"scene {scene.title} has {found} queries here, {scene.queries} in the paper"
            )
    return notes


def _other_benchmark(
    predictions: RetrievalPredictions, protocol: Protocol, data: Path, example: str | None = None
) -> PredictionError:
    scenes = set(np.unique(scene_of(predictions.query_ids)))
    ids = predictions.query_ids
    alike = [
        name
        for name, path in protocol_files(data).items()
        if name != protocol.name and scenes & _scenes_of(path)
    ]
    guess = f"they look like those of {' or '.join(alike)}" if alike else ""
    expected = example or ", ".join(f"{scene.id}/..." for scene in protocol.scenes[:3])
    return PredictionError(
        f"none of its query ids belongs to {protocol.benchmark}: {first_of(ids, len(ids))}"
        + (f"; {guess}" if guess else ""),
        where=f"{predictions.path}, field 'query_ids'",
        expected=f"ids such as {expected}",
        mend="name the right protocol with --protocol; `airzoo-bench template` writes the ids",
    )


def _scenes_of(path: Path) -> set[str]:
    try:
        return {scene.id for scene in load_protocol(path).scenes}
    except ProtocolError:  # another benchmark's fault is not this file's
        return set()


def write_template(
    protocol: str, *, data: Path, out: Path, descriptors: bool = False, seed: int = 0
) -> None:
    """Write an example prediction file for a protocol, with tiles in random order.

    Raises
    ------
    UserError
        The protocol or the benchmark folder is not there, or `out` does not end in ``.npz``.
    """
    if out.suffix != ".npz":
        raise UsageError("templates are written as .npz", where=out, mend=f"name it {out}.npz")
    chosen = find_protocol(protocol, data)
    truths = read_truths(find_benchmark(chosen.benchmark, data), chosen)
    arrays = (
        descriptor_template(truths, seed)
        if descriptors
        else ranked_template(truths, max(chosen.scores.ndcg_at), seed)
    )
    with atomic_write(out) as stream:
        write_npz(stream, {"protocol": np.array(chosen.name), **arrays})
