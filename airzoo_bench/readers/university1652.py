"""``pytorch_result.mat`` of University-1652 and those after it: features, classes and paths."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from airzoo_bench.formats.mat5 import MatFile

__all__ = ["UNIVERSITY1652", "University1652Reader"]

_KEYS = ("gallery_f", "query_f")
_MOST_BYTES = 1 << 20
_BYTES_OF_NAME = 400  # of memory, for a name and what stands for it
_DOUBLE = 8
_SLASHES = re.compile(r"[/\\]+")


class University1652Reader(Reader):
    """See `Reader`."""

    track = "retrieval"
    title = "features that test.py of University-1652 writes"
    layout = (
        "MATLAB 5 with gallery_f, gallery_label, gallery_path, query_f, query_label, query_path"
    )
    methods = ("University1652-Baseline", "LPN", "FSRA", "SUES-200", "DenseUAV")

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        from airzoo_bench.formats.mat5 import MatFile

        try:
            return 0.95 if MatFile(path, _MOST_BYTES).names() >= {*_KEYS} else 0.0
        except (OSError, PredictionError):
            return 0.0

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        from airzoo_bench.formats.mat5 import MatFile
        from airzoo_bench.readers.lengths import compared
        from airzoo_bench.readers.retrieval import (
            SceneImages,
            aside,
            gallery_rows,
            join,
            query_rows,
        )

        file = MatFile(path, reading.memory_bytes)
        images = SceneImages.of(reading, path)
        queries = query_rows(*_features(file, "query"), images, path)
        gallery = gallery_rows(*_features(file, "gallery"), images, path)
        predictions = join(path, [queries], [gallery])
        said, notes = compared("inner_product", reading.protocol, predictions)
        conventions = ("images are named by the ends of their paths: class folder, file", *said)
        kinds = [kind for kind in ("query", "gallery") if f"{kind}_path" not in file.names()]
        beside = tuple(_list_beside(file, kind) for kind in kinds)
        return ReadPredictions(predictions, conventions, (*aside(queries.strange), *notes), beside)


UNIVERSITY1652 = University1652Reader()


def _features(file: MatFile, kind: str) -> tuple[list[str], NDArray[Any]]:
    """Return the paths and the features of queries or gallery."""
    from airzoo_bench.readers.retrieval import check_descriptors

    names = _paths(file, kind)
    file.budget.hold(file.path, f"names of {kind}", len(names) * _BYTES_OF_NAME)
    rows = file.numbers(f"{kind}_f")
    file.budget.hold(file.path, f"{kind}_f in double precision", rows.size * _DOUBLE)
    check_descriptors(file.path, f"variable '{kind}_f'", rows, len(names))
    _check_classes(file, kind, names)
    return names, rows


def _paths(file: MatFile, kind: str) -> list[str]:
    """Return the paths that the file has, or those of the list that test.py writes beside it."""
    from airzoo_bench.readers.names import read_names

    if f"{kind}_path" in file.names():
        return file.texts(f"{kind}_path")
    beside = _list_beside(file, kind)
    if not beside.is_file():
        raise PredictionError(
            f"has no {kind}_path, and {beside.name} is not beside it",
            where=file.path,
            expected="the paths of the images",
            fix=f"add '{kind}_path': {kind}_path to what test.py saves",
        )
    return read_names(beside)


def _list_beside(file: MatFile, kind: str) -> Path:
    return file.path.with_name(f"{kind}_name.txt")


def _check_classes(file: MatFile, kind: str, names: list[str]) -> None:
    """Refuse classes that are not those of the folders: the rows are of other images then."""
    if f"{kind}_label" not in file.names():
        return
    labels = file.numbers(f"{kind}_label").reshape(-1).tolist()
    folders = [_SLASHES.split(name)[-2:-1] for name in names]
    other = [
        f"{name} has {label:g}"
        for name, folder, label in zip(names, folders, labels, strict=False)
        if folder and folder[0].isdecimal() and int(folder[0][-18:]) != label
    ]
    if other or len(labels) != len(names):
        what = f"classes that are not those of the folders: {first_of(other)}"
        raise PredictionError(
            what if other else f"{len(labels):,} classes and {len(names):,} paths",
            where=f"{file.path}, variable '{kind}_label'",
            expected="the class of each image, in one order with its path and features",
            fix="run test.py again",
        )
