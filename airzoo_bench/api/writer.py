"""Writing a prediction file an answer at a time."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api import arguments as arg
from airzoo_bench.api.benchmark import BlindBenchmark, BlindScene, load_benchmark
from airzoo_bench.benchmark.folder import data_here
from airzoo_bench.core.errors import PredictionError, UsageError, UserError, first_of
from airzoo_bench.core.files import (
    atomic_entries,
    check_output_file,
    check_output_folder,
    write_npz,
)
from airzoo_bench.core.ids import IMAGE_SUFFIXES
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.evaluate import check as find_errors
from airzoo_bench.evaluation.queries import check_npz, write_predictions
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.protocol.model import find_protocol

__all__ = ["PredictionWriter"]

Array = NDArray[Any]
Answer = dict[str, Array]

_SCENE_FILES = (".ply", ".cameras.npz", ".npz")
_POSE, _DEPTH = {"rotation", "centre"}, {"rotation", "centre", "depth", "intrinsics"}
# The fields of every kind of answer.
_FORMS: dict[str, tuple[set[str], ...]] = {
    "retrieval": ({"ranked_ids"}, {"ranked_ids", "scores"}, {"descriptor"}),
    "matching": ({"query_xy", "map_xy"}, {"query_xy", "points3d"}, _POSE),
    "reconstruction": ({"points"}, {"points", "colours"}, _POSE, _DEPTH, _DEPTH | {"confidence"}),
}
_SHAPES: dict[str, tuple[int | None, ...]] = {
    **dict.fromkeys(("scores", "descriptor"), (None,)),
    **dict.fromkeys(("query_xy", "map_xy"), (None, 2)),
    **dict.fromkeys(("points3d", "points", "colours"), (None, 3)),
    **dict.fromkeys(("depth", "confidence"), (None, None)),
    **dict.fromkeys(("rotation", "intrinsics"), (3, 3)),
    "centre": (3,),
}
_COORDINATES = ("query_xy", "map_xy", "points3d", "centre", "points")
# Fields whose rows become one array, and fields that are pairs.
_STACKED, _PAIRED = ("descriptor", "depth", "confidence"), {"query_xy", "ranked_ids", "points"}


class PredictionWriter:
    """Collects a method's answers and writes the prediction file that ``eval`` reads.

    Each answer is checked when it is added; they may come in any order. When the ``with`` block
    ends, the file appears, whole, and is checked as ``airzoo-bench check`` does; after an exception
    or Ctrl-C, an earlier file stays. A query without an answer scores as a failure.

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
        The protocol or its benchmark is not there, they do not belong together, or nothing can be
        written to `path`.

    Examples
    --------
    >>> with PredictionWriter("mine.npz", "airzoo-mini-retrieval") as writer:
    ...     writer.add("city/0001", ranked_ids=["city/160_00000_00000"])  # doctest: +SKIP
    """

    def __init__(
        self, path: str | Path, protocol: str, benchmark: BlindBenchmark | None = None
    ) -> None:
        self._path = Path(path)
        data = benchmark.folder if benchmark else data_here()
        self._protocol: Any = find_protocol(protocol, data)
        self._track = self._protocol.track
        self._benchmark = benchmark or load_benchmark(self._protocol.benchmark)
        if self._protocol.benchmark != self._benchmark.name:
            raise UsageError(
                f"protocol {self._protocol.name} is of benchmark {self._protocol.benchmark}, "
                f"not {self._benchmark.name}",
                where=self._benchmark.folder,
                fix=f"load_benchmark({self._protocol.benchmark!r})",
            )
        if self._track == "reconstruction":
            check_output_folder(self._path, ("protocol.txt",))
        else:
            check_npz(self._path)
            check_output_file(self._path)
        self._benchmark._source.check_fits(self._protocol)
        self._scenes = [self._benchmark.scene(scene.id) for scene in self._protocol.scenes]
        self._ids = _known_ids(self._track, self._scenes)
        self._answers: dict[str, Answer] = {}
        self._firsts: dict[str, Answer] = {}  # of each group that has one kind of answer
        self._closed = False

    def add(self, name: str, **fields: ArrayLike | None) -> None:
        """Add the answer to one query, or the description of one tile, photo or scene.

        ==============  ======================================================  ==================
        track           fields                                                  `name` is the id of
        ==============  ======================================================  ==================
        retrieval       `ranked_ids`, perhaps `scores`                          a query
        retrieval       `descriptor`                                            a query or a tile
        matching        `query_xy` and `map_xy`, or `query_xy` and `points3d`   a query
        matching        `rotation` and `centre`                                 a query
        reconstruction  `points`, perhaps `colours`                             a scene
        reconstruction  `rotation` and `centre`; with `depth` and `intrinsics`  a photo
        ==============  ======================================================  ==================

        A file has one kind of answer, with the same fields in all; of reconstruction each scene.

        Parameters
        ----------
        name : str
            The id, ``scene/name``; of a scene its own. Each once.
        **fields : array-like
            ``ranked_ids`` (K,): tiles of the query's scene, best first. ``scores`` (K,):
            similarities, which fall along the list, or distances, which rise. ``descriptor`` (D,):
            every tile of every scene needs one. ``query_xy`` (M, 2): pixels of the photo at its
            full size, from its corner. ``map_xy`` (M, 2): pixels of the whole map (`Crop.to_map`).
            ``points3d`` (M, 3): in the scene's CRS, in metres. ``rotation`` (3, 3):
            world-to-camera, x right, y down, z forward. ``centre`` (3,): in the scene's CRS, or
            the frame of the cloud. ``points`` (M, 3), ``colours`` (M, 3) uint8. ``depth`` (H, W):
            along the camera's z axis, 0 and NaN are no surface. ``intrinsics`` (3, 3): K at the
            size of the depth map. ``confidence`` (H, W), with depth: larger is surer.

        Raises
        ------
        UserError
            The id is none of the benchmark's or was added before; fields are missing, do not belong
            together, or have a wrong shape. Nothing of it is kept.
        """
        given = {key: value for key, value in fields.items() if value is not None}
        try:
            if self._closed:
                raise UsageError("the file is closed", fix="add all answers in the with block")
            group = self._find_group(name, {*given})
            answer = _checked_answer(given)
            for tile in answer.get("ranked_ids", ()):
                if tile not in self._ids["tile"]:
                    raise _unknown(tile, self._ids["tile"], "tile of the gallery")
            self._check_alike(group, answer)
        except UserError as error:
            raise error.inside(f"{self._path}, {str(name)[:80]}") from error
        self._answers[name] = answer
        self._firsts.setdefault(self._alike_in(group), answer)

    def __len__(self) -> int:
        """Return the number of answers."""
        return len(self._answers)

    def missing(self) -> tuple[str, ...]:
        """Return the ids that have no answer: of queries (and tiles) or scenes, in order."""
        if self._track == "reconstruction":
            with_depth = {group[9:] for group, one in self._firsts.items() if "depth" in one}
            done = self._answers.keys() | with_depth
            return tuple(scene for scene in self._ids["scene"] if scene not in done)
        names = [*self._ids["query"]]
        if any("descriptor" in one for one in self._firsts.values()):
            names += self._ids["tile"]
        return tuple(name for name in names if name not in self._answers)

    def close(self) -> None:
        """Write the file and check it, as a ``with`` block does at its end.

        Raises a `UserError` where there is no answer, or the file cannot be written or scored.
        """
        if self._closed:
            return
        self._closed = True
        if not self._answers.keys() & self._ids.get("query", self._answers).keys():
            raise PredictionError("no answer was added", where=self._path)
        if self._track == "reconstruction":
            self._write_scenes()
        else:
            write_predictions(self._path, self._protocol.name, self._query_arrays())
        found = find_errors(self._path, data=self._benchmark.folder, protocol=self._protocol.name)
        if found.errors:
            raise found.errors[0]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: object, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        self._closed = True

    def __repr__(self) -> str:
        return f"PredictionWriter({str(self._path)!r}, {self._protocol.name!r}): {len(self)} added"

    def _alike_in(self, group: str) -> str:
        """Return what has one kind of answer: a whole file, or the photos of a scene."""
        return group if self._track == "reconstruction" else "all answers"

    def _find_group(self, name: str, form: set[str]) -> str:
        """Return the group of an id that may be added with these fields."""
        forms = _FORMS[self._track]
        if form not in forms:
            what = f"{_joined(form) or 'nothing'} is no answer of the {self._track} track"
            raise PredictionError(what, expected="; or ".join(map(_joined, forms)))
        groups = [group for group in self._ids if (group == "scene") == ("points" in form)]
        if "descriptor" not in form and "tile" in groups:
            groups.remove("tile")
        group = next((one for one in groups if name in self._ids[one]), None)
        if group is None:
            known = [one for some in groups for one in self._ids[some]]
            raise _unknown(name, known, f"{' or '.join(groups)} of the benchmark")
        if name in self._answers:
            raise PredictionError("was added before", expected="each id once")
        return group

    def _check_alike(self, group: str, answer: Answer) -> None:
        """Refuse an answer of another kind, or with rows of another type or shape, than others."""
        alike = self._alike_in(group)
        first = self._firsts.get(alike, answer)
        if first.keys() != answer.keys():
            what = f"{_joined(answer)} after answers of another kind"
            raise PredictionError(what, expected=f"{_joined(first)} in {alike}")
        for key in {*_STACKED} & answer.keys():
            one, row = first[key], answer[key]
            if row.dtype.kind != "f" or (row.shape, row.dtype) != (one.shape, one.dtype):
                expected = f"floats, of the type and shape of the first: {one.dtype} {one.shape}"
                raise PredictionError(f"{key} is {row.dtype} {row.shape}", expected=expected)

    def _query_arrays(self) -> Answer:
        """Return the arrays of a file of queries, in the order of the benchmark."""
        names = [name for name in self._ids["query"] if name in self._answers]
        answers = [self._answers[name] for name in names]
        form = answers[0].keys()
        if "descriptor" in form:
            arrays = self._descriptors(answers)
        elif "ranked_ids" in form:
            arrays = _padded_lists(answers, self._protocol.scores.depth)
        elif "query_xy" in form:
            arrays = {key: np.concatenate([one[key] for one in answers]) for key in form}
            counts = [0, *(len(one["query_xy"]) for one in answers)]
            arrays["offsets"] = np.cumsum(counts, dtype=np.int64)
        else:
            arrays = {f"{key}s": np.stack([one[key] for one in answers]) for key in form}
        return {"query_ids": np.array(names, dtype=str), **arrays}

    def _descriptors(self, answers: list[Answer]) -> Answer:
        tiles = [*self._ids["tile"]]
        if lacking := [name for name in tiles if name not in self._answers]:
            raise PredictionError(
                f"no descriptor of tiles: {first_of(lacking, len(tiles))}",
                where=self._path,
                expected="every tile of the gallery: leaving some out would make the task easier",
                fix="add the descriptor of each tile of scene.tiles(), in every scene",
            )
        return {
            "query_descriptors": np.stack([one["descriptor"] for one in answers]),
            "gallery_ids": np.array(tiles, dtype=str),
            "gallery_descriptors": np.stack([self._answers[one]["descriptor"] for one in tiles]),
        }

    def _write_scenes(self) -> None:
        entries = [f"{scene.id}{ending}" for scene in self._scenes for ending in _SCENE_FILES]
        with atomic_entries(self._path, ("protocol.txt", *entries)) as folder:
            for scene in self._scenes:
                if cloud := self._answers.get(scene.id):
                    write_ply(folder / f"{scene.id}.ply", Cloud(**cloud))
                photos = [photo for photo in scene.photos() if photo.id in self._answers]
                if photos:
                    arrays = _view_arrays([self._answers[photo.id] for photo in photos])
                    names = np.array([photo.name for photo in photos], dtype=str)
                    ending = ".npz" if "depth" in arrays else ".cameras.npz"
                    write_npz(folder / f"{scene.id}{ending}", {"image_names": names, **arrays})
            (folder / "protocol.txt").write_text(f"{self._protocol.name}\n", encoding="utf-8")


def _known_ids(track: str, scenes: Iterable[BlindScene]) -> dict[str, dict[str, None]]:
    """Return the ids that may be answered, in groups, each in the order of the benchmark."""
    groups: dict[str, list[str]] = {}
    if track == "reconstruction":
        groups["scene"] = [scene.id for scene in scenes]
        groups |= {f"photo of {one.id}": [photo.id for photo in one.photos()] for one in scenes}
    elif track == "matching":
        groups["query"] = [crop.query.id for scene in scenes for crop in scene.crops()]
    else:
        groups["query"] = [query.id for scene in scenes for query in scene.queries()]
        groups["tile"] = [tile.id for scene in scenes for tile in scene.tiles()]
    return {group: dict.fromkeys(ids) for group, ids in groups.items()}


def _checked_answer(fields: dict[str, Any]) -> Answer:
    """Return the fields of an answer as arrays of the right shapes."""
    arg.check_labels(**fields)
    answer: Answer = {}
    for key, values in fields.items():
        if key == "ranked_ids":
            answer[key] = np.array([*map(str, arg.listed(key, values))], dtype=str)
        elif key in _COORDINATES:
            answer[key] = arg.coordinates(key, values, _SHAPES[key], any_history=True)
        else:
            answer[key] = np.array(arg.numbers(key, values, _SHAPES[key]))
    if answer.keys() & _PAIRED:
        arg.check_pairs(**answer)
    if "confidence" in answer and answer["confidence"].shape != answer["depth"].shape:
        raise PredictionError("confidence has another shape than depth")
    if "rotation" in answer:
        Poses.from_centres(answer["rotation"][None], answer["centre"][None], ["rotation"])
    return answer


def _padded_lists(answers: list[Answer], depth: int) -> Answer:
    """Return ranked lists of one length: shorter ones are filled up with empty ids."""
    shape = len(answers), max(depth, *(len(one["ranked_ids"]) for one in answers))
    ids, scores = np.full(shape, "", dtype=object), np.zeros(shape)
    for row, one in enumerate(answers):
        count = len(one["ranked_ids"])
        ids[row, :count] = one["ranked_ids"]
        if "scores" in one and count:
            scores[row, :count], scores[row, count:] = one["scores"], one["scores"][-1]
    arrays = {"ranked_ids": ids.astype(str)}
    return arrays | ({"scores": scores} if "scores" in answers[0] else {})


def _view_arrays(answers: list[Answer]) -> Answer:
    """Return the cameras of photos, with their depth maps."""
    fields = {key: np.stack([one[key] for one in answers]) for key in answers[0]}
    poses = Poses.from_centres(fields.pop("rotation"), fields.pop("centre"))
    arrays = {"extrinsics": np.concatenate([poses.rotation, poses.translation[..., None]], axis=2)}
    if "depth" in fields:
        fields["pixel_centres"] = np.array("half")
    if "confidence" in fields:
        fields["conf"] = fields.pop("confidence")
    return arrays | fields


def _joined(form: Iterable[str]) -> str:
    return " and ".join(sorted(form))


def _unknown(name: str, known: Iterable[str], what: str) -> PredictionError:
    """Return the error of an unknown id, with the id that is meant or the nearest ones."""
    ids, shown = [*known], str(name)[:80]
    path = PurePosixPath(shown)
    stem = str(path.with_suffix("")) if path.suffix.lower() in IMAGE_SUFFIXES else shown
    meant = [one for one in ids if stem and (one == stem or one.endswith(f"/{stem}"))]
    fix = repr(meant[0]) if len(meant) == 1 else None
    return PredictionError(
        f"{shown!r} is no {what}{'' if fix else nearest(shown, ids)}",
        expected=f"an id such as {next(iter(ids), 'scene/name')}",
        fix=fix,
    )
