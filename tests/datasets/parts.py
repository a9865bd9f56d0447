"""Tiles and crops that `prepare` wrote as files, held to what methods read from the maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import rasterio
from PIL import Image

from airzoo_bench.api.benchmark import BlindScene

BOX = ["lon_min", "lat_min", "lon_max", "lat_max"]
TRANSFORM = list("abcdef")


def files_below(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def hold_tiles(home: Path, scene: BlindScene) -> None:
    """Hold all tile files below a scene's folder to the tiles of the scene."""
    listed = pd.read_csv(home / "retrieval" / "tiles" / "tiles.csv")
    assert listed["id"].tolist() == [tile.id for tile in scene.tiles()]
    assert files_below(home / "retrieval" / "tiles") == {"tiles.csv", *listed["file"]}
    for row, tile in list(zip(listed.itertuples(), scene.tiles(), strict=True))[::7]:
        with Image.open(home / "retrieval" / "tiles" / str(row.file)) as image:
            np.testing.assert_array_equal(np.asarray(image), tile.image)
        assert listed.loc[row.Index, BOX].tolist() == list(tile.box)
        assert listed.loc[row.Index, ["x", "y", "width", "height"]].tolist() == list(tile.window)
        with rasterio.open(tile.map) as whole:
            corner = whole.transform.c + whole.transform.a * tile.window[0]
        assert row.c == corner


def hold_crops(home: Path, scene: BlindScene) -> None:
    """Hold all crop files below a scene's folder to the crops of the scene."""
    listed = pd.read_csv(home / "matching" / "crops" / "crops.csv")
    assert listed["id"].tolist() == [crop.query.id for crop in scene.crops()]
    both = {*listed["dom_file"], *listed["dsm_file"]}
    assert len(both) == 2 * len(listed)
    assert files_below(home / "matching" / "crops") == {"crops.csv", *both}
    for row, crop in list(zip(listed.itertuples(), scene.crops(), strict=True))[::3]:
        with rasterio.open(home / "matching" / "crops" / str(row.dom_file)) as dom:
            np.testing.assert_array_equal(np.moveaxis(dom.read(), 0, -1)[..., :3], crop.image)
            assert dom.transform[:6] == tuple(listed.loc[row.Index, TRANSFORM])
            assert dom.crs == rasterio.CRS.from_string(str(row.crs))
        assert crop.to_world([[0, 0]]).tolist() == [[row.c, row.f]]
