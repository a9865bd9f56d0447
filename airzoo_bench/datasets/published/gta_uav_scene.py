"""A list of GTA-UAV as a scene: drone images, tiles, and whether both are where the list says."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from statistics import median

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, counted, first_of
from airzoo_bench.datasets.published.gta_uav_files import DroneImage, Pair
from airzoo_bench.datasets.published.image_scene import ImageScene
from airzoo_bench.retrieval.stated_truth import ImageSet, StatedPairs

__all__ = ["scene_of_pairs", "tile_centre"]

_MAP_PX, _TILE_PX, _GSD_M = 24_576, 256, 0.45
_TILE_NAME = re.compile(r"(\d{1,2})_(\d{1,3})_(\d{1,5})_(\d{1,5})\.png", re.IGNORECASE)
_NEAR_M = 0.01


def tile_centre(name: str) -> tuple[float, float]:
    """Return where the centre of a tile is, in metres, by its name ``zoom_offset_x_y.png``."""
    found = _TILE_NAME.fullmatch(name)
    if found is None:
        raise ValueError(name)
    zoom, offset, x, y = map(int, found.groups())
    side = _MAP_PX / 2**zoom
    east, south = (side * (index + 1 / 2 + offset / _TILE_PX) * _GSD_M for index in (x, y))
    return east, south


def scene_of_pairs(root: Path, entries: Sequence[DroneImage], *, backwards: bool) -> ImageScene:
    """Lay out a list as a scene: drone images ask for tiles, or tiles for drone images."""
    drones = sorted((e for e in entries if e.positive), key=lambda e: e.name)
    if not drones:
        raise BenchmarkError("no entry of the list has a positive tile", where=root)
    home = root / drones[0].tiles
    there = _tiles_below(home)
    _check_there(home, {pair.tile for one in drones for pair in _stated(one)}, there)
    _check_images(root, [one.image for one in drones])
    _check_positions(home, drones)
    _check_places(root, drones)
    answers = {pair.tile for one in drones for pair in one.positive}
    names = sorted(answers if backwards else there)
    row = {name: number for number, name in enumerate(names)}
    tiles = ImageSet(
        [Path(name).stem for name in names],
        [there[name] for name in names],
        np.array([tile_centre(name) for name in names]),
    )
    heights = [math.nan if one.height_m is None else round(one.height_m, 3) for one in drones]
    images = ImageSet(
        [Path(one.name).stem for one in drones],
        [one.image for one in drones],
        np.array([one.position for one in drones]),
        conditions={} if backwards or np.isnan(heights).any() else {"height_m": heights},
    )
    pairs = [
        (number, row[pair.tile], pair.tile in positive, pair.weight)
        for number, one in enumerate(drones)
        for positive in [{pair.tile for pair in one.positive}]
        for pair in _every_pair(one)
        if pair.tile in row
    ]
    drone, tile, positive, weight = (np.array(column) for column in zip(*pairs, strict=True))
    if backwards:
        return ImageScene(tiles, images, home, root, StatedPairs(tile, drone, positive, weight))
    return ImageScene(images, tiles, root, home, StatedPairs(drone, tile, positive, weight))


def _every_pair(one: DroneImage) -> list[Pair]:
    """Return all pairs once; positive ones that are missing among all are added."""
    return list({pair.tile: pair for pair in (*one.positive, *one.all_pairs)}.values())


def _stated(one: DroneImage) -> list[Pair]:
    """Return the pairs of both lists, as they stand there."""
    return [*one.positive, *one.all_pairs]


def _tiles_below(folder: Path) -> dict[str, str]:
    """Return the files of the tiles, relative to their folder, by name."""
    if not folder.is_dir():
        raise BenchmarkError("no such folder of tiles", where=folder, fix="unpack it there")
    found: dict[str, str] = {}
    odd = []
    for home, _, names in os.walk(folder):
        for name in names:
            if _TILE_NAME.fullmatch(name):
                found[name] = Path(home, name).relative_to(folder).as_posix()
            elif name.lower().endswith((".png", ".part", ".zip")):
                odd.append(name)
    if odd or not found:
        raise BenchmarkError(
            f"names that are none of a tile: {first_of(sorted(odd))}" if odd else "holds no tile",
            where=folder,
            expected="zoom_offset_x_y.png, such as 4_0_6_13.png",
            fix="finish the download, or move other files elsewhere",
        )
    return found


def _check_there(folder: Path, wanted: set[str], there: dict[str, str]) -> None:
    lacking = sorted(wanted - set(there))
    if lacking:
        raise BenchmarkError(
            f"tiles of the list are missing: {first_of(lacking, len(wanted))}",
            where=folder,
            fix="finish the download, or unpack it again",
        )


def _check_images(root: Path, images: Sequence[str]) -> None:
    names: dict[str, set[str]] = {}
    for home in {image.rpartition("/")[0] for image in images}:
        folder = root / home
        names[home] = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    lacking = [
        image for image in images if image.rpartition("/")[2] not in names[image.rpartition("/")[0]]
    ]
    if lacking:
        raise BenchmarkError(
            f"drone images of the list are missing: {first_of(lacking, len(images))}",
            where=root,
            fix="finish the download, or unpack it again",
        )


def _check_positions(folder: Path, drones: Sequence[DroneImage]) -> None:
    """Hold the positions of the list to those that the tiles' names say."""
    for one in drones:
        for pair in _stated(one):
            apart = math.dist(pair.position, tile_centre(pair.tile))
            if apart > _NEAR_M:
                raise BenchmarkError(
                    f"tile {pair.tile} is at {pair.position} by the list of {one.name}, "
                    f"{apart:.1f} m from where its name says",
                    where=folder,
                    expected=f"the centre {tile_centre(pair.tile)}",
                    fix=f"this list is of another map: {counted(len(drones), 'image')} read",
                )


def _check_places(root: Path, drones: Sequence[DroneImage]) -> None:
    """Refuse drone images that are (median) farther than a tile's side from tiles they overlap."""
    sides = [
        max(abs(a - b) for a, b in zip(one.position, pair.position, strict=True))
        / _side_m(pair.tile)
        for one in drones
        for pair in one.positive
    ]
    if median(sides) > 1.0:
        raise BenchmarkError(
            f"drone images are {median(sides):.3g} sides of a tile from the tiles that they "
            "overlap (median)",
            where=root,
            expected="drone_loc_x_y in metres of the game's map, at most one side from these tiles",
            fix="look whether x and y are swapped; download the lists again",
        )


def _side_m(name: str) -> float:
    side_m: float = _MAP_PX * _GSD_M / 2.0 ** int(name.partition("_")[0])
    return side_m
