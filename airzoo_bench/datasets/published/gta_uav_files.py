"""The files of GTA-UAV: lists of drone images with the satellite tiles that answer them."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, TypeGuard

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.plurals import counted
from airzoo_bench.datasets.published.image_scene import ImageScene
from airzoo_bench.retrieval.stated_truth import ImageSet, StatedPairs

__all__ = ["DroneImage", "Pair", "read_pairs", "scene_of_pairs", "tile_centre"]

_MOST_BYTES = 1 << 30
_MAP_PX, _TILE_PX, _GSD_M = 24_576, 256, 0.45
_TILE_NAME = re.compile(r"(\d{1,2})_(\d{1,3})_(\d{1,5})_(\d{1,5})\.png", re.IGNORECASE)
_KINDS = {"positive": "pair_pos_sate", "semi_positive": "pair_pos_semipos_sate"}
_NEAR_M = 0.01
_LARGEST = 1e9
_KEYS = (
    *("drone_img_dir", "drone_img_name", "drone_loc_x_y", "sate_img_dir"),
    *(f"{kind}_{part}_list" for kind in _KINDS.values() for part in ("img", "weight", "loc_x_y")),
)


@dataclass(frozen=True)
class Pair:
    """A satellite tile that a drone image overlaps."""

    tile: str
    weight: float
    position: tuple[float, float]


@dataclass(frozen=True)
class DroneImage:
    """An entry of a list.

    Attributes
    ----------
    image : str
        The file, relative to the benchmark.
    position : tuple of float
        In metres of the game's map.
    positive, all_pairs : list of Pair
        Tiles that answer it, and these with the semi-positive ones.
    """

    name: str
    image: str
    tiles: str
    position: tuple[float, float]
    height_m: float | None
    positive: list[Pair]
    all_pairs: list[Pair]


def tile_centre(name: str) -> tuple[float, float]:
    """Return where the centre of a tile is, in metres, by its name ``zoom_offset_x_y.png``.

    Raises
    ------
    ValueError
        The name is none of a tile.

    Examples
    --------
    >>> [round(axis, 6) for axis in tile_centre("4_0_6_13.png")]
    [4492.8, 9331.2]
    """
    found = _TILE_NAME.fullmatch(name)
    if found is None:
        raise ValueError(name)
    zoom, offset, x, y = map(int, found.groups())
    side = _MAP_PX / 2**zoom
    east, south = (side * (index + 1 / 2 + offset / _TILE_PX) * _GSD_M for index in (x, y))
    return east, south


def read_pairs(path: Path) -> list[DroneImage]:
    """Read a list of drone images.

    Raises
    ------
    BenchmarkError
        It is missing, cut short, or an entry is not as the benchmark has it.
    """
    if not path.is_file():
        raise BenchmarkError(
            "no such list of pairs",
            where=path,
            fix="download it into that folder, or choose scenes that are there with --scene",
        )
    text = read_text(path, BenchmarkError, "list of pairs", _MOST_BYTES)
    try:
        entries = json.loads(text.removeprefix("\ufeff"))
    except (ValueError, RecursionError) as error:
        raise BenchmarkError(
            f"not valid JSON: {error}",
            where=path,
            expected="a list, an entry a drone image",
            fix="download it again: it may be cut short",
        ) from error
    if not isinstance(entries, list) or not entries:
        raise _odd(path, f"holds {type(entries).__name__}, or nothing", "a list of entries")
    found = [_entry(path, number, entry) for number, entry in enumerate(entries, start=1)]
    names = [one.name for one in found]
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise _odd(path, f"several entries of one image: {first_of(twice)}", "each image once")
    return found


def _entry(path: Path, number: int, entry: Any) -> DroneImage:
    lacking = [key for key in _KEYS if key not in entry] if isinstance(entry, dict) else _KEYS
    if lacking:
        has = f"it has {', '.join(map(str, entry))}" if isinstance(entry, dict) else "no table"
        raise _odd(path, f"entry {number} lacks {', '.join(lacking)}; {has[:200]}", str(_KEYS))
    texts = [entry[key] for key in ("drone_img_name", "drone_img_dir", "sate_img_dir")]
    if not all(_is_name(text) for text in texts):
        raise _odd(path, f"entry {number} has the names {texts!r}"[:200], "names of files")
    name, home, tiles = texts
    position = _position(entry["drone_loc_x_y"])
    if position is None:
        raise _odd(path, f"entry {number}: drone_loc_x_y is none", "two numbers, in metres")
    metadata = entry.get("drone_metadata")
    height = metadata.get("height") if isinstance(metadata, dict) else None
    positive, every = (_pairs(path, number, entry, kind) for kind in _KINDS.values())
    return DroneImage(
        name,
        f"{home}/{name}",
        tiles,
        position,
        float(height) if _is_finite(height) else None,
        positive,
        every,
    )


def _is_name(text: object) -> bool:
    parts = text.replace("\\", "/").split("/") if isinstance(text, str) else [".."]
    return all(part.isprintable() and part not in ("", "..") for part in parts)


def _position(value: object) -> tuple[float, float] | None:
    if not (isinstance(value, list) and len(value) == 2):
        return None
    x, y = value
    return (float(x), float(y)) if _is_finite(x) and _is_finite(y) else None


def _is_finite(value: object) -> TypeGuard[float]:
    """Whether it is a number that a float can hold; JSON's integers may be larger."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return -_LARGEST <= value <= _LARGEST


def _pairs(path: Path, number: int, entry: dict[str, Any], kind: str) -> list[Pair]:
    keys = [f"{kind}_{part}_list" for part in ("img", "weight", "loc_x_y")]
    lists = [entry[key] for key in keys]
    if not all(isinstance(one, list) for one in lists) or len({len(one) for one in lists}) != 1:
        raise _odd(path, f"entry {number}: {', '.join(keys)} differ in length", "lists alike")
    found = []
    for tile, weight, place in zip(*lists, strict=True):
        position = _position(place)
        is_weight = isinstance(weight, int | float) and 0 <= weight <= 1
        if not (_is_name(tile) and is_weight and position is not None):
            said = f"entry {number}, {kind}: {tile!r}, {weight!r}, {place!r}"
            raise _odd(path, said[:200], "a tile's name, a weight from 0 to 1, two numbers")
        found.append(Pair(tile, float(weight), position))
    if len({pair.tile for pair in found}) < len(found):
        raise _odd(path, f"entry {number}: {keys[0]} names a tile twice", "each tile once")
    return found


def _odd(path: Path, what: str, expected: str) -> BenchmarkError:
    return BenchmarkError(what, where=path, expected=expected, fix="download it again")


def scene_of_pairs(root: Path, entries: Sequence[DroneImage], *, backwards: bool) -> ImageScene:
    """Lay out a list as a scene: drone images ask for tiles, or tiles for drone images.

    As Game4Loc does it, images without a positive tile ask nothing, all tiles there are the
    gallery, and backwards only the tiles that answer an image ask.

    Raises
    ------
    BenchmarkError
        Images or tiles of the list are missing, or a tile is not where its name says.
    """
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
