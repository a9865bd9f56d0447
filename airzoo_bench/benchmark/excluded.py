"""Which photos of a scene a track leaves out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import IDENTITY_COLUMNS
from airzoo_bench.benchmark.tables import read_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["read_excluded"]

_LISTED = {"matching": "crops.csv", "reconstruction": "photos.csv"}


def read_excluded(benchmark: Benchmark, scene: str, track: str) -> pd.DataFrame:
    """Read which photos of a scene a track leaves out, with the reasons."""
    folder = benchmark.scene_folder(scene)
    if not benchmark.is_sealed:
        return read_table(folder / track / "excluded.csv", (*IDENTITY_COLUMNS, "reason"))
    photos = read_table(folder / "queries.csv", IDENTITY_COLUMNS)[list(IDENTITY_COLUMNS)]
    listed = _LISTED.get(track)
    asked = photos["id"] if listed is None else read_table(folder / track / listed, ("id",))["id"]
    left_out = photos[~photos["id"].isin(asked)].reset_index(drop=True)
    return left_out.assign(reason="not asked")
