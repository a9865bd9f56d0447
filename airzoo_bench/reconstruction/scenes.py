"""Reading a scene's prediction, and bringing it to where it is compared."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError, PredictionError, ProtocolError, UnreadableError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.temporaries import PART
from airzoo_bench.formats.archives import ARCHIVE_SUFFIXES
from airzoo_bench.formats.arrays import open_arrays, protocol_name
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.formats import SUFFIXES, open_cloud
from airzoo_bench.formats.clouds.meshes import MeshSampling
from airzoo_bench.formats.clouds.source import FileCloud
from airzoo_bench.protocol.choice import choose_protocol
from airzoo_bench.protocol.lookup import ReconstructionProtocol
from airzoo_bench.reconstruction.camera_names import claim_of_scene, kind_of, true_cameras
from airzoo_bench.reconstruction.notes import (
    notes_of_digits,
    notes_of_placed,
    notes_of_reading,
    notes_of_scored,
)
from airzoo_bench.reconstruction.placing import Rules, TrueScene, Work, place_claim
from airzoo_bench.reconstruction.reading import (
    ReconstructionPredictions,
    ScenePrediction,
    open_reconstruction,
)
from airzoo_bench.reconstruction.scoring import ScoredScene, score_scene
from airzoo_bench.reconstruction.truth import ReconstructionTruth

__all__ = ["SceneOutcome", "look_into", "open_predictions", "scored_scene", "work_for"]

# What a point takes in memory while distances are computed: both clouds, their order, the tree.
_BYTES_A_POINT = 128
_LEAST_BLOCK = 100_000
_UNPACKED_BYTES = 1 << 40


def open_predictions(
    path: Path, protocol: str | None, data: Path, memory_bytes: int
) -> tuple[ReconstructionPredictions, ReconstructionProtocol]:
    """List predictions, and find the protocol that is named, else their own.

    Raises
    ------
    UserError
        They are no such thing, or the protocol is unknown or of another track.
    """
    if path.is_file() and not path.name.lower().endswith((*SUFFIXES, *ARCHIVE_SUFFIXES)):
        raise UnreadableError(
            f"no kind of file that reconstructions come in: {path.suffix[:20]!r}",
            where=path,
            expected=f"a folder with an entry a scene, an archive of it "
            f"({', '.join(ARCHIVE_SUFFIXES)}), or one scene's {', '.join(SUFFIXES)}",
            mend="`airzoo-bench template` writes an example",
        )
    predictions = open_reconstruction(path, unpacked_limit_bytes=_UNPACKED_BYTES)
    named = predictions.protocol
    if protocol is None and path.is_file() and path.suffix == ".npz":
        named = protocol_name(open_arrays(path, memory_bytes))
    if protocol is None and named is None:
        raise ProtocolError(
            "does not say which protocol it is for",
            where=path,
            expected="protocol.txt in the folder or archive, or a field 'protocol' in a file alone",
            mend="name it with --protocol; `airzoo-bench protocols` lists them",
        )
    return predictions, choose_protocol(path, named, protocol, data, ReconstructionProtocol)


def work_for(memory_bytes: int, jobs: int, progress: Progress) -> Work:
    """Return how to work within so much memory."""
    return Work(max(memory_bytes // _BYTES_A_POINT, _LEAST_BLOCK), jobs, progress)


@dataclass(frozen=True, eq=False)
class SceneOutcome:
    """What came of a scene's prediction, of which kind it is, and what there is to say about it."""

    scored: ScoredScene
    kind: str
    notes: list[str]


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
                mend="prepare the benchmark with a cloud that is whole",
            ) from fault


@contextmanager
def scored_scene(
    predictions: ReconstructionPredictions,
    truth: ReconstructionTruth,
    chosen: ReconstructionProtocol,
    memory_bytes: int,
    work: Work,
) -> Iterator[SceneOutcome]:
    """Read a scene's prediction and score it; a fault names the scene.

    Its clouds may be read within the context only.
    """
    place = f"{predictions.path}, scene {truth.scene}"
    with _entry(predictions, truth.scene, chosen, memory_bytes) as found:
        true_cloud = _TrueCloud(truth, memory_bytes, _sampling(chosen))
        claim = claim_of_scene(found, truth, place)
        true = TrueScene(true_cloud, true_cameras(truth), truth.cameras)
        placed = place_claim(claim, true, rules_of(chosen), work)
        scored = score_scene(claim, placed, true.cameras, rules_of(chosen), work)
        notes = [
            *notes_of_reading(found, truth, claim, chosen.alignment, chosen.fusion),
            *notes_of_digits(found, placed, chosen.scores),
            *notes_of_placed(placed, chosen.scores),
            *notes_of_scored(scored, chosen.scores),
        ]
        told = [f"scene {truth.scene}: {note}" for note in notes]
        yield SceneOutcome(scored, kind_of(found), told)


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
            fault.what, where=f"{place}, {unpacked}", expected=fault.expected, mend=fault.mend
        ) from fault


def look_into(
    predictions: ReconstructionPredictions,
    scene: str,
    truth: ReconstructionTruth | None,
    chosen: ReconstructionProtocol,
    memory_bytes: int,
) -> list[str]:
    """Do all with a scene's prediction that an evaluation does; return the notes.

    Where `truth` is None it is only read.

    Raises
    ------
    PredictionError
        It would be refused by an evaluation too.
    """
    if truth is not None:
        work = work_for(memory_bytes, 1, silent)
        with scored_scene(predictions, truth, chosen, memory_bytes, work) as found:
            return found.notes
    with _entry(predictions, scene, chosen, memory_bytes) as entry:
        if isinstance(entry.geometry, FileCloud):
            # A file that is cut off is found out where it is read.
            for _piece in entry.geometry.pieces(_LEAST_BLOCK):
                pass
        return [f"scene {scene}: {note}" for note in entry.geometry.notes]


def rules_of(chosen: ReconstructionProtocol) -> Rules:
    """Return what a protocol states of how a scene is scored."""
    return Rules(chosen.alignment, chosen.fusion, chosen.preparation, chosen.scores)


def _sampling(chosen: ReconstructionProtocol) -> MeshSampling:
    meshes = chosen.meshes
    return MeshSampling(
        seed=meshes.seed, count=meshes.points, per_square_unit=None, max_points=meshes.points
    )
