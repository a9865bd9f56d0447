"""Writing a prediction file an answer at a time."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api import arguments as arg
from airzoo_bench.api.benchmark import BlindBenchmark, load_benchmark
from airzoo_bench.benchmark.folder import data_here
from airzoo_bench.core import files
from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.evaluation.evaluate import check as find_errors
from airzoo_bench.evaluation.predictions import check_npz, write_predictions
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.protocol.model import find_protocol

Answer = dict[str, NDArray[Any]]

# Of each kind of answer: its track, the kinds of its id, its fields, and those that it may have.
_KINDS: tuple[tuple[str, tuple[str, ...], str, str], ...] = (
    ("retrieval", ("query",), "ranked_ids", "scores"),
    ("retrieval", ("query", "tile"), "descriptor", ""),
    ("matching", ("query",), "query_xy map_xy", ""),
    ("matching", ("query",), "query_xy points3d", ""),
    ("matching", ("query",), "rotation centre", ""),
    ("reconstruction", ("scene",), "points", "colours"),
    ("reconstruction", ("photo",), "rotation centre", "depth intrinsics confidence"),
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
    a failure. Raises a `UserError` where protocol and benchmark are not there or do not belong
    together, or nothing can be written.

    Parameters
    ----------
    path : str or Path
        An ``.npz``; for reconstruction a folder.
    protocol : str
        Name or path, such as ``airzoo-mini-retrieval``.
    benchmark : BlindBenchmark, optional
        As `load_benchmark` returns it; by default the protocol's, from the data root.
    """

    _closed = False

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
            files.check_output_folder(self._path, ("protocol.txt",))
        else:
            check_npz(self._path)
            files.check_output_file(self._path)
        scenes = [opened.scene(scene.id) for scene in chosen.scenes]
        self._photos = {scene.id: scene.photos(self._track) for scene in scenes}
        photos = [photo.id for some in self._photos.values() for photo in some]
        tiles = self._track == "retrieval" and [t.id for scene in scenes for t in scene.tiles()]
        ids = {"query": photos, "photo": photos, "scene": self._photos, "tile": tiles or ()}
        self._ids = {kind: dict.fromkeys(names) for kind, names in ids.items()}  # ordered sets
        self._answers: dict[str, Answer] = {}
        self._forms: dict[str, Any] = {}  # fields and shapes that all answers of a group share

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
        given = {key: values for key, values in fields.items() if values is not None}
        try:
            answer = self._read_answer(name, given)
        except UserError as error:
            raise error.inside(f"{self._path}, {str(name)[:80]}") from error
        self._answers[name] = answer

    def _read_answer(self, name: str, fields: dict[str, Any]) -> Answer:
        """Return an answer as arrays that fit each other and those that were added before."""
        known = [(ids, one, more) for track, ids, one, more in _KINDS if track == self._track]
        fitting = [
            (kinds, needed)
            for kinds, needed, optional in known
            if {*needed.split()} <= fields.keys() <= {*needed.split(), *optional.split()}
        ]
        if not fitting:
            forms = "; or ".join(f"{needed} ({optional})" for _, needed, optional in known)
            what = f"{' '.join(fields) or 'nothing'} is no answer of the {self._track} track"
            raise PredictionError(what, expected=forms)
        [(kinds, needed)] = fitting
        self._check_id(name, *kinds)
        if name in self._answers or self._closed:
            what = "was added before, or after the file was written"
            raise PredictionError(what, expected="each id once")
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
        group = {"scene": name, "photo": name.partition("/")[0] + "/"}.get(kinds[0], "")
        form = {key: one.shape if key in _STACKED else "any" for key, one in answer.items()}
        if (first := self._forms.setdefault(group, form)) != form:
            raise PredictionError("is not like answers before it", expected=f"shapes {first}")
        return answer

    def _check_id(self, name: str, *kinds: str) -> None:
        if not any(name in self._ids[kind] for kind in kinds):
            what = f"{str(name)[:80]!r} is no {' or '.join(kinds)} of the benchmark"
            raise PredictionError(what, expected=f"an id such as {next(iter(self._ids[kinds[0]]))}")

    def close(self) -> None:
        """Write the file and check it, as a ``with`` block does at its end.

        Raises a `UserError` where there is no answer, or the file cannot be written or scored.
        """
        if not self._answers.keys() - self._ids["tile"]:
            raise PredictionError("no answer was added", where=self._path)
        if self._track == "reconstruction":
            self._write_scenes()
        else:
            write_predictions(self._path, self._protocol.name, self._query_arrays())
        self._closed = True
        found = find_errors(self._path, data=self._data, protocol=self._protocol.name)
        if found.errors:
            raise found.errors[0]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        if kind is None:
            self.close()

    def _query_arrays(self) -> Answer:
        """Return the arrays of a file of queries, in the order of the benchmark."""
        names = [name for name in self._ids["query"] if name in self._answers]
        answers = [self._answers[name] for name in names]
        columns = {key: [one[key] for one in answers] for key in answers[0]}
        if "descriptor" in columns:
            tiles = [name for name in self._ids["tile"] if name in self._answers]
            described = [self._answers[name]["descriptor"] for name in tiles]
            arrays = {"query_descriptors": np.stack(columns["descriptor"])}
            arrays["gallery_descriptors"] = np.array(described)
            arrays["gallery_ids"] = np.array(tiles, dtype=str)
        elif "ranked_ids" in columns:
            width = max(*self._protocol.scores.recall_at, *map(len, columns["ranked_ids"]))
            fills: dict[str, Any] = {"ranked_ids": "", "scores": 0.0}
            arrays = {
                key: np.array([[*row.tolist(), *[fills[key]] * (width - len(row))] for row in rows])
                for key, rows in columns.items()
            }
        elif "query_xy" in columns:
            arrays = {key: np.concatenate(rows) for key, rows in columns.items()}
            arrays["offsets"] = np.cumsum([0, *map(len, columns["query_xy"])], dtype=np.int64)
        else:
            arrays = {f"{key}s": np.stack(rows) for key, rows in columns.items()}
        return {"query_ids": np.array(names, dtype=str), **arrays}

    def _write_scenes(self) -> None:
        endings = (".ply", ".cameras.npz", ".npz")
        entries = [f"{scene}{ending}" for scene in self._photos for ending in endings]
        with files.atomic_entries(self._path, ("protocol.txt", *entries)) as folder:
            for scene, photos in self._photos.items():
                if cloud := self._answers.get(scene):
                    write_ply(folder / f"{scene}.ply", Cloud(**cloud))
                if done := [photo for photo in photos if photo.id in self._answers]:
                    answers = [self._answers[photo.id] for photo in done]
                    arrays = {key: np.stack([one[key] for one in answers]) for key in answers[0]}
                    poses = Poses(rotation=arrays.pop("rotation"), centres=arrays.pop("centre"))
                    matrices = [poses.rotation, poses.translation[..., None]]
                    arrays["extrinsics"] = np.concatenate(matrices, axis=2)
                    if "confidence" in arrays:
                        arrays["conf"] = arrays.pop("confidence")
                    if "depth" in arrays:
                        arrays["pixel_centres"] = np.array("half")
                    arrays["image_names"] = np.array([photo.name for photo in done], dtype=str)
                    ending = ".npz" if "depth" in arrays else ".cameras.npz"
                    files.write_npz(folder / f"{scene}{ending}", arrays)
            (folder / "protocol.txt").write_text(f"{self._protocol.name}\n", encoding="utf-8")
