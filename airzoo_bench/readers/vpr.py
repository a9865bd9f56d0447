"""Log folders of VPR-methods-evaluation: descriptors, or the paths of what each query found.

The descriptors have no names. Their rows follow the listing of two folders, which the log names;
where these are not on this machine, a list of names says it, or the benchmark's own order.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.files import first_bytes, read_text
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions
from airzoo_bench.formats.budget import Budget
from airzoo_bench.readers.lengths import compared
from airzoo_bench.readers.retrieval import (
    NamedRows,
    SceneImages,
    aside,
    check_descriptors,
    gallery_rows,
    join,
    query_rows,
    ranked_lists,
)
from airzoo_bench.readers.vpr_log import VprLog, read_log
from airzoo_bench.readers.vpr_names import BY_COUNT, FIX, NameSource, name_source

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

__all__ = ["VPR", "VprReader"]

_QUERIES, _DATABASE, _LISTS = "queries_descriptors.npy", "database_descriptors.npy", "preds"
_DEEPEST = 3  # logs/NAME/TIME, above which a folder of logs may stand
_MOST_FOLDERS = 4096
_NUMBERED = re.compile(r"\d{3,}\.txt")
_HEADS = ("Query path:", "Predictions paths:", "Positives paths:")
_LIST_BYTES = 4 << 20
_BYTES_OF_NAME = 300  # of memory, for a path and what stands for it
_DOUBLE = 8
_LISTS_COMPARED = 64
_ROWS = 4096  # of the gallery at a time
_ROUNDING = 1e-4  # of squared distances, which the method computes in float32
_AGAIN = "run the method again with --save_descriptors"


class VprReader(Reader):
    """See `Reader`."""

    track = "retrieval"
    title = "a log folder of VPR-methods-evaluation"
    layout = "queries_descriptors.npy and database_descriptors.npy, or preds/NNN.txt, with info.log"
    methods = ("VPR-methods-evaluation", "SALAD", "MegaLoc", "AnyLoc", "BoQ", "CosPlace")
    takes_names = True

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        return 0.95 if log_folders(path, first=True) else 0.0

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        images = SceneImages.of(reading, path)
        budget = Budget(reading.memory_bytes)
        names = name_source(reading.names, (path, *reading.folders))
        logs, empty = _with_answers([read_log(folder) for folder in log_folders(path)])
        if any(_has_descriptors(log.folder) for log in logs):
            parts = [_descriptors(one, images, names, budget) for one in logs]
            names.check_used_up()
            _check_one_run_each(logs, [queries.ids.tolist() for queries, _ in parts])
            predictions = join(path, [one[0] for one in parts], [one[1] for one in parts])
            said, notes = compared("l2", reading.protocol, predictions)
            left = sum(one[0].strange for one in parts)
        else:
            lists, left = _all_lists(logs, images, budget)
            predictions = ranked_lists(path, lists, None, budget)
            said, notes = ("ranks are those of preds/, by L2 distance over its whole gallery",), ()
        conventions = (*_ran(logs), *names.said, *said)
        listed = all(_list_files(log.folder) for log in logs)
        assumed = [one for one in names.said if one == BY_COUNT and not listed]
        said_too = (*_unused(empty), *aside(left), *assumed, *notes)
        return ReadPredictions(predictions, conventions, said_too, names.beside(path))


VPR = VprReader()


def log_folders(path: Path, *, first: bool = False) -> list[Path]:
    """Find the log folders at a path or, where it is none, below it, in the order of their paths.

    Parameters
    ----------
    path : Path
    first : bool
        Whether the first one is enough.
    """
    found: list[Path] = []
    left, seen = [(path, 0)], 0
    while left and seen < _MOST_FOLDERS and not (first and found):
        folder, depth = left.pop()
        seen += 1
        if _is_log(folder):
            found.append(folder)
        elif depth < _DEEPEST and folder.is_dir() and not folder.is_symlink():
            below = sorted((one for one in _entries(folder) if one.is_dir()), reverse=True)
            left += [(one, depth + 1) for one in below]
    return found


def _entries(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:
        return []


def _has_descriptors(folder: Path) -> bool:
    return any((folder / name).is_file() for name in (_QUERIES, _DATABASE))


def _with_answers(logs: list[VprLog]) -> tuple[list[VprLog], list[VprLog]]:
    """Part runs from those that broke off and left a log alone; all are kept where all did."""
    full = [log for log in logs if _has_descriptors(log.folder) or _list_files(log.folder)]
    return (full, [log for log in logs if log not in full]) if full else (logs, [])


def _unused(logs: Sequence[VprLog]) -> tuple[str, ...]:
    runs = [str(Path(log.folder.parent.name, log.folder.name)) for log in logs]
    said = f"{counted(len(runs), 'run')} with neither descriptors nor lists, left aside: "
    return (said + first_of(runs),) if runs else ()


def _check_one_run_each(logs: Sequence[VprLog], asked: Sequence[Sequence[str]]) -> None:
    """Refuse two runs that answer the same query."""
    seen: dict[str, Path] = {}
    for log, queries in zip(logs, asked, strict=True):
        for query in queries:
            if query in seen:
                raise PredictionError(
                    f"is a second run of what {seen[query]} answers: {query}",
                    where=log.folder,
                    expected="one run for each scene",
                    fix="move one of the two elsewhere, or name the folder of one run",
                )
        seen |= dict.fromkeys(queries, log.folder)


def _is_log(folder: Path) -> bool:
    if _has_descriptors(folder):
        return True
    lists = _list_files(folder)
    if lists:
        return first_bytes(lists[0], len(_HEADS[0])) == _HEADS[0].encode()
    return read_log(folder).database is not None


def _list_files(folder: Path) -> list[Path]:
    """Return the lists of a log folder by number; from 1000 on they have four digits."""
    if not (folder / _LISTS).is_dir():
        return []
    found = [one for one in _entries(folder / _LISTS) if _NUMBERED.fullmatch(one.name)]
    return sorted((one for one in found if one.is_file()), key=lambda one: int(one.stem))


def _ran(logs: Sequence[VprLog]) -> tuple[str, ...]:
    methods = sorted({log.method for log in logs if log.method})
    if len(methods) > 1:
        raise PredictionError(
            f"runs of several methods: {first_of(methods)}",
            where=logs[0].folder.parent,
            expected="a log folder for each scene, of one method",
            fix="name the folder of one method's runs",
        )
    return tuple(f"info.log says: method {method}" for method in methods)


def _descriptors(
    log: VprLog, images: SceneImages, names: NameSource, budget: Budget
) -> tuple[NamedRows, NamedRows]:
    """Map the gallery of one log folder, read its queries, and name both."""
    from airzoo_bench.formats.npz import map_numbers

    folder, rows = log.folder, {}
    for file in (_DATABASE, _QUERIES):
        if not (folder / file).is_file():
            raise PredictionError(f"lacks {file}", where=folder, expected="both files", fix=_AGAIN)
        rows[file] = map_numbers(folder / file)
        check_descriptors(folder / file, "it", rows[file])
    gallery, asked = rows[_DATABASE], rows[_QUERIES]
    _check_counts(log, len(gallery), len(asked))
    budget.hold(folder, "its queries", asked.size * (asked.itemsize + _DOUBLE))
    budget.hold(folder, "the names of its images", (len(gallery) + len(asked)) * _BYTES_OF_NAME)
    here = images.of_run(log.folders)
    tiles, photos, assumed = names.of(log, here, len(gallery), len(asked))
    named = (
        query_rows(photos, _in_memory(asked), here, folder / _QUERIES),
        gallery_rows(tiles, gallery, here, folder / _DATABASE),
    )
    if assumed:
        _check_order(log, here, photos, *named, budget)
    return named


def _check_order(
    log: VprLog,
    images: SceneImages,
    photos: Sequence[str],
    queries: NamedRows,
    gallery: NamedRows,
    budget: Budget,
) -> None:
    """Refuse names by order that positions in names, or the lists in preds/, contradict."""
    files = _list_files(log.folder)
    if log.labels and not files:
        raise _unnamed(log.folder, "its images were ordered by the positions in their names")
    if not files or queries.rows.shape[1] != gallery.rows.shape[1]:  # `join` refuses the lengths
        return
    described = queries.ids.tolist()
    rows, tiles = [], []
    for file in files[:: len(files) // _LISTS_COMPARED + 1]:
        query, ranked = _read_list(file, budget)
        found, number = images.queries.find(query), int(file.stem)
        if number >= len(photos) or found != images.queries.find(photos[number]):
            raise _unnamed(file, f"is of {query[-80:]!r}, by order another photo")
        if found is not None:
            rows.append(described.index(found))
            tiles.append(_tiles(ranked, images, file))
    wrong = _not_nearest(queries.rows[rows], tiles, gallery)
    if wrong is not None:
        raise _unnamed(files[0].parent, f"{described[rows[wrong]]} has other nearest tiles")


def _unnamed(where: Path, why: str) -> PredictionError:
    return PredictionError(
        f"rows of descriptors have no names, and the benchmark's order is not theirs: {why}",
        where=where,
        expected="folders in info.log that are the benchmark's or below the predictions, a list "
        "of names, or preds/ without descriptors",
        fix=f"{FIX}, or move both .npy files elsewhere to have the lists of preds/ scored",
    )


def _not_nearest(
    queries: NDArray[np.floating], ranked: Sequence[Sequence[str]], gallery: NamedRows
) -> int | None:
    """Return the first query whose list is not in the order of L2 distances, if there is one."""
    import numpy as np

    from airzoo_bench.core.ids import rows_among
    from airzoo_bench.retrieval.descriptors import Rows

    asked = queries.astype(np.float64)
    nearest, longest = np.full(len(asked), np.inf), 0.0
    for _, rows in Rows.join(gallery.rows).blocks():
        squares = (rows.astype(np.float64) ** 2).sum(axis=1)
        distances = squares - 2 * asked @ rows.T.astype(np.float64)
        nearest = np.minimum(nearest, distances.min(axis=1))
        longest = max(longest, float(squares.max()))
    for query, tiles in enumerate(ranked):
        found = Rows.join(gallery.rows).take(rows_among(np.array(tiles), gallery.ids))
        own = (found.astype(np.float64) ** 2).sum(axis=1) - 2 * found @ asked[query]
        slack = _ROUNDING * (longest + asked[query] @ asked[query])
        if (np.diff(own, prepend=nearest[query]) < -slack).any() or own[0] > nearest[query] + slack:
            return query
    return None


def _in_memory(rows: NDArray[np.floating]) -> NDArray[np.floating]:
    import numpy as np

    return np.array(rows)


def _check_counts(log: VprLog, tiles: int, photos: int) -> None:
    if log.counts not in (None, (photos, tiles)):
        raise PredictionError(
            f"descriptors of {photos:,} queries and {tiles:,} database images, and its info.log "
            f"speaks of {log.counts[0]:,} and {log.counts[1]:,}",
            where=log.folder,
            expected="the files of one run",
            fix=_AGAIN,
        )


def _all_lists(
    logs: Sequence[VprLog], images: SceneImages, budget: Budget
) -> tuple[dict[str, Sequence[str]], int]:
    """Read the lists of all log folders; also count those of photos that are no queries."""
    answered: list[dict[str, Sequence[str]]] = []
    left = 0
    for log in logs:
        files = _list_files(log.folder)
        _check_complete(log, files)
        here = images.of_run(log.folders)
        read = [_read_list(file, budget) for file in files]
        asked = here.queries.find_all([query for query, _ in read], log.folder / _LISTS)
        named = zip(files, asked, read, strict=True)
        answered.append({one: _tiles(paths, here, file) for file, one, (_, paths) in named if one})
        left += asked.count(None)
    _check_one_run_each(logs, [list(lists) for lists in answered])
    return {query: tiles for lists in answered for query, tiles in lists.items()}, left


def _check_complete(log: VprLog, files: list[Path]) -> None:
    """Refuse lists some of which were not written."""
    numbers = {int(file.stem) for file in files}
    expected = max(numbers, default=-1) + 1 if log.counts is None else log.counts[0]
    lacking = sorted(set(range(expected)) - numbers)
    if log.only_wrong or lacking or not files:
        what = f"lacks the lists of {first_of(lacking, expected, noun='query')}"
        if not files:
            what = "has neither descriptors nor lists"
        elif not lacking:
            what = "has lists of wrongly answered queries only"
        raise PredictionError(
            what + ": --save_only_wrong_preds leaves queries out" * log.only_wrong,
            where=log.folder,
            expected="a list for each query, or the descriptors",
            fix=_AGAIN,
        )


def _read_list(file: Path, budget: Budget) -> tuple[str, list[str]]:
    """Return the query's path and those that it found, best first."""
    text = read_text(file, PredictionError, "list of predictions", _LIST_BYTES)
    budget.hold(file.parent, f"list {file.name}", 4 * len(text))
    parts: dict[str, list[str]] = {}
    for line in text.splitlines():
        if line in _HEADS:
            parts[line] = []
        elif line.strip() and parts:
            list(parts.values())[-1].append(line)
    if len(parts.get(_HEADS[0], ())) != 1 or not parts.get(_HEADS[1]):
        raise PredictionError(
            "no list of predictions, or a damaged one",
            where=file,
            expected=f"{_HEADS[0]!r}, a path, {_HEADS[1]!r}, paths",
            fix="run the method again",
        )
    return parts[_HEADS[0]][0], parts[_HEADS[1]]


def _tiles(paths: Sequence[str], images: SceneImages, file: Path) -> list[str]:
    found = images.tiles.find_all(paths, file)
    strange = [path for path, one in zip(paths, found, strict=True) if one is None]
    if strange:
        raise PredictionError(
            f"ranks what is no tile: {first_of([repr(path[:200]) for path in strange])}",
            where=file,
            expected="tiles of the benchmark's gallery",
            fix="let --database_folder hold the benchmark's tiles alone, and run again",
        )
    return [one for one in found if one is not None]
