"""Parts of the map as files: tiles of a gallery as pictures, crops with their georeference."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.images import read_tile
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.folder import SceneTruths
from airzoo_bench.geometry.rasters import RasterInfo, pixel_to_world
from airzoo_bench.matching.crops import write_crop
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.retrieval.truth import BOX_COLUMNS

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["write_parts"]

_WINDOW = ["x", "y", "width", "height"]


def write_parts(
    home: Path,
    truths: SceneTruths,
    gallery: RasterInfo,
    *,
    tiles: bool,
    crops: bool,
    progress: Progress,
) -> None:
    """Write the tiles and crops of a scene as files, as far as they are wanted and there are any.

    Parameters
    ----------
    home : Path
        The scene's folder.
    truths : SceneTruths
    gallery : RasterInfo
        The map that tiles are cut from.
    tiles, crops : bool
        Which are wanted.
    progress : Progress

    Raises
    ------
    UserError
        A map cannot be read, or a file not be written.
    """
    if truths.retrieval is not None and tiles:
        _write_tiles(home / "retrieval" / "tiles", truths.retrieval.truth.tiles, gallery, progress)
    if truths.matching is not None and crops:
        _write_crops(home / "matching" / "crops", truths.matching, progress)


def _write_tiles(
    folder: Path, tiles: pd.DataFrame, gallery: RasterInfo, progress: Progress
) -> None:
    """Write every tile as ``<name>.png``, the name being its id without the scene, and a list."""
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    files = [f"{_name(tile)}.png" for tile in tiles["id"]]
    rows = zip(files, tiles.iterrows(), strict=True)
    for file, (_, tile) in progress(rows, "tiles", len(tiles)):
        Image.fromarray(read_tile(gallery.path, tile)).save(folder / file)
    listed = tiles[["id", *BOX_COLUMNS, "size_m", *_WINDOW]].copy()
    listed.insert(1, "file", files)
    _write_list(folder / "tiles.csv", listed, gallery)


def _write_crops(folder: Path, truth: MatchingTruth, progress: Progress) -> None:
    """Write the crop of each query as ``<name>_dom.tif`` and ``<name>_dsm.tif``, and a list.

    The name is the query's id without the scene, with folders for the slashes in it.
    """
    import pandas as pd

    ids = truth.queries["id"].tolist()
    names = [_name(query) for query in ids]
    for name, window in progress(zip(names, truth.crops.tolist(), strict=True), "crops", len(ids)):
        write_crop(truth.dom.path, truth.dsm, tuple(window), folder, name)
    files = {f"{kind}_file": [f"{name}_{kind}.tif" for name in names] for kind in ("dom", "dsm")}
    windows = dict(zip(_WINDOW, truth.crops.T, strict=True))
    _write_list(folder / "crops.csv", pd.DataFrame({"id": ids, **files, **windows}), truth.dom)


def _write_list(path: Path, parts: pd.DataFrame, whole: RasterInfo) -> None:
    """Write a row a part of a map, with the transform of its own pixels to the map's CRS."""
    a, b, _, d, e, _ = whole.transform[:6]
    corners = pixel_to_world(whole.transform, parts[["x", "y"]].to_numpy(np.float64))
    transform = {"a": a, "b": b, "c": corners[:, 0], "d": d, "e": e, "f": corners[:, 1]}
    columns = parts.assign(**transform, crs=whole.crs.to_string())
    path.parent.mkdir(parents=True, exist_ok=True)
    columns.to_csv(path, index=False, lineterminator="\n")


def _name(part: str) -> str:
    return part.split("/", 1)[1]
