"""Writing a prediction file an answer at a time."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api import arguments as arg
from airzoo_bench.api.benchmark import BlindBenchmark, load_benchmark
from airzoo_bench.benchmark.folder import data_here
from airzoo_bench.core.errors import PredictionError, UsageError, UserError, first_of
from airzoo_bench.core.files import (
    atomic_entries,
    check_output_file,
    check_output_folder,
    write_npz,
)
from airzoo_bench.evaluation.evaluate import check as find_errors
from airzoo_bench.evaluation.queries import check_npz, write_predictions
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.protocol.model import find_protocol

__all__ = ["PredictionWriter"]

Answer = dict[str, NDArray[Any]]

# Of each kind of answer: its track, what its id is of, its fields, and those that it may have too.
_KINDS = (
    ("retrieval", "query", "ranked_ids", "scores"),
    ("retrieval", "query or tile", "descriptor", ""),
    ("matching", "query", "query_xy map_xy", ""),
    ("matching", "query", "query_xy points3d", ""),
    ("matching", "query", "rotation centre", ""),
    ("reconstruction", "scene", "points", "colours"),
    ("reconstruction", "photo", "rotation centre", "depth intrinsics confidence"),
)
_SHAPES: dict[str, tuple[int | None, ...]] = {
    **dict.fromkeys(("scores", "descriptor"), (None,)),
    **dict.fromkeys(("query_xy", "map_xy"), (None, 2)),
    **dict.fromkeys(("points3d", "points", "colours"), (None, 3)),
    **dict.fromkeys(("depth", "confidence"), (None, None)),
    **dict.fromkeys(("rotation", "intrinsics"), (3, 3)),
    "centre": (3,),
}
_STACKED = ("descriptor", "depth", "confidence")  # of one shape in all answers


class PredictionWriter:
    """Collects a method's answers and writes the prediction file that ``eval`` reads.

    When the ``with`` block ends, the file appears, whole, and is checked as ``airzoo-bench check``
    does; after an exception or Ctrl-C, an earlier file stays. A query without an answer scores as
    a failure.

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
        Protocol and benchmark are not there or do not belong together, or nothing can be written.

    Examples
    --------
    >>> with PredictionWriter("mine.npz", "airzoo-mini-retrieval") as writer:
    ...     writer.add("city/0001", ranked_ids=["city/160_00000_00000"])  # doctest: +SKIP
    """

    def __init__(
        self, path: str | Path, protocol: str, benchmark: BlindBenchmark | None = None
    ) -> None:
        self._path, self._closed = Path(path), False
        chosen: Any = find_protocol(protocol, benchmark.folder if benchmark else data_here())
        self._protocol, self._track = chosen, chosen.track
        opened = benchmark or load_benchmark(chosen.benchmark)
        self._data = opened.folder
        opened._source.check_fits(chosen)
        if self._track == "reconstruction":
            check_output_folder(self._path, ("protocol.txt",))
        else:
            check_npz(self._path)
            check_output_file(self._path)
        scenes = [opened.scene(scene.id) for scene in chosen.scenes]
        self._photos = {scene.id: scene.photos_of(self._track) for scene in scenes}
        photos = [photo.id for some in self._photos.values() for photo in some]
        self._ids = {"query": photos, "photo": photos, "scene": [*self._photos]}
        if self._track == "retrieval":
            self._ids["tile"] = [tile.id for scene in scenes for tile in scene.tiles()]
        self._known = {kind: {*ids} for kind, ids in self._ids.items()}
        self._answers: dict[str, Answer] = {}
        self._forms: dict[str, dict[str, object]] = {}  # of each group of like answers

    def add(self, name: str, **fields: ArrayLike | None) -> None:
        """Add the answer to one query, or the description of one tile, photo or scene, by its id.

        A file has one kind of answer, with the same fields in all; in reconstruction each scene.

        Fields are those of the prediction files: ``ranked_ids`` (K,), best first, with ``scores``
        (K,), or ``descriptor`` (D,); ``query_xy`` (M, 2), pixels of the full photo from its corner,
        with ``map_xy`` (M, 2), pixels of the whole map, or ``points3d`` (M, 3); ``rotation``
        (3, 3), world-to-camera, x right, y down, z forward, and ``centre`` (3,) in the scene's CRS
        or the frame of the cloud; ``points`` (M, 3) with ``colours`` (M, 3) uint8; ``depth`` (H, W)
        along z, with ``intrinsics`` (3, 3) at its size and ``confidence`` (H, W), larger is surer.

        Raises a `UserError` for an unknown or repeated id, or fields that do not belong together.
        """
        try:
            if self._closed:
                raise UsageError("the file is closed", fix="add all answers in the with block")
            answer = self._checked(name, {n: one for n, one in fields.items() if one is not None})
        except UserError as error:
            raise error.inside(f"{self._path}, {str(name)[:80]}") from error
        self._answers[name] = answer

    def close(self) -> None:
        """Write the file and check it, as a ``with`` block does at its end.

        Raises a `UserError` where there is no answer, or the file cannot be written or scored.
        """
        if self._closed:
            return
        self._closed = True
        if not self._answers.keys() - self._known.get("tile", set()):
            raise PredictionError("no answer was added", where=self._path)
        if self._track == "reconstruction":
            self._write_scenes()
        else:
            write_predictions(self._path, self._protocol.name, self._query_arrays())
        found = find_errors(self._path, data=self._data, protocol=self._protocol.name)
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

    def _check_id(self, name: str, kinds: str) -> None:
        if not any(name in self._known[kind] for kind in kinds.split(" or ")):
            example = self._ids[kinds.split(" or ")[0]][0]
            what = f"{str(name)[:80]!r} is no {kinds} of the benchmark"
            raise PredictionError(what, expected=f"an id such as {example}")

    def _checked(self, name: str, fields: dict[str, Any]) -> Answer:
        """Return an answer as arrays that fit each other and those that were added before."""
        known = [one for track, *one in _KINDS if track == self._track]
        fitting = [
            (kinds, needed)
            for kinds, needed, optional in known
            if {*needed.split()} <= fields.keys() <= {*needed.split(), *optional.split()}
        ]
        if not fitting:
            what = f"{' '.join(fields) or 'nothing'} is no answer of the {self._track} track"
            forms = [f"{needed} ({optional})" for _, needed, optional in known]
            raise PredictionError(what, expected="; or ".join(forms))
        [(kinds, needed)] = fitting
        self._check_id(name, kinds)
        if name in self._answers:
            raise PredictionError("was added before", expected="each id once")
        answer: Answer = {}
        for key, values in fields.items():
            if key == "ranked_ids":
                answer[key] = np.array([*map(str, arg.listed(key, values))], str)
                for tile in answer[key].tolist():
                    self._check_id(tile, "tile")
            else:
                answer[key] = arg.numbers(key, values, _SHAPES[key]).copy()
        if needed != "rotation centre":
            arg.check_pairs(**fields)
        # All answers are alike, in reconstruction those of a scene's photos.
        group = {"scene": name, "photo": f"photos of {name.partition('/')[0]}"}.get(kinds, "all")
        form: dict[str, object] = {
            key: (one.shape, one.dtype) if key in _STACKED else None for key, one in answer.items()
        }
        if (first := self._forms.setdefault(group, form)) != form:
            what = f"other fields than {' and '.join(first)}, or one of another type or shape"
            raise PredictionError(what, expected=f"{group}: all answers alike")
        return answer

    def _query_arrays(self) -> Answer:
        """Return the arrays of a file of queries, in the order of the benchmark."""
        names = [name for name in self._ids["query"] if name in self._answers]
        answers = [self._answers[name] for name in names]
        form = answers[0].keys()
        if "descriptor" in form:
            arrays = self._descriptors(answers)
        elif "ranked_ids" in form:
            arrays = _padded_lists(answers, self._protocol.scores.tie_ranks)
        elif "query_xy" in form:
            arrays = {key: np.concatenate([one[key] for one in answers]) for key in form}
            counts = [0, *(len(one["query_xy"]) for one in answers)]
            arrays["offsets"] = np.cumsum(counts, dtype=np.int64)
        else:
            arrays = {f"{key}s": np.stack([one[key] for one in answers]) for key in form}
        return {"query_ids": np.array(names, dtype=str), **arrays}

    def _descriptors(self, answers: list[Answer]) -> Answer:
        tiles = self._ids["tile"]
        if lacking := [name for name in tiles if name not in self._answers]:
            what = f"no descriptor of tiles: {first_of(lacking, len(tiles))}"
            raise PredictionError(what, where=self._path, expected="every tile of the gallery")
        return {
            "query_descriptors": np.stack([one["descriptor"] for one in answers]),
            "gallery_ids": np.array(tiles, dtype=str),
            "gallery_descriptors": np.stack([self._answers[one]["descriptor"] for one in tiles]),
        }

    def _write_scenes(self) -> None:
        endings = (".ply", ".cameras.npz", ".npz")
        entries = [f"{scene}{ending}" for scene in self._photos for ending in endings]
        with atomic_entries(self._path, ("protocol.txt", *entries)) as folder:
            for scene, photos in self._photos.items():
                if cloud := self._answers.get(scene):
                    write_ply(folder / f"{scene}.ply", Cloud(**cloud))
                if done := [photo for photo in photos if photo.id in self._answers]:
                    arrays = _view_arrays([self._answers[photo.id] for photo in done])
                    names = np.array([photo.name for photo in done], dtype=str)
                    ending = ".npz" if "depth" in arrays else ".cameras.npz"
                    write_npz(folder / f"{scene}{ending}", {"image_names": names, **arrays})
            (folder / "protocol.txt").write_text(f"{self._protocol.name}\n", encoding="utf-8")


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
    poses = Poses(rotation=fields.pop("rotation"), centres=fields.pop("centre"))
    arrays = {"extrinsics": np.concatenate([poses.rotation, poses.translation[..., None]], axis=2)}
    if "depth" in fields:
        arrays["pixel_centres"] = np.array("half")
    names = {"confidence": "conf"}
    return arrays | {names.get(key, key): values for key, values in fields.items()}
