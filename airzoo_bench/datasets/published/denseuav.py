"""DenseUAV: low flights over universities, densely sampled, with GPS."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.published.image_benchmark import DIRECTIONS, ImageBenchmark
from airzoo_bench.datasets.published.image_scene import ImageScene

if TYPE_CHECKING:
    from collections.abc import Sequence

    from airzoo_bench.datasets.published.class_folders import ClassImage
    from airzoo_bench.geometry.arrays import Floats

__all__ = ["DENSEUAV", "DenseUav", "class_positions"]

_POSITIONS = "Dense_GPS_ALL.txt"
_MOST_BYTES = 64 << 20
_MOST_SHARED = 0.1
_FARTHEST_M = 200.0
_LINE = "test/query_drone/000001/H80.JPG E120.387 N30.324 93.2"


class DenseUav(ImageBenchmark):
    """See `ImageBenchmark`; a class is a place, and has one position."""

    summary = (
        "DenseUAV, both ways between drone and satellite: images of one place answer each other, "
        "and near places count in SDM@K and MA@K."
    )
    example = "denseuav --source DenseUAV"
    name = "denseuav"
    about = About(
        title="DenseUAV",
        page="https://github.com/Dmmm1997/DenseUAV",
        licence="Apache 2.0 for the code; none stated for the images",
        repository="Dmmm997/DenseUAV",
        assumptions=(
            f"The position of a class is that of its last line in {_POSITIONS}, as in the authors' "
            "code.",
        ),
        unverified=(
            "The tree was not seen; it is that of the authors' README, test.py and "
            "evaluateDistance.py.",
        ),
    )
    protocols = tuple(f"denseuav-{direction}" for direction in DIRECTIONS)
    gallery_sizes: ClassVar[dict[str, int]] = {
        "drone-to-satellite": 18_198,
        "satellite-to-drone": 9_099,
    }

    def root(self, source: Path) -> Path:
        """Find the folder that holds the positions and test/."""
        from airzoo_bench.datasets.published.class_folders import find_root

        return find_root(
            source,
            ("",),
            lambda folder: (folder / "test").is_dir() and (folder / _POSITIONS).exists(),
            f"{_POSITIONS}, and test/ with query_drone, gallery_satellite, query_satellite, "
            "gallery_drone, each with a folder a class",
        )

    def read(self, root: Path, scene: str) -> ImageScene:
        """Pair a direction's folders by class, and place each class."""
        from dataclasses import replace

        from airzoo_bench.datasets.published.class_folders import (
            class_images,
            image_set,
            scene_of_classes,
        )

        asked, _, given = scene.split("-")
        positions, moved = class_positions(root / _POSITIONS)
        _check_places(root / _POSITIONS, positions)
        sets = []
        for name in (f"query_{asked}", f"gallery_{given}"):
            home = root / "test" / name
            found = class_images(home)
            places = _placed(root / _POSITIONS, home, found, positions)
            sets.append((home, found, image_set(found, places)))
        notes = []
        if moved:
            notes.append(
                f"classes whose lines in {_POSITIONS} differ, of which the last is taken: "
                f"{first_of(moved)}"
            )
        return replace(scene_of_classes(*sets), notes=tuple(notes))


def class_positions(path: Path) -> tuple[dict[str, tuple[float, float]], list[str]]:
    """Read longitude and latitude of each class, and which classes have several."""
    from airzoo_bench.core.files import read_text

    text = read_text(path, BenchmarkError, "list of positions", _MOST_BYTES)
    found: dict[str, tuple[float, float]] = {}
    moved: dict[str, None] = {}
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), start=1):
        if not line.strip():
            continue
        label, position = _read_line(path, number, line)
        if found.get(label, position) != position:
            moved[label] = None
        found[label] = position
    if not found:
        raise BenchmarkError("holds no line", where=path, expected=_LINE)
    return found, list(moved)


def _read_line(path: Path, number: int, line: str) -> tuple[str, tuple[float, float]]:
    parts = line.split()
    folders = parts[0].replace("\\", "/").split("/") if parts else []
    degrees = [_degrees(part, mark) for part, mark in zip(parts[1:3], "EN", strict=False)]
    label = folders[-2] if len(folders) > 1 else ""
    known = [value for value in degrees if value is not None]
    if len(known) != len("EN") or not (label.isascii() and label.isdigit()):
        raise BenchmarkError(
            f"line {number} is {line[:80]!r}",
            where=path,
            expected=f"such as {_LINE}, with blanks between and points in numbers",
            fix="download it again, or correct the line",
        )
    lon, lat = known
    return str(int(label)), (lon, lat)


def _degrees(text: str, mark: str) -> float | None:
    """Return ``E120.5`` or ``N30.2`` as a number; None where it is none of a place in the east."""
    if not text.startswith(mark):
        return None
    try:
        value = float(text[1:])
    except ValueError:
        return None
    return value if 0.0 <= value <= (180.0 if mark == "E" else 90.0) else None


def _check_places(path: Path, positions: dict[str, tuple[float, float]]) -> None:
    """Refuse positions that are too coarse to tell classes apart, or not on one campus's scale."""
    import numpy as np

    from airzoo_bench.geometry.crs import geodesic_distance_m

    labels = sorted(positions, key=int)
    places = np.array([positions[label] for label in labels])
    shared = len(places) - len(np.unique(places, axis=0))
    apart = geodesic_distance_m(places[1:], places[:-1])
    if shared > _MOST_SHARED * len(places):
        what = f"{shared} of {len(places)} classes have the position of another"
    elif len(apart) and np.median(apart) > _FARTHEST_M:
        what = f"classes are {np.median(apart):,.0f} m from the next one (median)"
    else:
        return
    raise BenchmarkError(
        what,
        where=path,
        expected="a position of its own for each class, some 20 m from the next",
        fix="download it again: positions may be rounded",
    )


def _placed(
    path: Path,
    home: Path,
    images: Sequence[ClassImage],
    positions: dict[str, tuple[float, float]],
) -> Floats:
    """Return the position (N, 2) of each image."""
    import numpy as np

    lacking = sorted({image.label for image in images} - set(positions), key=int)
    if lacking:
        raise BenchmarkError(
            f"no position of classes of {home}: {first_of(lacking)}",
            where=path,
            expected="a line for an image of each class",
            fix="download it again",
        )
    return np.array([positions[image.label] for image in images], np.float64)


DENSEUAV = DenseUav()
