"""Writing a prediction file an answer at a time."""

from __future__ import annotations

from collections.abc import Iterable
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
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.evaluate import check as find_errors
from airzoo_bench.evaluation.queries import check_npz, write_predictions
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.protocol.model import find_protocol

__all__ = ["PredictionWriter"]

Answer = dict[str, NDArray[Any]]

# Of each kind of answer: its track, what its id is of, and its fields.
_FORMS = (
    ("retrieval", "query", {"ranked_ids"}),
    ("retrieval", "query", {"ranked_ids", "scores"}),
    ("retrieval", "query or tile", {"descriptor"}),
    ("matching", "query", {"query_xy", "map_xy"}),
    ("matching", "query", {"query_xy", "points3d"}),
    ("matching", "query", {"rotation", "centre"}),
    ("reconstruction", "scene", {"points"}),
    ("reconstruction", "scene", {"points", "colours"}),
    ("reconstruction", "photo", {"rotation", "centre"}),
    ("reconstruction", "photo", {"rotation", "centre", "depth", "intrinsics"}),
    ("reconstruction", "photo", {"rotation", "centre", "depth", "intrinsics", "confidence"}),
)
_SHAPES: dict[str, tuple[int | None, ...]] = {
    **dict.fromkeys(("scores", "descriptor"), (None,)),
    **dict.fromkeys(("query_xy", "map_xy"), (None, 2)),
    **dict.fromkeys(("points3d", "points", "colours"), (None, 3)),
    **dict.fromkeys(("depth", "confidence"), (None, None)),
    **dict.fromkeys(("rotation", "intrinsics"), (3, 3)),
    "centre": (3,),
}
# Fields whose rows become one array, and fields whose rows belong to those of another field.
_STACKED, _PAIRED = ("descriptor", "depth", "confidence"), {"query_xy", "ranked_ids", "points"}


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
        self._path = Path(path)
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
        self._photos = {one.id: one.photos() for one in scenes if self._track == "reconstruction"}
        ids = {"scene": self._photos, "photo": _ids(self._photos.values())}
        if self._track == "matching":
            ids["query"] = _ids(scene.crops() for scene in scenes)
        elif self._track == "retrieval":
            ids["query"] = _ids(scene.queries() for scene in scenes)
            ids["tile"] = _ids(scene.tiles() for scene in scenes)
        self._ids = {kind: dict.fromkeys(some) for kind, some in ids.items()}
        self._answers: dict[str, Answer] = {}
        self._firsts: dict[str, Answer] = {}  # of each group that has one kind of answer
        self._closed = False

    def add(self, name: str, **fields: ArrayLike | None) -> None:
        """Add the answer to one query, or the description of one tile, photo or scene.

        A file has one kind of answer, with the same fields in all; in reconstruction each scene.

        Parameters
        ----------
        name : str
            The id of a query, tile or photo, ``scene/name``, or of a scene. Each once.
        **fields : array-like
            Retrieval, a query: ``ranked_ids`` (K,), tiles of its scene, best first; perhaps
            ``scores`` (K,), similarities, which fall along the list, or distances, which rise.
            Or, a query or a tile: ``descriptor`` (D,), which every tile of every scene needs.

            Matching, a query: ``query_xy`` (M, 2), pixels of the photo at its full size, from its
            corner, with ``map_xy`` (M, 2), pixels of the whole map (`Crop.to_map`), or
            ``points3d`` (M, 3), metres in the scene's CRS. Or ``rotation`` (3, 3),
            world-to-camera, x right, y down, z forward, and ``centre`` (3,) in the scene's CRS.

            Reconstruction, a scene: ``points`` (M, 3), perhaps ``colours`` (M, 3) uint8. A photo:
            ``rotation`` and ``centre``, in the frame of the cloud; with ``depth`` (H, W), along the
            camera's z axis, 0 and NaN are no surface, and ``intrinsics`` (3, 3), K at its size;
            perhaps ``confidence`` (H, W), larger is surer.

        Raises
        ------
        UserError
            An unknown id, or one that was added before; fields that do not belong together.
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
        if not self._answers.keys() - self._ids.get("tile", {}).keys():
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

    def __repr__(self) -> str:
        return f"PredictionWriter({str(self._path)!r}): {len(self._answers)} added"

    def _check_id(self, name: str, kinds: str) -> None:
        if not any(name in self._ids[kind] for kind in kinds.split(" or ")):
            known = [one for kind in kinds.split(" or ") for one in self._ids[kind]]
            what = f"{str(name)[:80]!r} is no {kinds} of the benchmark{nearest(str(name), known)}"
            raise PredictionError(what, expected=f"an id such as {known[0]}")

    def _checked(self, name: str, fields: dict[str, Any]) -> Answer:
        """Return an answer as arrays that fit each other and those that were added before."""
        forms = [(kinds, form) for track, kinds, form in _FORMS if track == self._track]
        kinds = next((kinds for kinds, form in forms if form == {*fields}), None)
        if kinds is None:
            what = f"{_joined(fields) or 'nothing'} is no answer of the {self._track} track"
            raise PredictionError(what, expected="; or ".join(_joined(form) for _, form in forms))
        self._check_id(name, kinds)
        if name in self._answers:
            raise PredictionError("was added before", expected="each id once")
        answer: Answer = {}
        if "ranked_ids" in fields:
            answer["ranked_ids"] = np.array(
                [*map(str, arg.listed("ranked_ids", fields["ranked_ids"]))], str
            )
            for tile in answer["ranked_ids"].tolist():
                self._check_id(tile, "tile")
        for key in fields.keys() - answer.keys():
            answer[key] = arg.numbers(key, fields[key], _SHAPES[key]).copy()
        if _PAIRED & fields.keys():
            arg.check_pairs(**fields)
        # All answers are alike, in reconstruction those of a scene's photos.
        group = {"scene": name, "photo": f"photos of {name.partition('/')[0]}"}.get(kinds, "all")
        first = self._firsts.setdefault(group, answer)
        stacked = [key for key in _STACKED if key in first]
        for key in stacked if first.keys() == answer.keys() else first.keys() | answer.keys():
            one, row = first.get(key), answer.get(key)
            if one is None or row is None or (one.shape, one.dtype) != (row.shape, row.dtype):
                what = "answers of another kind, or a field of another type or shape"
                raise PredictionError(what, where=key, expected=f"{group}: {_joined(first)} alike")
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
        tiles = [*self._ids["tile"]]
        if lacking := [name for name in tiles if name not in self._answers]:
            raise PredictionError(
                f"no descriptor of tiles: {first_of(lacking, len(tiles))}",
                where=self._path,
                expected="every tile of the gallery: leaving some out would make the task easier",
            )
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


def _ids(groups: Iterable[Iterable[Any]]) -> list[str]:
    return [one.id for group in groups for one in group]


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


def _joined(form: Iterable[str]) -> str:
    return " and ".join(sorted(form))
