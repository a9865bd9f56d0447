"""The reconstruction track: from predictions of scenes to records and a result."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.benchmark import Benchmark, find_benchmark
from airzoo_bench.errors import BenchmarkError, PredictionError, first_of
from airzoo_bench.progress import Progress, silent
from airzoo_bench.protocol import ReconstructionProtocol
from airzoo_bench.readers.clouds.formats import open_cloud
from airzoo_bench.readers.clouds.meshes import MeshSampling
from airzoo_bench.readers.reconstruction import ReconstructionPredictions, open_reconstruction
from airzoo_bench.reconstruction.scores import reconstruction_scores
from airzoo_bench.reconstruction.track import (
    Rules,
    ScoredScene,
    Work,
    score_missing,
    score_scene,
    worst_poses,
)
from airzoo_bench.reconstruction.truth import ReconstructionTruth, read_truth
from airzoo_bench.runner.common import Checked, Evaluation, Run, choose_protocol, make_result
from airzoo_bench.runner.reconstruction_claims import (
    claim_of_scene,
    kind_of,
    odd_place,
    odd_views,
    true_cameras,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "ReconstructionEvaluation",
    "check_reconstruction",
    "evaluate_reconstruction",
    "read_reconstruction_truths",
]

# What a point takes in memory while distances are computed: both clouds, their order, the tree.
_BYTES_A_POINT = 128
_LEAST_BLOCK = 100_000
_UNPACKED_BYTES = 1 << 40


@dataclass(frozen=True, eq=False)
class ReconstructionEvaluation:
    """An evaluation, and what pictures need beside it; by scene."""

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
    progress : Progress

    Raises
    ------
    UserError
        The predictions, the protocol or the benchmark folder are not as they must be.
    """
    predictions = open_reconstruction(path, unpacked_limit_bytes=_UNPACKED_BYTES)
    chosen = choose_protocol(path, predictions.protocol, protocol, data, ReconstructionProtocol)
    _refuse_other_scenes(predictions, chosen)
    benchmark = find_benchmark(chosen.benchmark, data)
    truths = read_reconstruction_truths(benchmark, chosen)
    work = Work(max(memory_bytes // _BYTES_A_POINT, _LEAST_BLOCK), jobs, progress)
    scored, kinds, notes = {}, set(), []
    for truth in truths:
        if truth.scene not in predictions.scenes:
            scored[truth.scene] = score_missing(truth.scene, chosen.scores)
            continue
        scene = _score_scene(predictions, truth, chosen, memory_bytes, work)
        scored[truth.scene] = scene.scored
        kinds.add(scene.kind)
        notes += [f"scene {truth.scene}: {note}" for note in scene.notes]
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
        len(predictions.unknown([truth.scene for truth in truths])),
        notes,
    )
    return ReconstructionEvaluation(Evaluation(result, records), chosen, scored)


def check_reconstruction(
    path: Path, *, data: Path, protocol: str | None, memory_bytes: int
) -> Checked:
    """Find all that is wrong with predictions, without looking at the true clouds.

    Where the benchmark folder is there, image names are held against its photos.

    Raises
    ------
    UserError
        The predictions cannot be listed at all, or the protocol is unknown.
    """
    predictions = open_reconstruction(path, unpacked_limit_bytes=_UNPACKED_BYTES)
    chosen = choose_protocol(path, predictions.protocol, protocol, data, ReconstructionProtocol)
    notes = [f"{len(predictions.extra)} files are nobody's prediction"] if predictions.extra else []
    try:
        _refuse_other_scenes(predictions, chosen)
    except PredictionError as fault:
        return Checked([fault], notes)
    missing = predictions.missing([scene.id for scene in chosen.scenes])
    if missing:
        notes.append(
            f"{len(missing)} scenes are missing and will score their worst: " + first_of(missing)
        )
    try:
        truths = {
            truth.scene: truth
            for truth in read_reconstruction_truths(find_benchmark(chosen.benchmark, data), chosen)
        }
    except BenchmarkError as error:
        truths = {}
        notes.append(f"images were not held against the benchmark: {error.what}")
    faults = []
    for scene in predictions.scenes:
        try:
            notes += _look_into(predictions, scene, truths.get(scene), chosen, memory_bytes)
        except PredictionError as fault:
            faults.append(fault)
    return Checked(faults, notes)


def read_reconstruction_truths(
    benchmark: Benchmark, protocol: ReconstructionProtocol
) -> list[ReconstructionTruth]:
    """Read the truth of every scene of a protocol, in its order."""
    benchmark.check_fits(protocol)
    return [read_truth(benchmark, scene.id) for scene in protocol.scenes]


@dataclass(frozen=True, eq=False)
class _Scored:
    scored: ScoredScene
    kind: str
    notes: list[str]


def _score_scene(
    predictions: ReconstructionPredictions,
    truth: ReconstructionTruth,
    chosen: ReconstructionProtocol,
    memory_bytes: int,
    work: Work,
) -> _Scored:
    sampling = _sampling(chosen)
    true_cloud = open_cloud(truth.cloud, limit_bytes=memory_bytes, sampling=sampling)
    rules = Rules(chosen.alignment, chosen.fusion, chosen.preparation, chosen.scores)
    place = f"{predictions.path}, scene {truth.scene}"
    with predictions.opened(truth.scene, limit_bytes=memory_bytes, sampling=sampling) as found:
        claim = claim_of_scene(found, truth, place)
        try:
            scored = score_scene(claim, true_cloud, true_cameras(truth), rules, work)
        except PredictionError as fault:
            raise fault.inside(place) from fault
        notes = [*odd_views(found, truth, claim), *_count_notes(scored)]
        if scored.clouds is not None:
            notes += odd_place(*(cloud.source for cloud in scored.clouds))
        return _Scored(scored, kind_of(found), notes)


def _look_into(
    predictions: ReconstructionPredictions,
    scene: str,
    truth: ReconstructionTruth | None,
    chosen: ReconstructionProtocol,
    memory_bytes: int,
) -> list[str]:
    with predictions.opened(scene, limit_bytes=memory_bytes, sampling=_sampling(chosen)) as found:
        if truth is None:
            return []
        claim = claim_of_scene(found, truth, f"{predictions.path}, scene {scene}")
        return [f"scene {scene}: {note}" for note in odd_views(found, truth, claim)]


def _sampling(chosen: ReconstructionProtocol) -> MeshSampling:
    meshes = chosen.meshes
    return MeshSampling(
        seed=meshes.seed, count=meshes.points, per_square_unit=None, max_points=meshes.points
    )


def _records(
    scored: dict[str, ScoredScene], chosen: ReconstructionProtocol, with_poses: bool
) -> pd.DataFrame:
    import pandas as pd

    records = pd.DataFrame([scene.record for scene in scored.values()])
    # A scene without poses, where others have some, has failed.
    return records.fillna(worst_poses(chosen.scores)) if with_poses else records


def _count_notes(scored: ScoredScene) -> list[str]:
    counts, alignment = scored.counts, scored.alignment
    notes = []
    if counts["not_finite"]:
        notes.append(f"{counts['not_finite']:,} points are NaN or infinite and were left out")
    if not counts["points"]:
        notes.append("no point is left to compare: it scores 0 and infinite distances")
    if alignment is not None and alignment.used_orientations:
        notes.append("camera centres lie on a line: aligned by the cameras' orientations too")
    if alignment is not None and not alignment.robust:
        notes.append("fewer than 3 cameras agree: aligned to all of them")
    return notes


def _refuse_other_scenes(
    predictions: ReconstructionPredictions, chosen: ReconstructionProtocol
) -> None:
    known = [scene.id for scene in chosen.scenes]
    if not set(known) & set(predictions.scenes):
        raise PredictionError(
            f"holds none of the scenes of {chosen.name}: {first_of(predictions.scenes)}",
            where=predictions.path,
            expected=f"an entry a scene: {first_of(known)}",
            mend="name files or folders by their scenes, or the right protocol with --protocol",
        )
