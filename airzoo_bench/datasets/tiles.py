"""Parts of the map as files: tiles of a gallery as pictures, crops with their georeference."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.progress import Progress
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.matching.crops import write_crop
from airzoo_bench.matching.truth import MatchingTruth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["read_tile", "write_crops", "write_tiles"]


def read_tile(dom: Path, tile: pd.Series[Any]) -> NDArray[np.uint8]:
    """Read one tile (height, width, 3) from its window of the map."""
    window = (int(tile["x"]), int(tile["y"]), int(tile["width"]), int(tile["height"]))
    return read_rgb(dom, window)


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
