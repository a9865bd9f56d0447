"""Matches a file a pair, written as each matcher's call returns them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.matching.world import SIZE, World

READER = "loftr"

TENSOR = (320, 224)  # another ratio than the photo's: both axes are stretched


class Pair(NamedTuple):
    """A photo and its crop: stem of the photo's name, pixels from the corner, sizes."""

    stem: str
    query_xy: Any
    map_xy: Any
    sizes: tuple[tuple[int, int], tuple[int, int]]


def pairs(world: World) -> Iterator[Pair]:
    rows = zip(world.ids, world.query_xy, world.map_xy, world.truth.crops.tolist(), strict=True)
    for one, query_xy, map_xy, (x, y, width, height) in rows:
        yield Pair(one.split("/", 1)[1], query_xy, map_xy - (x, y), (SIZE, (width, height)))


def write(folder: Path, world: World, **fields: Any) -> Path:
    """Write LoFTR's, as `write_loftr` does."""
    return write_loftr(folder, world, **fields)


def write_loftr(folder: Path, world: World, **fields: Any) -> Path:
    home = _made(folder / "loftr")
    for pair in pairs(world):
        first, second = _shrunk(pair)
        sizes = {"image_size0": TENSOR, "image_size1": TENSOR} | fields
        np.savez(
            home / f"{pair.stem}.npz",
            mkpts0_f=first,
            mkpts1_f=second,
            mconf=np.ones(len(first), np.float32),
            **{name: value for name, value in sizes.items() if value is not None},
        )
    return home


def write_superglue(folder: Path, world: World, *, stated: bool = True) -> Path:
    """Write what its script writes, and sizes of the pictures, which that does not."""
    home = _made(folder / "superglue")
    sizes = {"image_size0": TENSOR, "image_size1": TENSOR} if stated else {}
    for pair in pairs(world):
        first, second = _shrunk(pair)
        count = len(first)
        np.savez(
            home / f"{pair.stem}_{pair.stem}_dom_matches.npz",
            keypoints0=np.vstack([first, [[1, 1]]]),
            keypoints1=second[::-1],
            matches=np.append(np.arange(count)[::-1], -1),
            match_confidence=np.ones(count + 1),
            **sizes,
        )
    return home


def write_roma(folder: Path, world: World, *, pixels: bool = False) -> Path:
    home = _made(folder / "roma")
    for pair in pairs(world):
        sides = zip((pair.query_xy, pair.map_xy), pair.sizes, strict=True)
        parts = [xy if pixels else 2 * xy / size - 1 for xy, size in sides]
        np.savez(
            home / f"{pair.stem}.npz",
            matches=np.hstack(parts),
            certainty=np.ones(len(pair.query_xy), np.float32),
        )
    return home


def write_dust3r(folder: Path, world: World, *, size: int = 512, stated: int | None = 512) -> Path:
    """Write pixels of `load_images`; not rounded to whole ones, so that the truth comes back."""
    home = _made(folder / "dust3r")
    for pair in pairs(world):
        sides = zip((pair.query_xy, pair.map_xy), pair.sizes, strict=True)
        first, second = (_loaded(xy, one, size) for xy, one in sides)
        said = {} if stated is None else {"size": stated}
        np.savez(home / f"{pair.stem}.npz", matches_im0=first, matches_im1=second, **said)
    return home


def _loaded(xy: Any, wide_high: tuple[int, int], size: int) -> Any:
    """What dust3r/utils/image.py does to a picture, done to its pixels."""
    width, height = wide_high
    scale = size / max(width, height)
    small = (round(width * scale), round(height * scale))
    cx, cy = small[0] // 2, small[1] // 2
    half_w, half_h = ((2 * cx) // 16) * 8, ((2 * cy) // 16) * 8
    if small[0] == small[1]:
        half_h = int(3 * half_w / 4)
    return xy * (small[0] / width, small[1] / height) - (cx - half_w, cy - half_h) - 0.5


def write_mast3r_visloc(folder: Path, world: World) -> Path:
    home = folder / "matches" / "tol_5"
    for pair in pairs(world):
        np.savez(
            _made(home / f"{pair.stem}.png") / f"{pair.stem}_dom.tif.npz",
            valid_pts3d=np.zeros((len(pair.query_xy), 3), np.float32),
            matches_im_query=pair.query_xy - 0.5,
            matches_im_map=pair.map_xy - 0.5,
            matches_conf=np.ones(len(pair.query_xy)),
        )
    return home


def _shrunk(pair: Pair) -> list[Any]:
    sides = zip((pair.query_xy, pair.map_xy), pair.sizes, strict=True)
    return [xy * np.divide(TENSOR, size) - 0.5 for xy, size in sides]


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder
