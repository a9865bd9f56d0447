"""The reconstruction track: from predictions of scenes to records and a result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.errors import BenchmarkError, PredictionError, first_of
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.common import Checked, Run, make_result, namesake_notes
from airzoo_bench.evaluation.run_files import Evaluation
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.protocol.lookup import ReconstructionProtocol
from airzoo_bench.reconstruction.notes import listing_notes
from airzoo_bench.reconstruction.pose_scores import worst_poses
from airzoo_bench.reconstruction.prepared import Held, PreparedCloud
from airzoo_bench.reconstruction.reading import ReconstructionPredictions
from airzoo_bench.reconstruction.scenes import (
    look_into,
    open_predictions,
    scored_scene,
    work_for,
)
from airzoo_bench.reconstruction.scores import reconstruction_scores
from airzoo_bench.reconstruction.scoring import ScoredScene, score_missing
from airzoo_bench.reconstruction.truth import ReconstructionTruth, read_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "ReconstructionEvaluation",
    "check_reconstruction",
    "evaluate_reconstruction",
    "read_reconstruction_truths",
]

_PIECE = 1 << 20


@dataclass(frozen=True, eq=False)
class ReconstructionEvaluation:
    """An evaluation, and what pictures need beside it; by scene.

    Clouds and distances are there where they were asked for.
    """

    evaluation: Evaluation
    protocol: ReconstructionProtocol
    scored: dict[str, ScoredScene]


def evaluate_reconstruction(
    path: Path,
    *,
    data: Path,
    protocol: str | None = None,
    method: str | None = None,
    memory_bytes: int,
    jobs: int = 1,
    keep_clouds: bool = False,
    progress: Progress = silent,
) -> ReconstructionEvaluation:
    """Score predictions of the reconstruction track.

    Parameters
    ----------
    path : Path
        A folder, an archive, or one file of a scene.
    data : Path
        The benchmark folder, or the folder that holds it.
    protocol : str, optional
        Name or path; by default the predictions' own.
    method : str, optional
        What tables call it; by default the name of the file or folder.
    memory_bytes : int
        The most that one array may take, and about what distances may take.
    jobs : int
        Threads; the numbers do not depend on it.
    keep_clouds : bool
        Keep the clouds and distances of each scene, for pictures.
    progress : Progress

    Raises
    ------
    UserError
        The predictions, the protocol or the benchmark folder are not as they must be.
    """
    predictions, chosen = open_predictions(path, protocol, data, memory_bytes)
    _refuse_other_scenes(predictions, chosen)
    benchmark = find_benchmark(chosen.benchmark, data)
    truths = read_reconstruction_truths(benchmark, chosen)
    known = [truth.scene for truth in truths]
    work = work_for(memory_bytes, jobs, progress)
    scored, kinds, notes = {}, set(), listing_notes(predictions, known)
    for truth in truths:
        if truth.scene not in predictions.scenes:
            scored[truth.scene] = score_missing(truth.scene, chosen.scores)
            continue
        with scored_scene(predictions, truth, chosen, memory_bytes, work) as found:
            scene = found.scored
            scored[truth.scene] = _kept(scene, path) if keep_clouds else _without_clouds(scene)
        kinds.add(found.kind)
        notes += found.notes
    with_poses = any("ate_m" in scene.record for scene in scored.values())
    records = _records(scored, chosen, with_poses)
    run = Run(
        path,
        method or (path.stem if path.is_file() else path.name),
        ", ".join(sorted(kinds)),
        chosen,
        benchmark,
        {truth.scene: truth.fingerprint for truth in truths},
    )
    result = make_result(
        run,
        records,
        reconstruction_scores(chosen.scores, with_poses=with_poses),
        {name: scene.counts for name, scene in scored.items()},
        len(predictions.unknown(known)),
        notes,
    )
    return ReconstructionEvaluation(Evaluation(result, records), chosen, scored)


def check_reconstruction(
    path: Path, *, data: Path, protocol: str | None, memory_bytes: int
) -> Checked:
    """Find all that is wrong with predictions, or odd.

    Where the benchmark folder is there, they are scored too, so that all that an evaluation notes
    is noted here.

    Raises
    ------
    UserError
        The predictions cannot be listed at all, or the protocol is unknown.
    """
    predictions, chosen = open_predictions(path, protocol, data, memory_bytes)
    known = [scene.id for scene in chosen.scenes]
    try:
        _refuse_other_scenes(predictions, chosen)
    except PredictionError as fault:
        return Checked([fault], [])
    notes = [*namesake_notes(chosen, data), *listing_notes(predictions, known)]
    try:
        truths = read_reconstruction_truths(find_benchmark(chosen.benchmark, data), chosen)
    except BenchmarkError as error:
        notes.append(f"predictions were not held against the benchmark: {error.what}")
        truths = []
    by_scene = {truth.scene: truth for truth in truths}
    faults = []
    for scene in known:
        if scene in predictions.scenes:
            try:
                notes += look_into(predictions, scene, by_scene.get(scene), chosen, memory_bytes)
            except PredictionError as fault:
                faults.append(fault)
    return Checked(faults, notes)


def read_reconstruction_truths(
    benchmark: Benchmark, protocol: ReconstructionProtocol
) -> list[ReconstructionTruth]:
    """Read the truth of every scene of a protocol, in its order."""
    benchmark.check_fits(protocol)
    return [read_truth(benchmark, scene.id) for scene in protocol.scenes]


def _without_clouds(scene: ScoredScene) -> ScoredScene:
    return replace(scene, clouds=None, distances=None)


def _kept(scene: ScoredScene, path: Path) -> ScoredScene:
    """Return the scene with clouds that can be read once the predictions are closed."""
    if path.is_dir() or scene.clouds is None:
        return scene
    predicted, true = scene.clouds
    return replace(scene, clouds=(_in_memory(predicted), true))


def _in_memory(cloud: PreparedCloud) -> PreparedCloud:
    pieces = [piece.points for piece in cloud.source.pieces(_PIECE)]
    return replace(cloud, source=Held(Cloud(np.concatenate([np.zeros((0, 3)), *pieces]))))


def _records(
    scored: dict[str, ScoredScene], chosen: ReconstructionProtocol, with_poses: bool
) -> pd.DataFrame:
    import pandas as pd

    records = pd.DataFrame([scene.record for scene in scored.values()])
    counted = {name for scene in scored.values() for name in scene.counts} & set(records)
    records = records.astype(dict.fromkeys(sorted(counted), "Int64"))
    # A scene without poses, where others have some, has failed.
    return records.fillna(worst_poses(chosen.scores)) if with_poses else records


def _refuse_other_scenes(
    predictions: ReconstructionPredictions, chosen: ReconstructionProtocol
) -> None:
    known = [scene.id for scene in chosen.scenes]
    if not set(known) & set(predictions.scenes):
        raise PredictionError(
            f"holds none of the scenes of {chosen.name}: {first_of(predictions.scenes)}"
            + nearest(next(iter(predictions.scenes), "")[:80], known, 1),
            where=predictions.path,
            expected=f"an entry a scene: {first_of(known)}",
            mend="name files or folders by their scenes, or the right protocol with --protocol",
        )
