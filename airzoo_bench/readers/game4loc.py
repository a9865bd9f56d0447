"""Features and names that a user of Game4Loc saves: the method's evaluation saves nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from airzoo_bench.formats.npz import NpzFile

__all__ = ["GAME4LOC", "LINES", "Game4LocReader"]

_KEYS = ("query_features", "query_names", "gallery_features", "gallery_names")
_BYTES_OF_NAME = 400  # of memory, for a name and what stands for it
_MOST_BYTES = 1 << 20
_DOUBLE = 8

LINES = """\
gallery_features = []  # before the loop over gallery_loader
gallery_features.append(gallery_features_batch.float().cpu())  # last in it, once normalised
np.savez(  # after it
    "features.npz",
    query_features=img_features_query.cpu().numpy(),
    query_names=np.array(query_list),
    gallery_features=torch.cat(gallery_features).numpy(),
    gallery_names=np.array(gallery_list),
)
"""
"""What is added to `evaluate` in game4loc/evaluate/gta.py."""


_LATER = "keep gallery_features after they are normalised, as the last line of the loop"


class Game4LocReader(Reader):
    """See `Reader`."""

    track = "retrieval"
    title = "features and names of images in one npz"
    layout = f"npz with {', '.join(_KEYS)}"
    methods = ("Game4Loc",)

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        from airzoo_bench.formats.npz import NpzFile

        if not path.is_file() or path.suffix != ".npz":
            return 0.0
        try:
            names = NpzFile(path, _MOST_BYTES).names()
        except (OSError, PredictionError):
            return 0.0
        return 0.95 if names >= {"query_features", "gallery_features"} else 0.0

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        from airzoo_bench.formats.arrays import check_fields
        from airzoo_bench.formats.npz import NpzFile
        from airzoo_bench.readers.lengths import compared, refuse_tiles_without_unit_length
        from airzoo_bench.readers.retrieval import (
            SceneImages,
            aside,
            gallery_rows,
            join,
            query_rows,
        )

        file = NpzFile(path, reading.memory_bytes)
        check_fields(file, _KEYS, _KEYS, "what these lines save:\n" + LINES)
        images = SceneImages.of(reading, path)
        queries = query_rows(*_features(file, "query", file.read), images, path)
        gallery = gallery_rows(*_features(file, "gallery", file.map), images, path)
        predictions = join(path, [queries], [gallery])
        refuse_tiles_without_unit_length(path, predictions, _LATER)
        said, notes = compared("inner_product", reading.protocol, predictions)
        return ReadPredictions(predictions, said, (*aside(queries.strange), *notes))


GAME4LOC = Game4LocReader()


def _features(
    file: NpzFile, kind: str, read: Callable[[str], NDArray[Any]]
) -> tuple[list[str], NDArray[Any]]:
    from airzoo_bench.formats.arrays import texts
    from airzoo_bench.readers.retrieval import check_descriptors

    names, rows = texts(file, f"{kind}_names", 1).tolist(), read(f"{kind}_features")
    file.budget.hold(file.path, f"{kind}_names as text", len(names) * _BYTES_OF_NAME)
    if kind == "query":
        file.budget.hold(file.path, "query_features in double precision", rows.size * _DOUBLE)
    check_descriptors(file.path, f"field '{kind}_features'", rows, len(names))
    return names, rows
