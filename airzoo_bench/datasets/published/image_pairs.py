"""Benchmarks of images that state their pairs: University-1652, SUES-200, DenseUAV, GTA-UAV.

A scene is a direction, drone-to-satellite or satellite-to-drone: images of a view ask, those of the
other are the gallery. In folders of classes, images of one class answer each other; GTA-UAV lists
drone images and tiles of a game's map that overlap.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from airzoo_bench.core.errors import BenchmarkError, first_of, readable
from airzoo_bench.core.files import read_text
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.published.places import find_home, folders_in, missing, published_scenes
from airzoo_bench.datasets.scenes import ImageScene
from airzoo_bench.datasets.settings import SourceOptions
from airzoo_bench.datasets.tables import read_native_text
from airzoo_bench.formats.photos import PHOTO_SUFFIXES
from airzoo_bench.retrieval.truth import POSITION_COLUMNS

_DIRECTIONS = ("drone-to-satellite", "satellite-to-drone")
_SUFFIXES = (*PHOTO_SUFFIXES, ".ppm", ".bmp", ".pgm", ".webp")  # those of torchvision
_HEIGHTS = ("150", "200", "250", "300")
_FOLDERS = ("query_drone", "gallery_satellite", "query_satellite", "gallery_drone")
# The 120 classes of SUES-200's training split, by the authors' script/indexs.yaml.
_NUMBERS = (
    "1 2 3 4 5 6 7 9 10 11 13 15 16 20 21 24 25 26 27 28 29 30 31 32 33 34 36 37 39 43 44 45 "
    "51 55 56 57 58 60 64 66 67 69 70 73 74 76 77 80 81 82 84 85 86 87 88 89 90 91 94 96 97 "
    "100 101 102 103 104 105 106 113 116 118 119 120 123 125 126 127 129 132 134 137 139 141 "
    "142 145 146 147 148 149 151 152 155 156 157 158 159 160 163 166 167 168 169 171 174 179 "
    "180 182 183 184 185 186 187 191 192 193 196 197 198 199 200"
)
_TRAINING = frozenset(_NUMBERS.split())
_POSITIONS = "Dense_GPS_ALL.txt"
_POSITION = re.compile(r"(?:\S*/)?(\d+)/\S+\s+E(\d+\.?\d*)\s+N(\d+\.?\d*)(?:\s|$)", re.ASCII)

Place = tuple[float, float]


class ClassImage(NamedTuple):
    """An image: its class, without leading zeros; the end of its id; its file in the folder."""

    label: str
    name: str
    image: str


class ClassFolders(Dataset[SourceOptions]):
    """A benchmark with images in folders ``query_VIEW/CLASS`` and ``gallery_VIEW/CLASS``.

    They may stand in one of `places` below the source. `gallery_sizes` are the published numbers of
    images of each direction's gallery.
    """

    places: Sequence[str] = ("", "test")
    layout = f"test/ with {', '.join(_FOLDERS)}, each with a folder a class"
    gallery_sizes: tuple[int, int]

    def is_home(self, folder: Path) -> bool:
        """Return whether a folder holds the benchmark's images."""
        return any((folder / name).is_dir() for name in _FOLDERS)

    def home(self, source: Path) -> Path:
        """Return the folder that holds the benchmark's images."""
        is_home = self.is_home
        found = find_home(source, lambda f: any(is_home(f / p) for p in self.places), self.layout)
        return next(found / place for place in self.places if is_home(found / place))

    def scenes(self, options: SourceOptions) -> Mapping[str, Sequence[Path]]:
        """Return all scenes of the protocols."""
        home = self.home(options.source)
        return {scene: [home] for name in self.protocols for scene in published_scenes(name)}

    def sets(self, home: Path, scene: str) -> list[tuple[Path, list[ClassImage]]]:
        """Return the folders of queries and gallery, with their images."""
        asked, _, given = scene.split("-")[-3:]
        folders = [home / f"query_{asked}", home / f"gallery_{given}"]
        return [(folder, class_images(folder)) for folder in folders]

    def read(self, options: SourceOptions, scene: str, progress: Progress) -> ImageScene:
        """Pair queries and gallery by their classes."""
        home = self.home(options.source)
        (asked, queries), (given, gallery) = self.sets(home, scene)
        labels = [[image.label for image in images] for images in (queries, gallery)]
        positions = self.positions(home)
        answered = set(labels[1]) if positions is None else set(labels[1]) & set(positions)
        lacking = sorted(set(labels[0]) - answered, key=int)
        if lacking:
            what = f"lacks classes of {asked.name}: {first_of(lacking)}"
            raise missing(what, given, "every class of the queries, and its position if there are")
        return ImageScene(
            scene,
            _image_table(scene, queries, positions),
            _image_table(scene, gallery, positions),
            asked,
            given,
            pairs_of_labels(*labels),
            self.gallery_sizes[scene.endswith(_DIRECTIONS[1])],
        )

    def positions(self, home: Path) -> Mapping[str, Place] | None:
        """Return longitude and latitude by class, where the benchmark has them."""
        return None


def class_images(folder: Path, below: str = "") -> list[ClassImage]:
    """List the images of all class folders, or of a folder in each, sorted by class and name."""
    layout = f"a folder a class, named by a whole number, with images ending in {_SUFFIXES}"
    found: list[ClassImage] = []
    for home in (path for path in folders_in(folder) if not path.name.startswith((".", "__"))):
        files = sorted((home / below).iterdir()) if (home / below).is_dir() else []
        images = [one for one in files if one.suffix.lower() in _SUFFIXES and one.name[0] != "."]
        if not re.fullmatch("[0-9]+", home.name) or not images:
            raise missing(f"{home.name!r} is no class with images", home / below, layout)
        for one in images:
            name = f"{home.name}/{one.stem}"
            found.append(ClassImage(str(int(home.name)), name, str(one.relative_to(folder))))
    if not found:
        raise missing("holds no class folder", folder, layout, "unpack it there")
    return found


def _image_table(
    scene: str, images: Sequence[ClassImage], positions: Mapping[str, Place] | None
) -> pd.DataFrame:
    ids = [f"{scene}/{image.name}" for image in images]
    table = pd.DataFrame({"id": ids, "image": [image.image for image in images]})
    if positions is not None:
        nowhere = (np.nan, np.nan)
        places = [positions.get(image.label, nowhere) for image in images]
        table[list(POSITION_COLUMNS[0])] = np.array(places, np.float64)
    return table


def pairs_of_labels(queries: Sequence[str], gallery: Sequence[str]) -> pd.DataFrame:
    """Pair each query with all images of its class."""
    photos = pd.DataFrame({"label": [*map(str, queries)]}).reset_index(names="query")
    images = pd.DataFrame({"label": [*map(str, gallery)]}).reset_index(names="tile")
    return photos.merge(images, on="label").assign(positive=True)


class _University1652(ClassFolders):
    """University-1652; street views are not read."""

    name = "university-1652"
    about = load_about("university-1652")
    protocols = tuple(f"university-1652-{direction}" for direction in _DIRECTIONS)
    gallery_sizes = (951, 51_355)


class _Sues200(ClassFolders):
    """SUES-200; a scene is a height in a direction."""

    name = "sues-200"
    about = load_about("sues-200")
    protocols = tuple(f"sues-200-{direction}" for direction in _DIRECTIONS)
    gallery_sizes = (200, 10_000)
    places = ("Testing", "Dataset/Testing", "Datasets/Testing", "")
    layout = (
        "as downloaded: a folder with 'drone' in its name (drone_view_512/0001/150/...) and one "
        "with 'satellite' (satellite-view/0001/...); or as the authors' split_datasets.py leaves "
        "it: Testing/150/query_drone/0001/... and so on"
    )

    def is_home(self, folder: Path) -> bool:
        split = any((folder / height / "query_drone").is_dir() for height in _HEIGHTS)
        return split or len(_views(folder)) == len(_DIRECTIONS)

    def sets(self, home: Path, scene: str) -> list[tuple[Path, list[ClassImage]]]:
        height, asked, _, given = scene.split("-")
        views = _views(home)
        if len(views) < len(_DIRECTIONS):
            return super().sets(home / height, scene)
        folders = [home / views[asked], home / views[given]]
        below = [height if view == "drone" else "" for view in (asked, given)]
        queries, gallery = map(class_images, folders, below)
        tested = [image for image in queries if image.label not in _TRAINING]
        return [(folders[0], tested), (folders[1], gallery)]


def _views(folder: Path) -> dict[str, str]:
    """Return the folders of the two views, by the words that are in their names."""
    names = [path.name for path in folders_in(folder)]
    found = {view: [n for n in names if view in n.lower()] for view in ("drone", "satellite")}
    return {view: few[0] for view, few in found.items() if len(few) == 1}


class _DenseUav(ClassFolders):
    """DenseUAV; a class is a place, and has one position."""

    name = "denseuav"
    about = load_about("denseuav")
    protocols = tuple(f"denseuav-{direction}" for direction in _DIRECTIONS)
    gallery_sizes = (18_198, 9_099)
    places = ("test",)
    layout = f"{_POSITIONS}, and {ClassFolders.layout}"

    def is_home(self, folder: Path) -> bool:
        return folder.is_dir() and (folder.parent / _POSITIONS).exists()

    def positions(self, home: Path) -> Mapping[str, Place]:
        path, found = home.parent / _POSITIONS, dict[str, Place]()
        for number, line in enumerate(read_native_text(path).splitlines(), start=1):
            match = _POSITION.match(line.replace("\\", "/"))
            if match is not None:
                found[str(int(match[1]))] = (float(match[2]), float(match[3]))
            elif line.strip():
                expected = "such as test/query_drone/000001/H80.JPG E120.387 N30.324 93.2"
                where = f"{path}, line {number}"
                raise BenchmarkError(f"is {line[:80]!r}", where=where, expected=expected)
        return found


_AREAS = ("cross-area", "same-area")
_LISTS = {area: f"{area}-drone2sate-test.json" for area in _AREAS}
_LAYOUT = f"{', '.join(_LISTS.values())}, drone/images/ and satellite/"
_TILES, _MOST_BYTES = 14_640, 1 << 30
_MAP_PX, _TILE_PX, _GSD_M = 24_576, 256, 0.45
_TILE_NAME = re.compile(r"(\d{1,2})_(\d{1,3})_(\d{1,5})_(\d{1,5})\.png", re.IGNORECASE)


class _Drone(NamedTuple):
    """A drone image: its file, place, the tiles that answer it, and all with their overlaps."""

    name: str
    image: str
    place: Place
    positive: frozenset[str]
    weights: Mapping[str, float]
    height_m: float
    tiles: str  # the folder of all


class _GtaUav(Dataset[SourceOptions]):
    """GTA-UAV; a scene is a test list in a direction."""

    name = "gta-uav"
    about = load_about("gta-uav")
    protocols = tuple(f"gta-uav-{area}-{direction}" for area in _AREAS for direction in _DIRECTIONS)

    def scenes(self, options: SourceOptions) -> Mapping[str, Sequence[Path]]:
        home = _lists_home(options)
        return {f"{area}-{direction}": [home] for area in _AREAS for direction in _DIRECTIONS}

    def read(self, options: SourceOptions, scene: str, progress: Progress) -> ImageScene:
        home = _lists_home(options)
        drones = _read_drones(home / _LISTS[next(one for one in _AREAS if scene.startswith(one))])
        folder, backwards = home / drones[0].tiles, scene.endswith(_DIRECTIONS[1])
        there = {path.name: path.relative_to(folder).as_posix() for path in folder.rglob("*.png")}
        stated = {tile for one in drones for tile in one.weights}
        lacking = sorted(stated - there.keys())
        lacking += [one.image for one in drones if not (home / one.image).is_file()]
        odd = [name for name in there if not _TILE_NAME.fullmatch(name)]
        if lacking or odd:
            what = f"files of the list are missing, or are no tiles ({first_of(lacking + odd)})"
            raise missing(what, home, f"{_LAYOUT} with tiles such as 4_0_6_13.png")
        answers = {tile for one in drones for tile in one.positive}
        names = sorted(answers if backwards else there)
        row = {name: number for number, name in enumerate(names)}
        ids = [f"{scene}/{Path(name).stem}" for name in names]
        tiles = pd.DataFrame({"id": ids, "image": [there[name] for name in names]})
        tiles[list(POSITION_COLUMNS[1])] = [_tile_centre(name) for name in names]
        ids = [f"{scene}/{Path(one.name).stem}" for one in drones]
        images = pd.DataFrame({"id": ids, "image": [one.image for one in drones]})
        images[list(POSITION_COLUMNS[1])] = [one.place for one in drones]
        heights = [one.height_m for one in drones]
        if not (backwards or np.isnan(heights).any()):
            images["height_m"] = heights
        found = [
            (number, row[tile], tile in one.positive, weight)
            for number, one in enumerate(drones)
            for tile, weight in one.weights.items()
            if tile in row
        ]
        pairs = pd.DataFrame(found, columns=["query", "tile", "positive", "overlap"])
        if backwards:
            pairs = pairs.rename(columns={"query": "tile", "tile": "query"})
            return ImageScene(scene, tiles, images, folder, home, pairs)
        return ImageScene(scene, images, tiles, home, folder, pairs, _TILES)


def _lists_home(options: SourceOptions) -> Path:
    def is_home(folder: Path) -> bool:
        return any((folder / name).is_file() for name in _LISTS.values())

    return find_home(options.source, is_home, _LAYOUT)


def _read_drones(path: Path) -> list[_Drone]:
    """Read the drone images of a list that a tile answers, sorted by name."""
    text = read_text(path, BenchmarkError, "list of pairs", _MOST_BYTES)
    fix = "download the lists again: it may be cut short, or of another map"
    with readable(path, "is no list of GTA-UAV", kind=BenchmarkError, fix=fix):
        drones = [_drone(entry) for entry in json.loads(text.removeprefix("\ufeff"))]
        return sorted((one for one in drones if one.positive), key=lambda one: one.name)


def _drone(entry: Mapping[str, Any]) -> _Drone:
    weights: dict[str, float] = {}
    for kind in ("pair_pos", "pair_pos_semipos"):
        lists = (entry[f"{kind}_sate_{part}_list"] for part in ("img", "weight"))
        for tile, weight in zip(*lists, strict=True):
            weights[tile] = float(weight)
    height = (entry.get("drone_metadata") or {}).get("height", math.nan)
    image = f"{entry['drone_img_dir']}/{entry['drone_img_name']}"
    x, y = map(float, entry["drone_loc_x_y"])
    positive = frozenset(entry["pair_pos_sate_img_list"])
    height_m = round(float(height), 3)
    return _Drone(
        entry["drone_img_name"], image, (x, y), positive, weights, height_m, entry["sate_img_dir"]
    )


def _tile_centre(name: str) -> Place:
    """Return where the centre of a tile is, in metres, by its name ``zoom_offset_x_y.png``."""
    zoom, offset, x, y = map(int, Path(name).stem.split("_"))
    side = _MAP_PX / 2**zoom
    east, south = (side * (index + 1 / 2 + offset / _TILE_PX) * _GSD_M for index in (x, y))
    return east, south


UNIVERSITY_1652, SUES_200, DENSEUAV, GTA_UAV = _University1652(), _Sues200(), _DenseUav(), _GtaUav()
