"""University-1652: `test.py`, which ends in `scipy.io.savemat`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from tests.readers.retrieval_support import Place


def write(folder: Path, place: Place) -> Path:
    """Write features, classes and paths; the images are in a folder a class."""
    pairs = [place.descriptors(scene) for scene in place.scenes]
    photos = [
        f"/data/{scene.id}/query_drone/{n:04d}/q{n:05d}.jpeg"
        for scene in place.scenes
        for n in range(len(scene.positives))
    ]
    tiles = [
        f"/data/{scene.id}/gallery_satellite/{n:04d}/t{n:05d}.jpg"
        for scene in place.scenes
        for n in range(scene.n_tiles)
    ]
    queries, gallery = (np.concatenate(list(rows)) for rows in zip(*pairs, strict=True))
    return save(folder / "pytorch_result.mat", (queries, photos), (gallery, tiles))


def save(
    path: Path, queries: tuple[Any, list[str]], gallery: tuple[Any, list[str]], **changes: Any
) -> Path:
    """Write the dictionary that test.py makes."""
    result: dict[str, Any] = {}
    for kind, (rows, paths) in (("gallery", gallery), ("query", queries)):
        result[f"{kind}_f"] = rows
        result[f"{kind}_label"] = [int(Path(one).parent.name) for one in paths]
        result[f"{kind}_path"] = paths
    scipy.io.savemat(
        path, {key: value for key, value in (result | changes).items() if value is not None}
    )
    return path
