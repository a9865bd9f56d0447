"""Writing a prediction file an answer at a time, each checked when it is given."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any, Never, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api.arrays import coordinates, floats, in_order, numbers, path_of
from airzoo_bench.api.benchmark import BlindBenchmark, load_benchmark
from airzoo_bench.api.labels import same_index
from airzoo_bench.api.photos import Photo
from airzoo_bench.api.scene_views import RowFile, SceneViews, cloud_and_depth
from airzoo_bench.benchmark.mirrored import data_here
from airzoo_bench.core.errors import PredictionError, UsageError, UserError, first_of
from airzoo_bench.core.files import (
    atomic_entries,
    cannot_write,
    check_output_file,
    check_output_folder,
    only_writer,
    temporary_folder,
    write_npz,
)
from airzoo_bench.core.ids import IMAGE_SUFFIXES
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.queries import check_npz, write_predictions
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import check_rotations
from airzoo_bench.protocol.lookup import find_protocol
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.retrieval.checks import deep_validation_errors, validation_errors
from airzoo_bench.retrieval.descriptors import Rows, check_descriptors
from airzoo_bench.retrieval.predictions import RankedIds, RetrievalPredictions
from airzoo_bench.retrieval.settings import RetrievalProtocol

__all__ = ["PredictionWriter"]

_Fields = Mapping[str, Any]
_Answer = dict[str, Any]
_Arrays = dict[str, NDArray[Any]]

_SLACK_PX = 1.0  # sub-pixel refinement oversteps a picture's border
_SCENE_ENDINGS = (".ply", ".cameras.npz", ".npz")


@dataclass(frozen=True)
class _Kind:
    """A kind of answer: its track, the fields that it has, and those that it may have."""

    track: str
    needed: tuple[str, ...]
    optional: tuple[str, ...] = ()

    def fits(self, track: str, names: Collection[str]) -> bool:
        fields = {*self.needed, *self.optional}
        return track == self.track and set(self.needed) <= set(names) <= fields

    def __str__(self) -> str:
        return " and ".join((*self.needed, *(f"perhaps {name}" for name in self.optional)))


_RANKED = _Kind("retrieval", ("ranked_ids",), ("scores",))
_DESCRIPTOR = _Kind("retrieval", ("descriptor",))
_MATCHES = _Kind("matching", ("query_xy", "map_xy"))
_PAIRS = _Kind("matching", ("query_xy", "points3d"))
_POSES = _Kind("matching", ("rotation", "centre"))
_CLOUD = _Kind("reconstruction", ("points",), ("colours",))
_CAMERA = _Kind("reconstruction", ("rotation", "centre"))
_DEPTH = _Kind("reconstruction", ("depth", "intrinsics", "rotation", "centre"), ("confidence",))
_KINDS = (_RANKED, _DESCRIPTOR, _MATCHES, _PAIRS, _POSES, _CLOUD, _CAMERA, _DEPTH)
_FIELDS = dict.fromkeys(name for kind in _KINDS for name in (*kind.needed, *kind.optional))


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
        self._kind: _Kind | None = None
        self._answers: dict[str, _Answer] = {}
        self._way = 0.0  # in which scores go along a list, once there are any
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
        fields = {key: given[key] for key in _FIELDS if key in given} | unknown
        try:
            kind = self._kind_of(fields)
            if name in self._answers:
                raise PredictionError("was added before", expected="each id once")
            self._answers[name] = self._checked(kind, name, fields)
        except UserError as error:
            raise error.inside(f"{self._path}, {str(name)[:80]}") from error
        self._kind = self._kind or kind

    def __len__(self) -> int:
        """How many answers were added."""
        return len(self._answers)

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
        if self._kind is None:
            raise UsageError("no answer was added yet", where=self._path)
        if self._kind.track == "reconstruction":
            return tuple(name for name, scene in self._views.items() if not scene.has_geometry)
        names: list[str] = [*(self._photos if self._kind.track == "matching" else self._queries)]
        names += [*self._tiles] if self._kind == _DESCRIPTOR else []
        return tuple(name for name in names if name not in self._answers)

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
            if self._kind is None:
                raise PredictionError("no answer was added", where=self._path)
            try:
                self._write(self._kind)
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

    def _kind_of(self, fields: _Fields) -> _Kind:
        """Return the kind of answer that has these fields; a file has one, a folder any."""
        if self._closed:
            raise UsageError("the file is closed", fix="add all answers in the with block")
        track = self._protocol.track
        kind = next((kind for kind in _KINDS if kind.fits(track, fields)), None)
        if kind is None:
            raise PredictionError(
                f"{' and '.join(fields) or 'nothing'} is no answer of the {track} track",
                expected="; or ".join(str(kind) for kind in _KINDS if kind.track == track),
            )
        if self._kind not in (None, kind) and track != "reconstruction":
            raise PredictionError(
                f"{kind} after answers of another kind", expected=f"{self._kind} in all of the file"
            )
        return kind

    def _checked(self, kind: _Kind, name: str, fields: _Fields) -> _Answer:
        """Return an answer as it is kept."""
        if kind == _RANKED:
            return self._ranked(name, fields)
        if kind == _DESCRIPTOR:
            return self._described(name, fields["descriptor"])
        if kind in (_MATCHES, _PAIRS):
            return self._matched(name, fields, kind.needed[1])
        if kind == _POSES:
            _refuse_unknown(name, self._photos, "query of the benchmark")
            rotation = coordinates("rotation", fields["rotation"], (3, 3), any_history=True)
            check_rotations(rotation[None], [name])
            centre = coordinates("centre", fields["centre"], (3,), any_history=True)
            return {"rotation": rotation, "centre": centre}
        if kind == _CLOUD:
            self._add_cloud(name, fields)
        else:
            _refuse_unknown(name, self._scene_of, "photo of the reconstruction")
            self._views[self._scene_of[name]].add(name, fields)
        return {}

    def _write(self, kind: _Kind) -> None:
        if kind.track == "reconstruction":
            self._write_scenes()
            return
        order = self._photos if kind.track == "matching" else self._queries
        ids = [name for name in order if name in self._answers]
        answers = [self._answers[name] for name in ids]
        if kind == _RANKED:
            arrays = self._ranked_arrays(answers)
        elif kind == _DESCRIPTOR:
            arrays = self._described_arrays()
        elif kind == _POSES:
            arrays = {
                "rotations": np.array([one["rotation"] for one in answers]).reshape(-1, 3, 3),
                "centres": np.array([one["centre"] for one in answers]).reshape(-1, 3),
            }
        else:
            arrays = {
                "offsets": np.cumsum(
                    [0, *(len(one["query_xy"]) for one in answers)], dtype=np.int64
                ),
                **{key: np.concatenate([one[key] for one in answers]) for key in kind.needed},
            }
        all_ids = {"query_ids": np.array(ids, dtype=str)}
        write_predictions(self._path, self._protocol.name, all_ids | arrays)

    @cached_property
    def _queries(self) -> dict[str, int]:
        ids = (photo.id for scene in self._scenes for photo in scene.queries())
        return {name: row for row, name in enumerate(ids)}

    @cached_property
    def _tiles(self) -> dict[str, int]:
        ids = (tile.id for scene in self._scenes for tile in scene.tiles())
        return {name: row for row, name in enumerate(ids)}

    @cached_property
    def _photos(self) -> dict[str, Photo]:
        crops = (crop for scene in self._scenes for crop in scene.crops())
        return {crop.query.id: crop.query for crop in crops}

    @cached_property
    def _folder(self) -> Path:
        """Return a folder next to the file, which is gone when the writer is closed."""
        parent = self._path.absolute().parent
        return self._stack.enter_context(temporary_folder(parent, self._path.name))

    @cached_property
    def _descriptors(self) -> tuple[RowFile, RowFile]:
        """Return the descriptors of queries and of tiles."""
        return (
            RowFile(self._folder / "queries", "descriptor", len(self._queries), axes=1),
            RowFile(self._folder / "gallery", "descriptor", len(self._tiles), axes=1),
        )

    @cached_property
    def _views(self) -> dict[str, SceneViews]:
        return {
            scene.id: SceneViews.of(scene.id, scene.photos(), self._folder)
            for scene in self._scenes
        }

    @cached_property
    def _scene_of(self) -> dict[str, str]:
        return {photo: scene for scene, views in self._views.items() for photo in views.rows}

    def _ranked(self, name: str, fields: _Fields) -> _Answer:
        _refuse_unknown(name, self._queries, "query of the benchmark")
        same_index(fields)
        ids = [str(tile) for tile in in_order("ranked_ids", fields["ranked_ids"])]
        for tile in ids:
            _refuse_unknown(tile, self._tiles, "tile of the gallery")
        scores = self._scores(fields.get("scores"), len(ids))
        _refuse_bad_list(name, ids, scores)
        self._way = self._way or _way(scores)
        return {"tiles": [self._tiles[tile] for tile in ids], "scores": scores}

    def _scores(self, given: ArrayLike | None, count: int) -> Floats | None:
        first = next(iter(self._answers.values()), None)
        if first is not None and (first["scores"] is None) != (given is None):
            raise PredictionError(
                "scores with some queries only", expected="scores with every query, or with none"
            )
        if given is None:
            return None
        scores = floats("scores", given, (count,))
        if self._way * _way(scores) < 0:
            raise PredictionError(
                "scores rise here and fall in the answers before, or the other way round",
                expected="similarities, which fall along a list, or distances, which rise, in all",
            )
        return scores

    def _ranked_arrays(self, answers: list[_Answer]) -> _Arrays:
        """Return lists of one length: shorter ones are filled up with empty ids."""
        assert isinstance(self._protocol, RetrievalProtocol)
        longest = max([self._protocol.scores.depth, *(len(one["tiles"]) for one in answers)])
        tiles = np.full((len(answers), longest), -1)
        scores = np.zeros((len(answers), longest))
        for row, one in enumerate(answers):
            count = len(one["tiles"])
            tiles[row, :count] = one["tiles"]
            if one["scores"] is not None and count:
                scores[row, :count], scores[row, count:] = one["scores"], one["scores"][-1]
        ranked_ids = np.array([*self._tiles, ""], dtype=str)[tiles]
        scored = any(one["scores"] is not None for one in answers)
        return {"ranked_ids": ranked_ids} | ({"scores": scores} if scored else {})

    def _described(self, name: str, given: ArrayLike) -> _Answer:
        assert isinstance(self._protocol, RetrievalProtocol)
        queries, tiles = self._descriptors
        _refuse_unknown(name, self._queries | self._tiles, "query or tile of the benchmark")
        descriptor = tiles.check(queries.check(given))
        metric = self._protocol.scores.descriptor_metric
        check_descriptors(Rows.join(descriptor[None]), "descriptor", metric, [name])
        if name in self._queries:
            queries.put(self._queries[name], descriptor)
        else:
            tiles.put(self._tiles[name], descriptor)
        return {}

    def _described_arrays(self) -> _Arrays:
        queries, tiles = self._descriptors
        lacking = [name for name in self._tiles if name not in self._answers]
        if lacking:
            raise PredictionError(
                f"no descriptor of tiles: {first_of(lacking, len(self._tiles))}",
                expected="every tile of the gallery: leaving some out would make the task easier",
                fix="add the descriptor of each tile of scene.tiles(), in every scene",
            )
        if not queries.there.any():
            raise PredictionError("no query has a descriptor", expected="at least one")
        return {
            "query_descriptors": queries.packed(),
            "gallery_ids": np.array([*self._tiles], dtype=str),
            "gallery_descriptors": tiles.packed(),
        }

    def _matched(self, name: str, fields: _Fields, target: str) -> _Answer:
        _refuse_unknown(name, self._photos, "query of the benchmark")
        same_index(fields)
        query_xy = coordinates("query_xy", fields["query_xy"], (None, 2), any_history=True)
        _refuse_outside(query_xy, self._photos[name])
        shape = (None, 2 if target == "map_xy" else 3)
        there = coordinates(target, fields[target], shape, any_history=True)
        if len(there) != len(query_xy):
            raise PredictionError(
                f"{target} has {len(there):,} rows, query_xy has {len(query_xy):,}",
                expected="a row a match in both",
            )
        return {"query_xy": query_xy, target: there}

    def _add_cloud(self, scene: str, fields: _Fields) -> None:
        _refuse_unknown(scene, self._views, "scene of the benchmark")
        same_index(fields)
        points = coordinates("points", fields["points"], any_history=True)
        colours = fields.get("colours")
        if colours is not None:
            colours = numbers("colours", colours, (len(points), 3))
            if colours.dtype != np.uint8:
                raise PredictionError(f"colours are {colours.dtype}", expected="uint8")
        if not len(points):
            raise PredictionError("points is empty", expected="points, or no cloud at all")
        views = self._views[scene]
        if views.intrinsics:
            raise cloud_and_depth()
        views.has_cloud = True
        write_ply(self._folder / f"{scene}.ply", Cloud(points, colours))

    def _write_scenes(self) -> None:
        entries = [f"{name}{ending}" for name in self._views for ending in _SCENE_ENDINGS]
        with atomic_entries(self._path, ("protocol.txt", *entries)) as folder:
            for name, views in self._views.items():
                if views.has_cloud:
                    shutil.move(self._folder / f"{name}.ply", folder / f"{name}.ply")
                arrays = views.arrays()
                if arrays:
                    ending = ".npz" if "depth" in arrays else ".cameras.npz"
                    write_npz(folder / f"{name}{ending}", arrays)
            (folder / "protocol.txt").write_text(f"{self._protocol.name}\n", encoding="utf-8")

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


def _refuse_unknown(name: str, known: Mapping[str, object], what: str) -> None:
    """Refuse what is no id; the one that is meant, or the nearest are offered."""
    if name in known:
        return
    shown = str(name)[:80]
    meant = _without_ending(shown, known)
    raise PredictionError(
        f"{shown!r} is no {what}{'' if meant else nearest(shown, list(known))}",
        expected=f"an id such as {next(iter(known), 'scene/name')}",
        fix=repr(meant) if meant else None,
    )


def _without_ending(name: str, known: Mapping[str, object]) -> str | None:
    """Return the one id that is meant by the name of a file, with or without its scene."""
    path = PurePosixPath(name)
    stem = str(path.with_suffix("")) if path.suffix.lower() in IMAGE_SUFFIXES else name
    meant = [one for one in known if one == stem or one.endswith(f"/{stem}")]
    return meant[0] if stem and len(meant) == 1 else None


def _refuse_bad_list(name: str, ids: list[str], scores: Floats | None) -> None:
    """Check one list for all that is asked of a file of lists."""
    ranked = RankedIds(np.array([ids], dtype=str), None if scores is None else scores[None])
    one = RetrievalPredictions(Path(name), None, np.array([name]), ranked)
    scene = name.partition("/")[0]
    for error in chain(validation_errors(one), deep_validation_errors(one, "l2", [scene])):
        raise PredictionError(error.what, expected=error.expected, fix=error.fix)


def _way(scores: Floats | None) -> float:
    """Return 1 where scores rise, -1 where they fall, 0 where there is no telling."""
    steps = np.diff(np.zeros(0) if scores is None else scores)
    moving = steps[steps != 0]
    return float(np.sign(moving[0])) if moving.size else 0.0


def _refuse_outside(query_xy: Floats, photo: Photo) -> None:
    size = np.array((photo.camera.width, photo.camera.height))
    outside = ((query_xy < -_SLACK_PX) | (query_xy > size + _SLACK_PX)).any(axis=1)
    if outside.any():
        x, y = query_xy[outside][0]
        raise PredictionError(
            f"{int(outside.sum())} of {len(query_xy)} pixels of query_xy lie outside the photo, "
            f"such as ({x:.1f}, {y:.1f})",
            expected=f"pixels of the photo at its full size, {size[0]} x {size[1]} px, x before y",
            fix="scale pixels of a photo that was made smaller back up",
        )


def _check_place(path: Path, protocol: Protocol) -> None:
    if isinstance(protocol, ReconstructionProtocol):
        check_output_folder(path, ("protocol.txt",))
        return
    check_npz(path)
    check_output_file(path)
