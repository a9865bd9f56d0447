"""The lists of GTA-UAV: drone images with the satellite tiles that answer them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.core.files import read_text

__all__ = ["DroneImage", "Pair", "read_pairs"]

_MOST_BYTES = 1 << 30
_KINDS = {"positive": "pair_pos_sate", "semi_positive": "pair_pos_semipos_sate"}
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


def read_pairs(path: Path) -> list[DroneImage]:
    """Read a list of drone images."""
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
