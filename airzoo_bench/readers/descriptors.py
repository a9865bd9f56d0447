"""Descriptors with names: the shared code of such readers, and the methods."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.files import npz_fields
from airzoo_bench.evaluation.predictions import (
    PredictionFile,
    QueryPredictions,
    Reader,
    ReadRequest,
)
from airzoo_bench.formats.arrays import as_floating, check_fields, gather, temporary_array, texts
from airzoo_bench.formats.foreign_arrays import Hdf5File, dataset_names, mat_names, read_mat
from airzoo_bench.formats.npz import NpzFile, map_numbers
from airzoo_bench.formats.photos import PHOTO_SUFFIXES
from airzoo_bench.readers.names import ImageNames, folders_of, names_in, query_names, scene_finder
from airzoo_bench.retrieval.predictions import Descriptors, RetrievalPredictions
from airzoo_bench.retrieval.truth import RetrievalTruth

_RECIPE = "what the lines of docs/recipes/retrieval.md save"

Described = tuple[Sequence[str], NDArray[Any]]
Opened = tuple[Sequence[str], Callable[[int], NDArray[Any]]]


@dataclass(frozen=True, eq=False)
class SceneImages:
    """The photos and tiles of a protocol's scenes by name; names without a scene mean `home`."""

    request: ReadRequest
    home: str

    @cached_property
    def queries(self) -> ImageNames:
        """The photos that are queries."""
        return query_names(self.request, self.home)

    @cached_property
    def tiles(self) -> ImageNames:
        """The galleries."""
        tiles = chain.from_iterable(map(tile_images, self.request.truths))
        return ImageNames("tile", tiles, scenes=self.request.scenes, home=self.home)

    def at_run(self, folders: Iterable[str]) -> SceneImages:
        """Take the scene that the folders of a run name, for names without one."""
        scene_of = scene_finder(truth.scene for truth in self.request.truths)
        named = {scene_of(folders_of(folder)) for folder in folders} - {None}
        return replace(self, home="".join(map(str, named)) if len(named) == 1 else "")


def tile_images(truth: RetrievalTruth) -> Iterator[tuple[str, str]]:
    """Yield ids of tiles with the names of their files, as `prepare --tiles files` writes them."""
    if truth.has_images:
        return names_in([truth.tiles])
    return ((one, f"{one.split('/', 1)[1]}.png") for one in truth.tiles["id"].tolist())


@dataclass(frozen=True, eq=False)
class NamedRows:
    """Descriptors (N, D) with N ids; `strange` are names of no image of the protocol."""

    ids: NDArray[np.str_]
    rows: NDArray[np.floating[Any]]
    strange: int = 0


def query_rows(given: Described, images: SceneImages, where: Path) -> NamedRows:
    """Keep the rows of queries; other photos may be described too, and are counted."""
    names, rows = given
    found = images.queries.find_all(names, where)
    kept = [row for row, one in enumerate(found) if one is not None]
    ids = np.array([found[row] for row in kept], dtype=str)
    return NamedRows(ids, rows if len(kept) == len(rows) else rows[kept], len(rows) - len(kept))


def gallery_rows(given: Described, images: SceneImages, where: Path) -> NamedRows:
    """Name the rows of a gallery, which may be mapped; a row of no tile keeps its own name."""
    names, rows = given
    found = images.tiles.find_all(names, where)
    ids = [one or f"row {row}/{names[row][-80:]!r}" for row, one in enumerate(found)]
    return NamedRows(np.array(ids, dtype=str), rows)


def note_strange(strange: int) -> tuple[str, ...]:
    """Say how many described photos are no queries, if any."""
    said = (f"{counted(strange, 'photo')} described that are no queries, left aside",)
    return said * (strange > 0)


def check_descriptors(path: Path, what: str, rows: NDArray[Any], names: int | None = None) -> None:
    """Refuse arrays that are no descriptors, or not one for each name."""
    fine = rows.ndim == 2 and rows.dtype.kind in "biuf" and rows.dtype.itemsize <= 8
    if not fine or not rows.size:
        what += f" has type {rows.dtype} and shape {rows.shape}"
        expected = "descriptors: numbers of at most 64 bits, a row an image"
        raise PredictionError(what, where=path, expected=expected)
    if names is not None and names != len(rows):
        what += f" has {counted(len(rows), 'row')}, and there are {counted(names, 'name')}"
        raise PredictionError(what, where=path, expected="a name for each row")


def join(
    path: Path, queries: Sequence[NamedRows], galleries: Sequence[NamedRows]
) -> RetrievalPredictions:
    """Make predictions of descriptors; the galleries of several files become one mapped file."""
    lengths = sorted({one.rows.shape[1] for one in (*queries, *galleries)})
    if len(lengths) > 1:
        what = f"descriptors of {' and '.join(map(str, lengths))} dimensions"
        fix = "describe photos and tiles of all scenes with one model"
        raise PredictionError(what, where=path, expected="as many in all files", fix=fix)
    asked = np.concatenate([one.ids for one in queries])
    parts = [as_floating(one.rows) for one in queries]
    rows = parts[0] if len(parts) == 1 else np.concatenate(parts)
    tiles = np.concatenate([one.ids for one in galleries])
    gallery = galleries[0].rows
    if len(galleries) > 1:
        kind = np.result_type(*(one.rows for one in galleries))
        gallery = temporary_array((len(tiles), gallery.shape[1]), kind)
        np.concatenate([one.rows for one in galleries], out=gallery)
    return QueryPredictions(path, None, asked, Descriptors(rows, tiles, gallery))


def describe_metric(request: ReadRequest) -> str:
    """Say how descriptors are compared."""
    metric = str(request.protocol.scores.descriptor_metric)
    return f"descriptors are compared by {metric.replace('_', ' ')}, as the protocol says"


# --- queries and tiles apart ---


class DescribedSets(Reader):
    """Reads descriptors and names of queries and of tiles."""

    track = "retrieval"

    @abstractmethod
    def described(self, path: Path, kind: str, memory: int) -> Described:
        """Return names and descriptors of "query" or "gallery"."""

    def read(self, path: Path, request: ReadRequest) -> PredictionFile:
        """See `Reader.read`."""
        images, given = SceneImages(request, str(path)), {}
        for kind in ("query", "gallery"):
            names, rows = given[kind] = self.described(path, kind, request.memory_bytes)
            check_descriptors(path, f"'{kind}' features", rows, len(names))
        queries = query_rows(given["query"], images, path)
        predictions = join(path, [queries], [gallery_rows(given["gallery"], images, path)])
        said = (*self.conventions, describe_metric(request))
        return PredictionFile(predictions, said, note_strange(queries.strange))


class _Game4Loc(DescribedSets):
    """Features and names that a user of Game4Loc saves: the method's evaluation saves nothing."""

    title = "features and names of images in one npz"
    layout = "npz with query_features, query_names, gallery_features, gallery_names"
    methods = ("Game4Loc",)
    fields = ("query_features", "query_names", "gallery_features", "gallery_names")

    def recognise(self, path: Path) -> float:
        return 0.95 * (npz_fields(path) >= {"query_features", "gallery_features"})

    def described(self, path: Path, kind: str, memory: int) -> Described:
        file = NpzFile(path, memory)
        check_fields(file, self.fields, self.fields, _RECIPE)
        rows = (file.read if kind == "query" else file.map)(f"{kind}_features")
        return texts(file, f"{kind}_names", 1).tolist(), rows


class _University1652(DescribedSets):
    """``pytorch_result.mat`` of University-1652 and those after it: features, classes and paths."""

    title = "features that test.py of University-1652 writes"
    layout = (
        "MATLAB 5 with gallery_f, gallery_label, gallery_path, query_f, query_label, query_path"
    )
    methods = ("University1652-Baseline", "LPN", "FSRA", "SUES-200", "DenseUAV")
    conventions = ("images are named by the ends of their paths: class folder, file",)

    def recognise(self, path: Path) -> float:
        try:
            return 0.95 * (mat_names(path) >= {"gallery_f", "query_f"})
        except (OSError, PredictionError):
            return 0.0

    def described(self, path: Path, kind: str, memory: int) -> Described:
        names = read_mat(path, f"{kind}_path", "U", memory).tolist()
        return names, read_mat(path, f"{kind}_f", "biuf", memory)


# --- queries and tiles together ---


class DescribedImages(Reader):
    """Reads descriptors by image, queries and tiles together: its name tells which one it is."""

    track = "retrieval"

    @abstractmethod
    def opened(self, path: Path, memory: int) -> Opened:
        """Return the names of images, and what reads the descriptor of one by its number."""

    def read(self, path: Path, request: ReadRequest) -> PredictionFile:
        """See `Reader.read`; descriptors are gathered in temporary files."""
        images = SceneImages(request, str(path))
        names, read = self.opened(path, request.memory_bytes)
        photos, tiles = (known.find_all(names, path) for known in (images.queries, images.tiles))
        both = [name for name, one, two in zip(names, photos, tiles, strict=True) if one and two]
        if both:
            what = f"could be a query or a tile: {first_of([repr(name[:200]) for name in both])}"
            fix = "keep the folders of queries and tiles in the names"
            raise PredictionError(what, where=path, fix=fix)
        queries, gallery = (_rows(path, names, found, read) for found in (photos, tiles))
        predictions = join(path, [queries], [gallery])
        stored = f"descriptors are {queries.rows.dtype}, as the file has them"
        said = (stored, *self.conventions, describe_metric(request))
        others = zip(names, photos, tiles, strict=True)
        left = [name[-80:] for name, one, two in others if one is two is None]
        asides = (f"images that are neither queries nor tiles, left aside: {first_of(left)}",)
        return PredictionFile(predictions, said, asides * bool(left))


def _rows(
    path: Path,
    names: Sequence[str],
    found: Sequence[str | None],
    read: Callable[[int], NDArray[Any]],
) -> NamedRows:
    """Read descriptors in the order of their ids, all of the first one's length and type."""
    ids = {one: number for number, one in enumerate(found) if one is not None}
    numbers = [ids[one] for one in sorted(ids)]
    places = [f"{path}, {names[number][:200]!r}" for number in numbers]
    rows = gather(places, lambda row: read(numbers[row]).reshape(-1))
    check_descriptors(path, "each", rows)
    return NamedRows(np.array(sorted(ids), dtype=str), rows)


class _AnyLoc(DescribedImages):
    title = "a folder of descriptors by image"
    layout = "files IMAGE.jpg.npy of shape (1, D), in one folder or several below it"
    methods = ("AnyLoc",)
    conventions = ("images are named by their files, without .npy",)

    def recognise(self, path: Path) -> float:
        return 0.9 * (next(_npy_files(path), None) is not None)

    def opened(self, path: Path, memory: int) -> Opened:
        files = sorted(_npy_files(path))
        names = [file.relative_to(path).as_posix().removesuffix(".npy") for file in files]
        return names, lambda number: map_numbers(files[number])


def _npy_files(path: Path) -> Iterator[Path]:
    endings = tuple(f"{suffix}.npy" for suffix in PHOTO_SUFFIXES)
    return (one for one in path.rglob("*.npy") if one.name.lower().endswith(endings))


class _HlocGlobal(DescribedImages):
    title = "global features of hloc"
    layout = "HDF5 with a group for each image that holds global_descriptor"
    methods = ("hloc", "NetVLAD", "DIR", "OpenIBL", "MegaLoc")
    key = "/global_descriptor"

    def recognise(self, path: Path) -> float:
        return 0.9 * any(name.endswith(self.key) for name in dataset_names(path, 8))

    def opened(self, path: Path, memory: int) -> Opened:
        file = Hdf5File(path, memory)
        names = [name.removesuffix(self.key) for name in file.names() if name.endswith(self.key)]
        return names, lambda number: file.read(names[number] + self.key)


GAME4LOC, UNIVERSITY1652 = _Game4Loc(), _University1652()
ANYLOC, HLOC_GLOBAL = _AnyLoc(), _HlocGlobal()
