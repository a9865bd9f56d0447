"""hloc's HDF5 files, written as extract_features, match_features and match_dense write them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.matching.world import World

FEATURES, MATCHES = "feats-superpoint-n4096-r1024.h5", "feats-superpoint-n4096-r1024_matches.h5"
UNMATCHED = np.array([[1.5, 2.5]])


def pairs(world: World) -> Iterator[tuple[str, str, Any, Any, Any]]:
    """Yield names of photo and crop, their pixels as hloc counts them, and the crop's size."""
    rows = zip(world.ids, world.query_xy, world.map_xy, world.truth.crops, strict=True)
    for one, query_xy, map_xy, crop in rows:
        stem = one.split("/", 1)[1]
        names = f"photos/{stem}.png", f"matching/crops/{stem}_dom.tif"
        yield *names, query_xy - 0.5, map_xy - crop[:2] - 0.5, crop[2:]


def write(folder: Path, world: World, **options: Any) -> Path:
    """Write a folder of sparse features and matches."""
    return write_sparse(folder / "hloc", world, **options)


def write_sparse(
    folder: Path,
    world: World,
    *,
    dtype: Any = np.float32,
    swapped: bool = False,
    joined: str = "/",
    libver: str = "latest",
) -> Path:
    folder.mkdir()
    with (
        h5py.File(folder / FEATURES, "w", libver=libver) as features,
        h5py.File(folder / MATCHES, "w", libver=libver) as matches,
    ):
        for photo, crop, query_xy, map_xy, size in pairs(world):
            camera = (640, 480)
            _features(features, photo, np.vstack([query_xy, UNMATCHED]), camera, dtype)
            # The crop has them in another order.
            order = np.random.default_rng(1).permutation(len(map_xy))
            _features(features, crop, np.vstack([UNMATCHED, map_xy[order]]), size, dtype)
            to_crop = np.append(np.argsort(order) + 1, -1)
            to_photo = np.append(-1, order)
            names = (crop, photo) if swapped else (photo, crop)
            group = matches.create_group(joined.join(n.replace("/", "-") for n in names))
            found = (to_photo if swapped else to_crop).astype(np.int16)
            group.create_dataset("matches0", data=found)
            group.create_dataset("matching_scores0", data=np.ones(len(found), np.float16))
    return folder


def _features(file: Any, name: str, xy: Any, size: Any, dtype: Any) -> None:
    group = file.create_group(name)
    group.create_dataset("keypoints", data=xy.astype(dtype))
    group["keypoints"].attrs["uncertainty"] = 1.0
    group.create_dataset("descriptors", data=np.zeros((8, len(xy)), np.float16))
    group.create_dataset("scores", data=np.ones(len(xy), np.float16))
    group.create_dataset("image_size", data=np.array(size, np.int64))


def write_dense(folder: Path, world: World, *, scale: float = 1.0) -> Path:
    """Write matches of match_dense, whose matches0 count keypoints of a file that is not there."""
    path = folder / "matches-loftr.h5"
    with h5py.File(path, "w") as file:
        for photo, crop, query_xy, map_xy, _ in pairs(world):
            group = file.create_group("/".join(n.replace("/", "-") for n in (photo, crop)))
            group.create_dataset("keypoints0", data=((query_xy + 0.5) * scale - 0.5))
            group.create_dataset("keypoints1", data=map_xy)
            group.create_dataset("scores", data=np.ones(len(query_xy), np.float32))
            group.create_dataset("matches0", data=np.full(9, -1, np.int32))
    return path
