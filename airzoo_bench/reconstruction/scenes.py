"""Reading a scene's prediction, and bringing it to where it is compared."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from airzoo_bench.core.errors import BenchmarkError, PredictionError
from airzoo_bench.core.temporaries import PART
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.formats.clouds.meshes import MeshSampling
from airzoo_bench.formats.clouds.source import FileCloud
from airzoo_bench.reconstruction.camera_names import kind_of, match_cameras, true_cameras
from airzoo_bench.reconstruction.notes import (
    notes_of_digits,
    notes_of_placed,
    notes_of_reading,
    notes_of_scored,
)
from airzoo_bench.reconstruction.placing import BlockWork, ScoringSettings, TrueScene, align_scene
from airzoo_bench.reconstruction.reading import (
    ReconstructionPredictions,
    ScenePrediction,
)
from airzoo_bench.reconstruction.scoring import ScoredScene, score_scene
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.truth import ReconstructionTruth

__all__ = ["read_through", "scored_scene"]

# What a point takes in memory while distances are computed: both clouds, their order, the tree.
_BYTES_A_POINT = 128
_LEAST_BLOCK = 100_000


def _work_for(resources: Resources) -> BlockWork:
    """Return how to work within so much memory."""
    block = max(resources.memory_bytes // _BYTES_A_POINT, _LEAST_BLOCK)
    return BlockWork(block, resources.jobs, resources.progress)


class _TrueCloud:
    """The true cloud; what is wrong with its file is no fault of the prediction."""

    def __init__(
        self, truth: ReconstructionTruth, memory_bytes: int, sampling: MeshSampling
    ) -> None:
        self._path = truth.cloud
        with self._blamed():
            self._source = open_cloud(truth.cloud, limit_bytes=memory_bytes, sampling=sampling)

    @property
    def count(self) -> int:
        return self._source.count

    def pieces(self, points: int) -> Iterator[Cloud]:
        with self._blamed():
            yield from self._source.pieces(points)

    @contextmanager
    def _blamed(self) -> Iterator[None]:
        try:
            yield
        except PredictionError as fault:
            raise BenchmarkError(
                f"the true cloud cannot be read: {fault.what}",
                where=self._path,
                expected=fault.expected,
                fix="prepare the benchmark with a cloud that is whole",
            ) from fault


@contextmanager
def scored_scene(
    predictions: ReconstructionPredictions,
    truth: ReconstructionTruth,
    chosen: ReconstructionProtocol,
    resources: Resources,
) -> Iterator[ScoredScene]:
    """Read a scene's prediction and score it; a fault names the scene.

    Its clouds may be read within the context only.
    """
    place = f"{predictions.path}, scene {truth.scene}"
    memory_bytes, work = resources.memory_bytes, _work_for(resources)
    with _entry(predictions, truth.scene, chosen, memory_bytes) as found:
        true_cloud = _TrueCloud(truth, memory_bytes, _sampling(chosen))
        claim = match_cameras(found, truth, place)
        true = TrueScene(true_cloud, true_cameras(truth), truth.cameras)
        placed = align_scene(claim, true, _rules_of(chosen), work)
        scored = score_scene(claim, placed, true.cameras, _rules_of(chosen), work)
        notes = [
            *notes_of_reading(found, truth, claim, chosen, placed.alignment.transform.scale),
            *notes_of_digits(found, placed, chosen.scores),
            *notes_of_placed(placed, chosen.scores),
            *notes_of_scored(scored, chosen.scores),
        ]
        told = [f"scene {truth.scene}: {note}" for note in notes]
        yield replace(scored, kind=kind_of(found), notes=tuple(told))


@contextmanager
def _entry(
    predictions: ReconstructionPredictions,
    scene: str,
    chosen: ReconstructionProtocol,
    memory_bytes: int,
) -> Iterator[ScenePrediction]:
    """Open a scene's entry; whatever is raised meanwhile says where it is."""
    place = f"{predictions.path}, scene {scene}"
    sampling = _sampling(chosen)
    try:
        with predictions.opened(scene, limit_bytes=memory_bytes, sampling=sampling) as found:
            yield found
    except PredictionError as fault:
        if fault.where is None:
            raise fault.inside(place) from fault
        unpacked = fault.where.partition(f"{PART}/")[2]
        if not unpacked or predictions.path.is_dir():
            raise
        # A file of an archive lies somewhere else while it is read.
        raise PredictionError(
            fault.what, where=f"{place}, {unpacked}", expected=fault.expected, fix=fault.fix
        ) from fault


def read_through(
    predictions: ReconstructionPredictions,
    scene: str,
    chosen: ReconstructionProtocol,
    memory_bytes: int,
) -> list[str]:
    """Read a scene's prediction without a truth; returns what there is to say about it.

    Raises
    ------
    PredictionError
        It cannot be read.
    """
    with _entry(predictions, scene, chosen, memory_bytes) as entry:
        if isinstance(entry.geometry, FileCloud):
            # A file that is cut off is found out where it is read.
            for _piece in entry.geometry.pieces(_LEAST_BLOCK):
                pass
        return [f"scene {scene}: {note}" for note in entry.geometry.notes]


def _rules_of(chosen: ReconstructionProtocol) -> ScoringSettings:
    """Return what a protocol states of how a scene is scored."""
    return ScoringSettings(chosen.alignment, chosen.fusion, chosen.preparation, chosen.scores)


def _sampling(chosen: ReconstructionProtocol) -> MeshSampling:
    meshes = chosen.meshes
    return MeshSampling(
        seed=meshes.seed, count=meshes.points, per_square_unit=None, max_points=meshes.points
    )
