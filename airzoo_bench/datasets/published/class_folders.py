"""Benchmarks of images in a folder a class: University-1652, SUES-200, DenseUAV.

A scene is a direction, drone-to-satellite or satellite-to-drone: images of a view ask, those of the
other are the gallery, and images of one class answer each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, counted, first_of
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.published.places import find_home, missing
from airzoo_bench.datasets.scenes import ImageScene
from airzoo_bench.datasets.settings import SourceOptions
from airzoo_bench.datasets.tables import read_native_text
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import geodesic_distance_m
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.retrieval.stated_truth import ImageSet, pairs_of_labels

__all__ = ["DENSEUAV", "DIRECTIONS", "SUES_200", "UNIVERSITY_1652", "ClassFolders"]

DIRECTIONS = ("drone-to-satellite", "satellite-to-drone")
"""Which view asks, and which is the gallery."""

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
_POSITION_LINE = "test/query_drone/000001/H80.JPG E120.387 N30.324 93.2"
_MOST_SHARED, _FARTHEST_M = 0.1, 200.0


@dataclass(frozen=True)
class ClassImage:
    """An image: its class, without leading zeros; what its id ends in; its file in the folder."""

    label: str
    name: str
    image: str


class ClassFolders(Dataset[SourceOptions]):
    """A benchmark whose images stand in folders ``query_VIEW/CLASS`` and ``gallery_VIEW/CLASS``.

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
        home, shipped = self.home(options.source), shipped_protocols()
        every = [load_protocol(shipped[name]).scenes for name in self.protocols]
        return {scene.id: [home] for scenes in every for scene in scenes}

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
        lacking = sorted(set(labels[0]) - set(labels[1]), key=int)
        if lacking:
            raise BenchmarkError(
                f"{counted(len(lacking), 'class', 'classes')} of the queries without an image: "
                f"{first_of(lacking)}",
                where=given,
                expected=f"every class of {asked}",
                fix="download or unpack it again",
            )
        positions, notes = self.positions(home)
        return ImageScene(
            scene,
            _image_set(queries, positions),
            _image_set(gallery, positions),
            asked,
            given,
            pairs_of_labels(*labels),
            self.gallery_sizes[scene.endswith(DIRECTIONS[1])],
            notes,
        )

    def positions(self, home: Path) -> tuple[Mapping[str, Sequence[float]] | None, tuple[str, ...]]:
        """Return longitude and latitude by class, where the benchmark has them, and notes."""
        return None, ()


def class_images(folder: Path, below: str = "") -> list[ClassImage]:
    """List the images of all class folders, or of a folder in each, sorted by class and name."""
    layout = f"a folder a class, named by a whole number, with images ending in {_SUFFIXES}"
    inside = sorted(path for path in folder.iterdir() if path.is_dir()) if folder.is_dir() else []
    homes = [home for home in inside if not home.name.startswith((".", "__"))]
    found: list[ClassImage] = []
    for home in homes:
        if not (home.name.isascii() and home.name.isdigit()):
            raise missing(
                f"the folder {home.name!r} is no class", folder, layout, "move it elsewhere"
            )
        files = sorted((home / below).iterdir()) if (home / below).is_dir() else []
        images = [
            file for file in files if file.suffix.lower() in _SUFFIXES and file.name[0] != "."
        ]
        partial = [f.name for f in files if f.name.endswith((".part", ".crdownload", ".aria2"))]
        partial += [f.name for f in images if not f.stat().st_size or not f.name.isprintable()]
        if partial or not images:
            what = f"not whole: {first_of(partial)}" if partial else "holds no image"
            raise missing(what, home / below, layout)
        found += [
            ClassImage(
                str(int(home.name)), f"{home.name}/{one.stem}", one.relative_to(folder).as_posix()
            )
            for one in images
        ]
    if not found:
        fix = "unpack it there, or choose scenes that are there with --scene"
        raise missing("holds no class folder", folder, layout, fix)
    return found


def _image_set(
    images: Sequence[ClassImage], positions: Mapping[str, Sequence[float]] | None
) -> ImageSet:
    places: Floats | None = None
    if positions is not None:
        lacking = sorted({image.label for image in images} - set(positions), key=int)
        if lacking:
            raise BenchmarkError(
                f"no position of classes {first_of(lacking)}",
                where=_POSITIONS,
                expected="a line for an image of each class",
                fix="download it again",
            )
        places = np.array([positions[image.label] for image in images], np.float64)
    names, files = [image.name for image in images], [image.image for image in images]
    return ImageSet(names, files, places, degrees=places is not None)


class University1652(ClassFolders):
    """University-1652; street views are not read."""

    name = "university-1652"
    about = about_of("university-1652")
    protocols = tuple(f"university-1652-{direction}" for direction in DIRECTIONS)
    gallery_sizes = (951, 51_355)


class Sues200(ClassFolders):
    """SUES-200; a scene is a height in a direction."""

    name = "sues-200"
    about = about_of("sues-200")
    protocols = tuple(f"sues-200-{direction}" for direction in DIRECTIONS)
    gallery_sizes = (200, 10_000)
    places = ("Testing", "Dataset/Testing", "Datasets/Testing", "")
    layout = (
        "as downloaded: a folder with 'drone' in its name (drone_view_512/0001/150/...) and one "
        "with 'satellite' (satellite-view/0001/...); or as the authors' split_datasets.py leaves "
        "it: Testing/150/query_drone/0001/... and so on"
    )

    def is_home(self, folder: Path) -> bool:
        """Return whether a folder holds the heights, or the two views."""
        return any((folder / h / "query_drone").is_dir() for h in _HEIGHTS) or len(
            _views(folder)
        ) == len(DIRECTIONS)

    def sets(self, home: Path, scene: str) -> list[tuple[Path, list[ClassImage]]]:
        """Return the folders of a height, or those of the views with the classes of the split."""
        height, asked, _, given = scene.split("-")
        views = _views(home)
        if len(views) < len(DIRECTIONS):
            return super().sets(home / height, scene)
        folders = [home / views[asked], home / views[given]]
        below = [height if view == "drone" else "" for view in (asked, given)]
        queries, gallery = (
            class_images(folder, part) for folder, part in zip(folders, below, strict=True)
        )
        if {image.label for image in queries} != {str(number) for number in range(1, 201)}:
            raise missing("lacks classes, or has others", folders[0], "the classes 0001 to 0200")
        tested = [image for image in queries if image.label not in _TRAINING]
        return [(folders[0], tested), (folders[1], gallery)]


def _views(folder: Path) -> dict[str, str]:
    """Return the folders of the two views, by the words that are in their names."""
    names = [path.name for path in folder.iterdir() if path.is_dir()] if folder.is_dir() else []
    found = {view: [n for n in names if view in n.lower()] for view in ("drone", "satellite")}
    return {view: few[0] for view, few in found.items() if len(few) == 1}


class DenseUav(ClassFolders):
    """DenseUAV; a class is a place, and has one position."""

    name = "denseuav"
    about = about_of("denseuav")
    protocols = tuple(f"denseuav-{direction}" for direction in DIRECTIONS)
    gallery_sizes = (18_198, 9_099)
    places = ("test",)
    layout = f"{_POSITIONS}, and {ClassFolders.layout}"

    def is_home(self, folder: Path) -> bool:
        """Return whether a folder is test/, next to the positions."""
        return folder.is_dir() and (folder.parent / _POSITIONS).exists()

    def positions(self, home: Path) -> tuple[Mapping[str, Sequence[float]] | None, tuple[str, ...]]:
        """Read the position of each class, that of its last line as in the authors' code."""
        path = home.parent / _POSITIONS
        found: dict[str, tuple[float, float]] = {}
        moved: dict[str, None] = {}
        for number, line in enumerate(read_native_text(path).splitlines(), start=1):
            if not line.strip():
                continue
            label, position = _position(path, number, line)
            if found.get(label, position) != position:
                moved[label] = None
            found[label] = position
        _check_spacing(path, found)
        said = f"classes whose lines in {_POSITIONS} differ, of which the last is taken: "
        return found, (said + first_of(moved),) if moved else ()


def _position(path: Path, number: int, line: str) -> tuple[str, tuple[float, float]]:
    """Read ``folder/CLASS/file E<lon> N<lat> height``."""
    parts = line.split()
    folders = parts[0].replace("\\", "/").split("/")
    label = folders[-2] if len(folders) > 1 else ""
    try:
        marks, values = "".join(part[0] for part in parts[1:3]), [float(p[1:]) for p in parts[1:3]]
    except ValueError:
        marks, values = "", []
    sound = marks == "EN" and 0.0 <= values[0] <= 180.0 and 0.0 <= values[1] <= 90.0
    if not (sound and label.isascii() and label.isdigit()):
        raise BenchmarkError(
            f"is {line[:80]!r}",
            where=f"{path}, line {number}",
            expected=f"such as {_POSITION_LINE}, with blanks between and points in numbers",
            fix="download it again, or correct the line",
        )
    return str(int(label)), (values[0], values[1])


def _check_spacing(path: Path, positions: Mapping[str, Sequence[float]]) -> None:
    """Refuse positions that are too coarse to tell classes apart, or not on one campus's scale."""
    places = np.array([positions[label] for label in sorted(positions, key=int)]).reshape(-1, 2)
    shared = len(places) - len(np.unique(places, axis=0))
    apart = geodesic_distance_m(places[1:], places[:-1])
    far = len(apart) > 0 and np.median(apart) > _FARTHEST_M
    if not len(places) or far or shared > _MOST_SHARED * len(places):
        raise BenchmarkError(
            f"{shared} of {len(places)} classes have the position of another, or classes are far "
            "from the next one",
            where=path,
            expected="a position of its own for each class, some 20 m from the next",
            fix="download it again: positions may be rounded",
        )


UNIVERSITY_1652 = University1652()
SUES_200 = Sues200()
DENSEUAV = DenseUav()
