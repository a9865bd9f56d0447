"""Grids of PROJ for geoids that are a formula, so that undulations are known exactly."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyproj
import pytest

from airzoo_bench.geometry import vertical

EGM2008, EGM96 = "us_nga_egm08_25.tif", "us_nga_egm96_15.tif"
_CODES = {EGM2008: "3855", EGM96: "5773"}


def undulation_m(lon: float, lat: float, base_m: float = 40.0) -> float:
    """Return the undulation of the made-up geoids: linear, so that PROJ interpolates it exactly."""
    return base_m + lon / 8 + lat / 16


def write_geoid(folder: Path, name: str, base_m: float = 40.0) -> Path:
    """Write a grid from 0 to 30 degrees east and 40 to 60 degrees north."""
    import rasterio
    from rasterio import Affine

    lon, lat = np.meshgrid(np.arange(0.0, 30.5, 0.5), np.arange(60.0, 39.5, -0.5))
    values = (base_m + lon / 8 + lat / 16).astype(np.float32)
    path = folder / name
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=values.shape[0],
        width=values.shape[1],
        count=1,
        dtype="float32",
        crs="EPSG:4979",
        transform=Affine(0.5, 0, -0.25, 0, -0.5, 60.25),
    ) as grid:
        grid.write(values, 1)
        grid.update_tags(
            TYPE="VERTICAL_OFFSET_GEOGRAPHIC_TO_VERTICAL",
            target_crs_epsg_code=_CODES.get(name, "3855"),
            AREA_OR_POINT="Point",
        )
        grid.set_band_description(1, "geoid_undulation")
        grid.units = ("metre",)
    return path


@contextmanager
def proj_with(folder: Path) -> Iterator[None]:
    """Have PROJ know the grids of a folder, and none that are installed."""
    before = pyproj.datadir.get_data_dir()
    own = next(place for place in before.split(os.pathsep) if (Path(place) / "proj.db").is_file())
    bare = folder / "bare"
    bare.mkdir(exist_ok=True)
    for name in ("proj.db", "proj.ini"):
        if (Path(own) / name).is_file() and not (bare / name).exists():
            (bare / name).symlink_to(Path(own) / name)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PROJ_SKIP_READ_USER_WRITABLE_DIRECTORY", "YES")
        patch.setenv("PROJ_NETWORK", "OFF")
        try:
            _use(f"{bare}{os.pathsep}{folder}")
            yield
        finally:
            _use(before)


def _use(places: str) -> None:
    pyproj.datadir.set_data_dir(places)
    vertical._operation.cache_clear()
