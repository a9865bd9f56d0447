"""Global features of hloc: HDF5, a group for each image with ``global_descriptor``."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions

__all__ = ["HLOC_GLOBAL", "HlocGlobalReader"]

_KEY = "/global_descriptor"
_TRIED = 8


class HlocGlobalReader(Reader):
    """See `Reader`."""

    track = "retrieval"
    title = "global features of hloc"
    layout = "HDF5 with a group for each image that holds global_descriptor"
    methods = ("hloc", "NetVLAD", "DIR", "OpenIBL", "MegaLoc")

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        from airzoo_bench.formats.hdf5 import dataset_names

        return 0.9 if any(name.endswith(_KEY) for name in dataset_names(path, _TRIED)) else 0.0

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        from airzoo_bench.formats.hdf5 import Hdf5File
        from airzoo_bench.readers.image_bag import read_bag
        from airzoo_bench.readers.lengths import compared
        from airzoo_bench.readers.retrieval import SceneImages

        file = Hdf5File(path, reading.memory_bytes)
        names = [name.removesuffix(_KEY) for name in file.names() if name.endswith(_KEY)]
        if not names:
            raise PredictionError(
                "holds no global_descriptor",
                where=path,
                expected="what hloc.extract_features writes for retrieval (netvlad, megaloc)",
                fix="give local features and matches to the matching track",
            )
        images = SceneImages.of(reading, path)
        predictions, notes = read_bag(
            path, names, lambda number: file.read(names[number] + _KEY), images, file.budget
        )
        said, more = compared("inner_product", reading.protocol, predictions)
        kind = predictions.content.queries.dtype  # type: ignore[union-attr]
        conventions = (f"descriptors are {kind}, as the file has them", *said)
        return ReadPredictions(predictions, conventions, (*notes, *more))


HLOC_GLOBAL = HlocGlobalReader()
