"""Parts of the map as files: tiles of a gallery as pictures, crops with their georeference."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.benchmark.images import read_tile
from airzoo_bench.core.progress import Progress
from airzoo_bench.matching.crop_files import write_crop
from airzoo_bench.matching.truth import MatchingTruth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["write_crops", "write_tiles"]


def write_tiles(folder: Path, tiles: pd.DataFrame, dom: Path, progress: Progress) -> None:
    """Write every tile as ``<name>.png``, the name being its id without the scene."""
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    for _, tile in progress(tiles.iterrows(), "tiles", len(tiles)):
        name = str(tile["id"]).split("/", 1)[1]
        Image.fromarray(read_tile(dom, tile)).save(folder / f"{name}.png")


def write_crops(folder: Path, truth: MatchingTruth, progress: Progress) -> None:
    """Write the crop of each query as ``<name>_dom.tif`` and ``<name>_dsm.tif``.

    The name is the query's id without the scene, with ``_`` for the slashes in it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows = zip(truth.queries["id"], truth.crops.tolist(), strict=True)
    for query, (x, y, width, height) in progress(rows, "crops", len(truth.queries)):
        name = str(query).split("/", 1)[1].replace("/", "_")
        write_crop(truth.dom.path, truth.dsm, (x, y, width, height), folder, name)
