"""Maps that photos are matched to: one of the whole scene, or one for each photo."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import read_text
from airzoo_bench.geometry.crs import check_same_crs
from airzoo_bench.geometry.raster_files import raster_sha256
from airzoo_bench.geometry.rasters import RasterInfo, open_info
from airzoo_bench.storage.mirror import pointed

__all__ = [
    "ReferenceMap",
    "check_dsm",
    "check_map",
    "dsm_checksum",
    "grid_of",
    "own_map",
    "read_own_maps",
    "write_own_maps",
]

_MAP_LIMIT_BYTES = 1 << 20
_GRID = ("width", "height", "a", "b", "c", "d", "e", "f")
_ANEW = "prepare the benchmark again"


@dataclass(frozen=True, eq=False)
class ReferenceMap:
    """A map, and the surface model that its pixels are lifted by.

    Attributes
    ----------
    dom : RasterInfo
        The map; only its georeference is used for scoring.
    dsm : Path
        The surface model.
    dsm_sha256 : str
        Of the surface model's bytes.
    """

    dom: RasterInfo
    dsm: Path
    dsm_sha256: str


def grid_of(dom: RasterInfo) -> dict[str, Any]:
    """Return all of a map that scores are computed from: size, geotransform, CRS."""
    transform = [float(value) for value in dom.transform[:6]]
    size = {"width": dom.width, "height": dom.height}
    return size | {"transform": transform, "crs": dom.crs.to_string()}


def dsm_checksum(dsm: Path) -> str:
    """Return the SHA-256 of a surface model."""
    if not pointed(dsm).is_file():
        raise BenchmarkError(
            "the surface model is not there",
            where=dsm,
            expected="the DSM that matches are lifted by",
            fix="put it back where benchmark.toml says, or prepare with --copy",
        )
    return raster_sha256(dsm)


def check_map(path: Path, dom: RasterInfo) -> None:
    """Compare a map's grid with the one that ``map.json`` states."""
    text = read_text(path, BenchmarkError, "grid of the map", _MAP_LIMIT_BYTES)
    try:
        prepared = json.loads(text)
    except ValueError as error:
        raise BenchmarkError(f"not JSON: {error}", where=path, fix=_ANEW) from error
    _compare(prepared if isinstance(prepared, dict) else {}, dom)


def _compare(prepared: dict[str, Any], dom: RasterInfo) -> None:
    # One CRS has several spellings: it is compared by what it means.
    found = grid_of(dom)
    if prepared | {"crs": found["crs"]} != found:
        raise BenchmarkError(
            "the map's grid is not the one that the benchmark was prepared with: "
            f"{json.dumps(found)}",
            where=dom.path,
            expected=json.dumps(prepared),
            fix="put the map back, or prepare the benchmark again",
        )
    check_same_crs(dom.crs, prepared.get("crs"), f"{dom.path} and the map that was prepared")


def own_map(folder: Path, photo: str) -> tuple[Path, Path]:
    """Return the files of a photo's own map and surface model."""
    name = photo.split("/", 1)[1]
    return folder / f"{name}_dom.tif", folder / f"{name}_dsm.tif"


def write_own_maps(path: Path, ids: Sequence[str], maps: Sequence[ReferenceMap]) -> None:
    """Write the grid of each query's map, and the checksum of its surface model."""
    import pandas as pd

    rows = [
        (id_, one.dom.width, one.dom.height, *map(repr, map(float, one.dom.transform[:6])))
        for id_, one in zip(ids, maps, strict=True)
    ]
    table = pd.DataFrame(rows, columns=["id", *_GRID])
    table["crs"] = [one.dom.crs.to_string() for one in maps]
    table["dsm_sha256"] = [one.dsm_sha256 for one in maps]
    table.to_csv(path, index=False, lineterminator="\n")


def read_own_maps(path: Path, folder: Path, ids: Sequence[str]) -> tuple[ReferenceMap, ...]:
    """Read the queries' maps, and compare them with those that were prepared."""
    table = read_table(path, ("id", *_GRID, "crs", "dsm_sha256"))
    if table["id"].tolist() != list(ids):
        raise BenchmarkError("the maps are not those of queries.csv", where=path, fix=_ANEW)
    found = []
    for row in table.to_dict("records"):
        dom, dsm = own_map(folder, row["id"])
        info, checksum = open_info(dom), dsm_checksum(dsm)
        transform = [float(row[name]) for name in _GRID[2:]]
        size = {"width": int(row["width"]), "height": int(row["height"])}
        _compare(size | {"transform": transform, "crs": row["crs"]}, info)
        check_dsm(dsm, checksum, str(row["dsm_sha256"]))
        found.append(ReferenceMap(info, dsm, checksum))
    return tuple(found)


def check_dsm(dsm: Path, found: str, prepared: str | None) -> None:
    """Refuse a surface model that is not the one that was prepared."""
    if found != prepared:
        raise BenchmarkError(
            "the surface model is not the one that the benchmark was prepared with",
            where=dsm,
            expected=f"SHA-256 {(prepared or 'none')[:12]}…",
            fix="put it back, and what lies beside it and changes its heights (.aux.xml, .msk, "
            "world files); or prepare the benchmark again",
        )
