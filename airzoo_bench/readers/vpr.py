"""Log folders of VPR-methods-evaluation: descriptors, or the paths that each query found.

The descriptors have no names. Their rows follow the listing of two folders, which the log names;
where these are not on this machine, a list of names says it, or the benchmark's own order.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.files import first_bytes, read_text
from airzoo_bench.evaluation.predictions import PredictionFile, Reader, ReadRequest
from airzoo_bench.formats.arrays import row_blocks, rows_among
from airzoo_bench.formats.npz import map_numbers
from airzoo_bench.readers.descriptors import (
    NamedRows,
    SceneImages,
    check_descriptors,
    describe_metric,
    gallery_rows,
    join,
    note_strange,
    query_rows,
    tile_images,
)
from airzoo_bench.readers.names import names_in, read_names
from airzoo_bench.readers.ranks import ranked_lists, tile_ids

_QUERIES, _DATABASE, _LISTS = "queries_descriptors.npy", "database_descriptors.npy", "preds"
_DEEPEST = 3  # logs/NAME/TIME, above which a folder of logs may stand
_HEADS = ("Query path:", "Predictions paths:", "Positives paths:")
_LIST_BYTES = 4 << 20
_LISTS_COMPARED = 64
_ROUNDING = 1e-4  # of squared distances, which the method computes in float32
_AGAIN = "run the method again with --save_descriptors"
_LISTED = (".jpg", ".jpeg", ".png")
_LIST_NAMES = (
    "list the database images, then the queries, in the method's order, and add --names LIST"
)
_NAMED = "folders in info.log that are the benchmark's or below the predictions, or a list of names"
_BY_LIST = "names are the lines of --names: each run's database images, then its queries"
_BY_LISTING = "names are the files in the folders that info.log names, in the order of their paths"
_BY_COUNT = (
    "names are taken by order: the folders of info.log are neither the benchmark's nor below the "
    "predictions, and as many images as were described are in the benchmark, sorted by path"
)


class _Log:
    """A log folder: the arguments of its run as Python prints them, and its counts of images.

    `labels`: names begin with positions, which decide their order.
    """

    def __init__(self, folder: Path) -> None:
        text = first_bytes(folder / "info.log", 1 << 20).decode("utf-8", "replace")
        arguments = text.rpartition("Namespace(")[2].split("\n", 1)[0]
        names = ("method", "database_folder", "queries_folder")
        found = (re.search(rf"(?:^|\s){one}='([^'\\\0]*)'", arguments) for one in names)
        self.method, self.database, self.queries = (match[1] if match else None for match in found)
        self.folders = (str(folder), self.database or "", self.queries or "")
        counts = re.search(r"#queries: (\d{1,12}); #database: (\d{1,12})", text)
        self.counts = (int(counts[1]), int(counts[2])) if counts else None
        self.labels = "use_labels=True" in arguments
        self.folder = folder
        lists = (one for one in (folder / _LISTS).glob("*.txt") if one.stem.isdecimal())
        self.lists = sorted(lists, key=lambda one: int(one.stem))  # from 1000 on of four digits
        self.has_descriptors = any((folder / name).is_file() for name in (_QUERIES, _DATABASE))
        self.is_one = self.has_descriptors or self.database is not None
        if self.lists and not self.has_descriptors:
            self.is_one = first_bytes(self.lists[0], len(_HEADS[0])) == _HEADS[0].encode()


def _logs(path: Path) -> Iterator[_Log]:
    """Yield the log folders at a path or, where it is none, below it, by their paths."""
    left = [(path, 0)]
    while left:
        folder, depth = left.pop()
        log = _Log(folder)
        if log.is_one:
            yield log
        elif depth < _DEEPEST and folder.is_dir() and not folder.is_symlink():
            below = sorted((one for one in folder.iterdir() if one.is_dir()), reverse=True)
            left += [(one, depth + 1) for one in below]


class _Vpr(Reader):
    track = "retrieval"
    title = "a log folder of VPR-methods-evaluation"
    layout = "queries_descriptors.npy and database_descriptors.npy, or preds/NNN.txt, with info.log"
    methods = ("VPR-methods-evaluation", "SALAD", "MegaLoc", "AnyLoc", "BoQ", "CosPlace")

    def recognise(self, path: Path) -> float:
        try:
            return 0.95 if next(_logs(path), None) else 0.0
        except OSError:  # a folder that may not be listed
            return 0.0

    def read(self, path: Path, request: ReadRequest) -> PredictionFile:
        images = SceneImages(request, str(path))
        names, found = _Names(request, path), [*_logs(path)]
        # Runs that broke off left a log alone; all are read where all did.
        logs = [log for log in found if log.has_descriptors or log.lists] or found
        if any(log.has_descriptors for log in logs):
            parts = [_descriptors(log, images, names) for log in logs]
            names.check_used_up()
            predictions = join(path, *map(list, zip(*parts, strict=True)))
            said = describe_metric(request)
            left = sum(one[0].strange for one in parts)
        else:
            read = [_lists(log, images) for log in logs]
            answered = {query: tiles for lists, _ in read for query, tiles in lists.items()}
            if len(answered) < sum(len(lists) for lists, _ in read):
                fix = "name the folder of one run"
                raise PredictionError("holds two runs of one query", where=path, fix=fix)
            predictions = ranked_lists(path, answered)
            said = "ranks are those of preds/, by L2 distance over its whole gallery"
            left = sum(count for _, count in read)
        unheld = _BY_COUNT in names.used and not all(log.lists for log in logs)
        methods = sorted({log.method for log in logs if log.method})
        conventions = (*(f"info.log says: method {one}" for one in methods), *names.used, said)
        return PredictionFile(
            predictions, conventions, (*note_strange(left), *(_BY_COUNT,) * unheld)
        )


# --- descriptors ---


def _descriptors(log: _Log, images: SceneImages, names: _Names) -> tuple[NamedRows, NamedRows]:
    """Map the gallery of one log folder, read its queries, and name both."""
    folder, rows = log.folder, {}
    for file in (_DATABASE, _QUERIES):
        if not (folder / file).is_file():
            raise PredictionError(f"lacks {file}", where=folder, expected="both files", fix=_AGAIN)
        rows[file] = map_numbers(folder / file)
        check_descriptors(folder / file, "it", rows[file])
    gallery, asked = rows[_DATABASE], rows[_QUERIES]
    if log.counts not in (None, (len(asked), len(gallery))):
        stated = f"its info.log speaks of {log.counts[0]:,} and {log.counts[1]:,}"
        what = f"{len(asked):,} queries and {len(gallery):,} database images, and {stated}"
        raise PredictionError(what, where=folder, expected="files of one run", fix=_AGAIN)
    here = images.at_run(log.folders)
    tiles, photos, assumed = names.names_of_run(log, here, len(gallery), len(asked))
    queries = query_rows((photos, np.array(asked)), here, folder / _QUERIES)
    named = queries, gallery_rows((tiles, gallery), here, folder / _DATABASE)
    if assumed:
        _check_order(log, here, photos, *named)
    return named


def _check_order(
    log: _Log, images: SceneImages, photos: Sequence[str], queries: NamedRows, gallery: NamedRows
) -> None:
    """Refuse names by order that positions in names, or the lists in preds/, contradict."""
    files = log.lists
    if log.labels and not files:
        raise _no_names_error(log.folder, "its images were ordered by the positions in their names")
    if not files or queries.rows.shape[1] != gallery.rows.shape[1]:  # `join` refuses the lengths
        return
    described, rows, tiles = queries.ids.tolist(), [], []
    for file in files[:: len(files) // _LISTS_COMPARED + 1]:
        query, ranked = _read_list(file)
        found, number = images.queries.find(query), int(file.stem)
        if number >= len(photos) or found != images.queries.find(photos[number]):
            raise _no_names_error(file, f"is of {query[-80:]!r}, by order another photo")
        if found is not None:
            rows.append(described.index(found))
            tiles += tile_ids(images.tiles, ranked[:1], file)
    asked = queries.rows[rows].astype(np.float64)
    best = gallery.rows[rows_among(np.array(tiles), gallery.ids)].astype(np.float64)
    lengths, own = (asked**2).sum(axis=1), ((asked - best) ** 2).sum(axis=1)
    slack = _ROUNDING * (lengths + (best**2).sum(axis=1))
    for _, some in row_blocks(gallery.rows):
        block = some.astype(np.float64)
        squares = lengths[:, None] + (block**2).sum(axis=1) - 2 * asked @ block.T
        nearer = np.flatnonzero(squares.min(axis=1) < own - slack)
        if nearer.size:
            raise _no_names_error(
                files[0].parent, f"{described[rows[nearer[0]]]} has a nearer tile"
            )


def _no_names_error(where: Path, why: str) -> PredictionError:
    return PredictionError(
        f"rows of descriptors have no names, and the benchmark's order is not theirs: {why}",
        where=where,
        expected=f"{_NAMED}, or preds/ without descriptors",
        fix=f"{_LIST_NAMES}, or move both .npy files elsewhere to have the lists of preds/ scored",
    )


# --- lists ---


def _lists(log: _Log, images: SceneImages) -> tuple[dict[str, list[str]], int]:
    """Read the lists of a log folder; also count lists of photos that are no queries."""
    files = log.lists
    numbers = {int(file.stem) for file in files}
    expected = max(numbers, default=-1) + 1 if log.counts is None else log.counts[0]
    lacking = sorted(set(range(expected)) - numbers)
    if lacking or not files:
        what = f"lacks the lists of {first_of(lacking, expected, noun='query')}"
        wanted = "a list for each query, or the descriptors"
        raise PredictionError(what, where=log.folder, expected=wanted, fix=_AGAIN)
    here = images.at_run(log.folders)
    read = [_read_list(file) for file in files]
    asked = here.queries.find_all([query for query, _ in read], log.folder / _LISTS)
    named = zip(files, asked, read, strict=True)
    found = {one: tile_ids(here.tiles, paths, file) for file, one, (_, paths) in named if one}
    return found, asked.count(None)


def _read_list(file: Path) -> tuple[str, list[str]]:
    """Return the query's path and those that it found, best first."""
    text = read_text(file, PredictionError, "list of predictions", _LIST_BYTES)
    parts: dict[str, list[str]] = {}
    for line in text.splitlines():
        if line in _HEADS:
            parts[line] = []
        elif line.strip() and parts:
            list(parts.values())[-1].append(line)
    if len(parts.get(_HEADS[0], ())) != 1 or not parts.get(_HEADS[1]):
        expected = f"{_HEADS[0]!r}, a path, {_HEADS[1]!r}, paths"
        raise PredictionError("no list, or a damaged one", where=file, expected=expected)
    return parts[_HEADS[0]][0], parts[_HEADS[1]]


# --- names of rows ---


class _Names:
    """Names of rows: from a list if there is one, else from folders, else by their order.

    What a log names must lie in one of these folders: it comes from a stranger. `used` says where
    names came from.
    """

    def __init__(self, request: ReadRequest, path: Path) -> None:
        self.used: dict[str, None] = {}
        self._list = request.names
        self._left = None if request.names is None else read_names(request.names)
        self._roots = [Path(os.path.realpath(root)) for root in (path, *request.folders)]

    def names_of_run(
        self, log: _Log, images: SceneImages, tiles: int, photos: int
    ) -> tuple[Sequence[str], Sequence[str], bool]:
        """Return the names of a run's database images and queries, and whether they are assumed."""
        if self._left is not None:
            self.used[_BY_LIST] = None
            given, self._left = self._left, self._left[tiles + photos :]
            if len(given) < tiles + photos:
                what = f"{tiles:,} database images and {counted(photos, 'query')}"
                raise _other_count(self._list, f"{counted(len(given), 'name')} for {what}")
            return given[:tiles], given[tiles : tiles + photos], False
        places = [Path(os.path.realpath(one or "/")) for one in (log.database, log.queries)]
        if all(one.is_dir() and any(map(one.is_relative_to, self._roots)) for one in places):
            self.used[_BY_LISTING] = None
            return _list_images(log.database, tiles), _list_images(log.queries, photos), False
        self.used[_BY_COUNT] = None
        return *_by_count(log, images, tiles, photos), True

    def check_used_up(self) -> None:
        """Refuse a list of names that is longer than all rows."""
        if self._left:
            raise _other_count(self._list, f"{counted(len(self._left), 'name')} more than rows")


def _other_count(path: object, what: str) -> PredictionError:
    expected = "a name for each row of the descriptors"
    return PredictionError(what, where=path, expected=expected, fix=_LIST_NAMES)


def _list_images(folder: str | None, rows: int) -> list[str]:
    """Name the images of a folder as the method's dataset class does, by ``glob("**/*")``."""
    names = []
    for home, folders, files in os.walk(folder or ""):
        folders[:] = [name for name in folders if not name.startswith(".")]
        images = (name for name in files if name.lower().endswith(_LISTED) and name[0] != ".")
        names += [(Path(home) / name).as_posix() for name in images]
    if len(names) != rows:
        raise _other_count(folder, f"{counted(len(names), 'image')} for {counted(rows, 'row')}")
    return sorted(names)


def _by_count(
    log: _Log, images: SceneImages, tiles: int, photos: int
) -> tuple[list[str], list[str]]:
    """Take the benchmark's own order where one scene, or all, has an image for each row."""
    own = [truth for truth in images.request.truths if truth.scene == images.home]
    for truths in filter(None, (own, list(images.request.truths))):
        squares = sorted(f"{one.scene}/{name}" for one in truths for _, name in tile_images(one))
        asked = [truth.queries for truth in truths]
        for tables in (asked, asked + [truth.excluded for truth in truths]):
            named = names_in(tables)
            names = sorted(f"{one.split('/', 1)[0]}/{image}" for one, image in named)
            if (len(squares), len(names)) == (tiles, photos) and all(
                map(_same_order, (squares, names))
            ):
                return squares, names
    what = f"{counted(tiles, 'database image')} and {counted(photos, 'query')} without names, "
    what += "which are those of no scene, or in several orders"
    raise PredictionError(what, where=log.folder, expected=_NAMED, fix=_LIST_NAMES)


def _same_order(paths: list[str]) -> bool:
    """Whether images in a folder a scene have the order that they have all in one folder."""
    last = [path.rsplit("/", 1)[1] for path in paths]
    return len({*last}) < len(last) or sorted(last) == last


VPR = _Vpr()
