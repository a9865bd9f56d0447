"""Writing a prediction file an answer at a time."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api import arguments as arg
from airzoo_bench.api.benchmark import BlindBenchmark, BlindScene, load_benchmark
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
from airzoo_bench.evaluation.evaluate import check as find_errors
from airzoo_bench.evaluation.queries import check_npz, write_predictions
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.protocol.lookup import find_protocol

__all__ = ["PredictionWriter"]

Array = NDArray[Any]

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


class PredictionWriter:
    """Collects a method's answers and writes the prediction file that ``eval`` reads.

    Ids, fields and shapes are checked when an answer is added. When the ``with`` block ends, the
    file appears, whole, and is checked as ``airzoo-bench check`` does. After an exception or
    Ctrl-C, an earlier file stays as it was. Answers are kept in memory until then and may come in
    any order: the file is the same. A query without an answer scores as a failure.

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
        self._path = Path(path)
        self._protocol: Any = find_protocol(
            protocol, benchmark.folder if benchmark else data_here()
        )
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
        self._scenes = self._benchmark._scenes_of(self._protocol)
        self._ids = self._known_ids()
        self._answers: dict[str, dict[str, Array]] = {}
        self._forms: dict[str, set[str]] = {}
        self._first: dict[str, Array] = {}
        self._closed = False
        self._stack = ExitStack()
        self._hold()
        parent = self._path.absolute().parent
        self._folder = self._stack.enter_context(temporary_folder(parent, self._path.name))

    def _known_ids(self) -> dict[str, dict[str, int]]:
        """Return the ids that may be answered, with their rows, in groups."""
        scenes = self._scenes
        if self._track == "matching":
            return {"query": _numbered(crop.query.id for s in scenes for crop in s.crops())}
        if self._track == "retrieval":
            return {
                "query": _numbered(query.id for s in scenes for query in s.queries()),
                "tile": _numbered(tile.id for s in scenes for tile in s.tiles()),
            }
        photos = {f"photo of {s.id}": _numbered(one.id for one in s.photos()) for s in scenes}
        return {"scene": _numbered(s.id for s in scenes), **photos}

    def add(self, name: str, **fields: ArrayLike | None) -> None:
        """Add the answer to one query, or the description of one tile, photo or scene.

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

        A file has one kind of answer, with the same fields in all; of reconstruction each scene.

        Parameters
        ----------
        name : str
            The id, ``scene/name``; of a scene its own. Each once.
        **fields : array-like
            ``ranked_ids`` (K,): tiles of the query's scene, best first; may be empty. ``scores``
            (K,): similarities, which fall along the list, or distances, which rise.
            ``descriptor`` (D,): compared by the protocol's metric; every tile of every scene needs
            one. ``query_xy`` (M, 2): pixels of the photo at its full size, its corner being (0,
            0). ``map_xy`` (M, 2): pixels of the whole map, such as `Crop.to_map` returns;
            ``points3d`` (M, 3): instead, points in the scene's CRS, in metres. ``rotation`` (3,
            3): world-to-camera, x right, y down, z forward. ``centre`` (3,): the camera's centre,
            in the scene's CRS or for reconstruction in the frame of the cloud. ``points`` (M, 3)
            and ``colours`` (M, 3) uint8: the cloud of a scene. ``depth`` (H, W): along the
            camera's z axis, 0 and NaN are no surface; of one size in all photos of a scene.
            ``intrinsics`` (3, 3): K at the size of the depth map, such as
            ``photo.camera.scaled(W, H).K``. ``confidence`` (H, W): larger is surer.

        Raises
        ------
        UserError
            The id is none of the benchmark's or was added before; fields are missing, do not
            belong together, or have a wrong shape. Nothing of it is kept.
        """
        given = {key: value for key, value in fields.items() if value is not None}
        try:
            if self._closed:
                raise UsageError("the file is closed", fix="add all answers in the with block")
            group = self._checked_group(name, given.keys())
            answer = _arrays(given)
            for tile in answer.get("ranked_ids", ()):
                if tile not in self._ids["tile"]:
                    raise _unknown(tile, self._ids["tile"], "tile of the gallery")
            if "rotation" in answer:
                rotation, centre = answer["rotation"][None], answer["centre"][None]
                Poses.from_centres(rotation, centre, [name])
            self._check_alike(group, answer)
            if "points" in answer:
                cloud = Cloud(answer.pop("points"), answer.pop("colours", None))
                write_ply(self._folder / f"{name}.ply", cloud)
        except UserError as error:
            raise error.inside(f"{self._path}, {str(name)[:80]}") from error
        self._answers[name] = answer
        self._forms[self._kind(group)] = {*given}

    def __len__(self) -> int:
        """Return the number of answers."""
        return len(self._answers)

    def missing(self) -> tuple[str, ...]:
        """Return the ids that have no answer: of queries (and tiles) or scenes.

        Returns
        -------
        tuple of str
            In the order of the benchmark.
        """
        if self._track == "reconstruction":
            with_depth = {group[9:] for group, form in self._forms.items() if "depth" in form}
            return tuple(
                one for one in self._ids["scene"] if one not in {*self._answers, *with_depth}
            )
        names = [*self._ids["query"]]
        if any("descriptor" in form for form in self._forms.values()):
            names += self._ids["tile"]
        return tuple(name for name in names if name not in self._answers)

    def close(self) -> None:
        """Write the file and check it, as a ``with`` block does at its end.

        Raises
        ------
        UserError
            There is no answer, the file cannot be written, or it was written and ``eval`` would
            refuse it.
        """
        if self._closed:
            return
        self._closed = True
        with self._stack:
            if not self._answers:
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

    def _kind(self, group: str) -> str:
        """Return what has one kind of answer: a whole file, or the photos of a scene."""
        return group if self._track == "reconstruction" else "all answers"

    def _checked_group(self, name: str, keys: Iterable[str]) -> str:
        """Return the group of an id, and refuse ids and fields that do not fit together."""
        form, forms = {*keys}, _FORMS[self._track]
        if form not in forms:
            what = f"{' and '.join(keys) or 'nothing'} is no answer of the {self._track} track"
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
        before = self._forms.get(self._kind(group), form)
        if before != form:
            what = f"{_joined(form)} after answers of another kind"
            raise PredictionError(what, expected=f"{_joined(before)} in {self._kind(group)}")
        scene = name.partition("/")[0]
        depth = form if "depth" in form else self._forms.get(f"photo of {scene}", ())
        if "depth" in depth and (group == "scene" or scene in self._answers):
            expected = "one of the two, the cloud with cameras"
            raise PredictionError("a cloud and depth maps in one scene", expected=expected)
        return group

    def _check_alike(self, group: str, answer: dict[str, Array]) -> None:
        """Refuse rows of another shape or type than the first, which could not be one array."""
        for key in {"descriptor", "depth", "confidence"} & {*answer}:
            row, place = answer[key], key if key == "descriptor" else f"{key} of {group}"
            first = self._first.get(place, row)
            if row.dtype.kind != "f" or row.shape != first.shape or row.dtype != first.dtype:
                what = f"{key} is {row.dtype} of shape {row.shape}"
                expected = f"{first.dtype} of shape {first.shape}, as the first"
                raise PredictionError(what, expected=expected)
            self._first[place] = first

    def _query_arrays(self) -> dict[str, Array]:
        """Return the arrays of a file of queries, in the order of the benchmark."""
        names = [name for name in self._ids["query"] if name in self._answers]
        answers, form = [self._answers[name] for name in names], self._forms["all answers"]
        if not names:
            raise PredictionError("no query has an answer", where=self._path)
        if "descriptor" in form:
            arrays = self._descriptors()
        elif "rotation" in form:
            arrays = {
                "rotations": np.stack([answer["rotation"] for answer in answers]),
                "centres": np.stack([answer["centre"] for answer in answers]),
            }
        elif "query_xy" in form:
            counts = [0, *(len(answer["query_xy"]) for answer in answers)]
            arrays = {key: np.concatenate([one[key] for one in answers]) for key in form}
            arrays["offsets"] = np.cumsum(counts, dtype=np.int64)
        else:
            arrays = self._lists(answers)
        return {"query_ids": np.array(names, dtype=str), **arrays}

    def _lists(self, answers: list[dict[str, Array]]) -> dict[str, Array]:
        """Return ranked lists of one length: shorter ones are filled up with empty ids."""
        shape = (
            len(answers),
            max(self._protocol.scores.depth, *(len(one["ranked_ids"]) for one in answers)),
        )
        ids, scores = np.full(shape, "", dtype=object), np.zeros(shape)
        for row, one in enumerate(answers):
            count = len(one["ranked_ids"])
            ids[row, :count] = one["ranked_ids"]
            if "scores" in one and count:
                scores[row, :count], scores[row, count:] = one["scores"], one["scores"][-1]
        arrays = {"ranked_ids": ids.astype(str)}
        return arrays | ({"scores": scores} if "scores" in answers[0] else {})

    def _descriptors(self) -> dict[str, Array]:
        lacking = [name for name in self._ids["tile"] if name not in self._answers]
        if lacking:
            raise PredictionError(
                f"no descriptor of tiles: {first_of(lacking, len(self._ids['tile']))}",
                where=self._path,
                expected="every tile of the gallery: leaving some out would make the task easier",
                fix="add the descriptor of each tile of scene.tiles(), in every scene",
            )
        queries = [name for name in self._ids["query"] if name in self._answers]
        described = [
            [self._answers[name].pop("descriptor") for name in part]
            for part in (queries, self._ids["tile"])
        ]
        return {
            "query_descriptors": np.stack(described[0]),
            "gallery_ids": np.array([*self._ids["tile"]], dtype=str),
            "gallery_descriptors": np.stack(described[1]),
        }

    def _write_scenes(self) -> None:
        entries = [f"{scene.id}{ending}" for scene in self._scenes for ending in _SCENE_FILES]
        with atomic_entries(self._path, ("protocol.txt", *entries)) as folder:
            for scene in self._scenes:
                if scene.id in self._answers:
                    shutil.move(self._folder / f"{scene.id}.ply", folder / f"{scene.id}.ply")
                arrays = self._scene_arrays(scene)
                if arrays:
                    ending = ".npz" if "depth" in arrays else ".cameras.npz"
                    write_npz(folder / f"{scene.id}{ending}", arrays)
            (folder / "protocol.txt").write_text(f"{self._protocol.name}\n", encoding="utf-8")

    def _scene_arrays(self, scene: BlindScene) -> dict[str, Array]:
        """Return the cameras of a scene's photos, with their depth maps."""
        photos = [photo for photo in scene.photos() if photo.id in self._answers]
        if not photos:
            return {}
        answers = [self._answers[photo.id] for photo in photos]
        fields = {key: np.stack([one[key] for one in answers]) for key in answers[0]}
        poses = Poses.from_centres(fields["rotation"], fields["centre"])
        arrays: dict[str, Array] = {
            "image_names": np.array([photo.name for photo in photos], dtype=str),
            "extrinsics": np.concatenate([poses.rotation, poses.translation[..., None]], axis=2),
        }
        if "depth" in fields:
            arrays["pixel_centres"] = np.array("half")
        names = {"intrinsics": "intrinsics", "depth": "depth", "confidence": "conf"}
        return arrays | {names[key]: fields[key] for key in names if key in fields}

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


def _numbered(ids: Iterable[str]) -> dict[str, int]:
    return {one: row for row, one in enumerate(ids)}


def _joined(form: set[str]) -> str:
    return " and ".join(sorted(form))


def _arrays(fields: dict[str, Any]) -> dict[str, Array]:
    """Return the fields of an answer as arrays of the right shapes."""
    arg.same_index(**fields)
    answer: dict[str, Array] = {}
    for key, values in fields.items():
        if key == "ranked_ids":
            answer[key] = np.array([*map(str, arg.listed(key, values))], dtype=str)
        elif key in _COORDINATES:
            answer[key] = arg.coordinates(key, values, _SHAPES[key], any_history=True)
        else:
            answer[key] = np.array(arg.numbers(key, values, _SHAPES[key]))
    pairs = {"query_xy", "map_xy", "points3d", "ranked_ids", "scores", "points", "colours"}
    lengths = {key: len(value) for key, value in answer.items() if key in pairs}
    if len({*lengths.values()}) > 1:
        found = ", ".join(f"{key} has {count:,} rows" for key, count in lengths.items())
        raise PredictionError(found, expected="the same number in all")
    if (
        "depth" in answer
        and answer.get("confidence", answer["depth"]).shape != answer["depth"].shape
    ):
        raise PredictionError("confidence has another shape than depth")
    return answer


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
