"""Writing a prediction file an answer at a time, each checked when it is given."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Never, Self

from numpy.typing import ArrayLike

from airzoo_bench.api.arrays import path_of
from airzoo_bench.api.benchmark import BlindBenchmark, load_benchmark
from airzoo_bench.api.collectors import (
    DESCRIPTOR,
    FIELDS,
    KINDS,
    MATCHES,
    PAIRS,
    POSES,
    RANKED,
    Collector,
    Kind,
)
from airzoo_bench.api.query_collectors import (
    DescriptorCollector,
    MatchCollector,
    PoseCollector,
    RankedCollector,
)
from airzoo_bench.api.scene_collector import SceneCollector
from airzoo_bench.benchmark.mirrored import data_here
from airzoo_bench.core.errors import PredictionError, UsageError, UserError
from airzoo_bench.core.places import cannot_write, check_output_file, check_output_folder
from airzoo_bench.core.temporaries import only_writer, temporary_folder
from airzoo_bench.evaluation.prediction_files import check_npz
from airzoo_bench.protocol.lookup import find_protocol
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.retrieval.settings import RetrievalProtocol

__all__ = ["PredictionWriter"]


class PredictionWriter:
    """Collects a method's answers and writes the prediction file that ``eval`` reads.

    Each answer is checked when it is added. The file appears, whole, when the ``with`` block ends;
    where it ends by an exception or Ctrl-C, what stood there before stays as it was. Answers may
    come in any order: the file is the same. What never gets an answer scores as a failure.

    Parameters
    ----------
    path : str or Path
        An ``.npz``; for reconstruction a folder.
    protocol : str
        Name or path, such as ``airzoo-mini-retrieval``.
    benchmark : BlindBenchmark, optional
        As `load_benchmark` returns it; by default the protocol's, from the data root.

    Raises
    ------
    UserError
        The protocol or its benchmark is not there, they do not belong together, nothing can be
        written to `path`, or another writer is at it.

    Examples
    --------
    >>> benchmark = load_benchmark("airzoo-mini")  # doctest: +SKIP
    >>> with PredictionWriter("mine.npz", "airzoo-mini-retrieval", benchmark) as writer:
    ...     for query in benchmark.scenes[0].queries():
    ...         writer.add(query.id, ranked_ids=rank(query.image))  # doctest: +SKIP
    """

    def __init__(
        self, path: str | Path, protocol: str, benchmark: BlindBenchmark | None = None
    ) -> None:
        self._path = path_of("path", path)
        self._protocol = find_protocol(protocol, benchmark.folder if benchmark else data_here())
        opened = benchmark or load_benchmark(self._protocol.benchmark)
        if self._protocol.benchmark != opened.name:
            raise UsageError(
                f"protocol {self._protocol.name} is of benchmark {self._protocol.benchmark}, "
                f"not {opened.name}",
                where=opened.folder,
                fix=f"load_benchmark({self._protocol.benchmark!r})",
            )
        self._scenes = opened.scenes_of(self._protocol)
        _check_place(self._path, self._protocol)
        self._kind: Kind | None = None
        self._collector: Collector | None = None
        self._added: set[str] = set()
        self._closed = False
        self._stack = ExitStack()
        self._hold()

    def add(
        self,
        name: str,
        *,
        ranked_ids: Collection[str] | None = None,
        scores: ArrayLike | None = None,
        descriptor: ArrayLike | None = None,
        query_xy: ArrayLike | None = None,
        map_xy: ArrayLike | None = None,
        points3d: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        centre: ArrayLike | None = None,
        points: ArrayLike | None = None,
        colours: ArrayLike | None = None,
        depth: ArrayLike | None = None,
        intrinsics: ArrayLike | None = None,
        confidence: ArrayLike | None = None,
        **unknown: Never,
    ) -> None:
        """Add the answer to one query, or what is found of one tile, photo or scene.

        ==============  =====================================================  ==================
        track           fields                                                 `name` is the id of
        ==============  =====================================================  ==================
        retrieval       `ranked_ids`, perhaps `scores`                         a query
        retrieval       `descriptor`                                           a query or a tile
        matching        `query_xy` and `map_xy`, or `query_xy` and `points3d`  a query
        matching        `rotation` and `centre`                                a query
        reconstruction  `points`, perhaps `colours`                            a scene
        reconstruction  `rotation` and `centre`, next to a cloud               a photo
        reconstruction  `depth`, `intrinsics`, `rotation` and `centre`,        a photo
                        perhaps `confidence`
        ==============  =====================================================  ==================

        Retrieval and matching take one kind of answer a file, reconstruction one a scene.

        Parameters
        ----------
        name : str
            The id, ``scene/name``; of a scene its own. Each once.
        ranked_ids : collection of K str
            Tiles of the query's scene, best first; may be empty.
        scores : (K,) array, optional
            Similarities, which fall along the list, or distances, which rise.
        descriptor : (D,) float array
            Compared by the protocol's metric. Every tile of every scene needs one.
        query_xy : (M, 2) array
            Pixels of the photo at its full size, its corner being (0, 0); M may be 0.
        map_xy : (M, 2) array
            Pixels of the whole map, such as `Crop.to_map` returns.
        points3d : (M, 3) float64 array
            Instead: points in the scene's CRS, in metres.
        rotation : (3, 3) array
            World-to-camera, x right, y down, z forward.
        centre : (3,) float64 array
            The camera's centre; in the scene's CRS, or for reconstruction in that of the cloud.
        points : (M, 3) float64 array
            The cloud of a scene, in any frame that its cameras are in.
        colours : (M, 3) uint8 array, optional
            Red, green, blue of each point.
        depth : (H, W) float array
            Along the camera's z axis, in the units of `centre`; 0 and NaN are no surface. Of one
            size in all photos of a scene.
        intrinsics : (3, 3) array
            K at the size of the depth map, such as ``photo.camera.scaled(W, H).K``.
        confidence : (H, W) float array, optional
            Larger is surer; of the size of the depth map.
        **unknown
            Fields of no track; refused.

        Raises
        ------
        UserError
            The id is none of the benchmark's or was added before; fields are missing, do not
            belong together, or have a wrong shape or impossible values. Nothing of it is kept.
        """
        given = {key: value for key, value in locals().items() if value is not None}
        fields = {key: given[key] for key in FIELDS if key in given} | unknown
        try:
            collector = self._collector_for(fields)
            if name in self._added:
                raise PredictionError("was added before", expected="each id once")
            collector.add(name, fields)
        except UserError as error:
            raise error.inside(f"{self._path}, {str(name)[:80]}") from error
        self._added.add(name)

    def __len__(self) -> int:
        """How many answers were added."""
        return len(self._added)

    def missing(self) -> tuple[str, ...]:
        """Return the ids that have no answer: of queries (and tiles) or scenes.

        Returns
        -------
        tuple of str
            In the order of the benchmark.

        Raises
        ------
        UsageError
            Nothing was added yet, so that it is not known what was to come.
        """
        if self._collector is None:
            raise UsageError("no answer was added yet", where=self._path)
        return self._collector.missing()

    def close(self) -> None:
        """Write the file; a ``with`` block does it at its end. Afterwards nothing can be added.

        Raises
        ------
        UserError
            There is no answer, a tile has no descriptor, or the file cannot be written.
        """
        if self._closed:
            return
        self._closed = True
        with self._stack:
            if self._collector is None:
                raise PredictionError("no answer was added", where=self._path)
            try:
                self._collector.write(self._path, self._protocol.name)
            except PredictionError as error:
                raise error.inside(self._path) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        self._closed = True
        self._stack.close()

    def __repr__(self) -> str:
        return f"PredictionWriter({str(self._path)!r}, {self._protocol.name!r}): {len(self)} added"

    def _collector_for(self, fields: dict[str, Any]) -> Collector:
        """Return what collects answers with these fields."""
        if self._closed:
            raise UsageError("the file is closed", fix="add all answers in the with block")
        track = self._protocol.track
        kind = next((kind for kind in KINDS if kind.fits(track, fields)), None)
        if kind is None:
            raise PredictionError(
                f"{' and '.join(fields) or 'nothing'} is no answer of the {track} track",
                expected="; or ".join(str(kind) for kind in KINDS if kind.track == track),
            )
        if self._collector is None:
            self._kind, self._collector = kind, self._new_collector(kind)
        elif kind != self._kind and track != "reconstruction":
            raise PredictionError(
                f"{kind} after answers of another kind", expected=f"{self._kind} in all of the file"
            )
        return self._collector

    def _new_collector(self, kind: Kind) -> Collector:
        protocol = self._protocol
        if kind == RANKED and isinstance(protocol, RetrievalProtocol):
            return RankedCollector(self._scenes, protocol.scores.depth)
        if kind == DESCRIPTOR and isinstance(protocol, RetrievalProtocol):
            metric = protocol.scores.descriptor_metric
            return DescriptorCollector(self._scenes, metric, self._staging())
        if kind in (MATCHES, PAIRS):
            return MatchCollector(self._scenes, kind.needed[1])
        if kind == POSES:
            return PoseCollector(self._scenes)
        return SceneCollector(self._scenes, self._staging())

    def _hold(self) -> None:
        """Refuse a path that another writer has: of two the last to end would lose the other's."""
        try:
            self._path.absolute().parent.mkdir(parents=True, exist_ok=True)
            self._stack.enter_context(only_writer(self._path))
        except BlockingIOError as error:
            raise UsageError(
                "is being written by another PredictionWriter",
                where=self._path,
                fix="name another file, or end the other first: its with block, or close()",
            ) from error
        except OSError as error:
            raise cannot_write(self._path, error) from error

    def _staging(self) -> Path:
        """Return a folder next to the file, which is gone when the writer is closed."""
        parent = self._path.absolute().parent
        return self._stack.enter_context(temporary_folder(parent, self._path.name))


def _check_place(path: Path, protocol: Protocol) -> None:
    if isinstance(protocol, ReconstructionProtocol):
        check_output_folder(path, ("protocol.txt",))
        return
    check_npz(path)
    check_output_file(path)
