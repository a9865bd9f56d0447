"""SUES-200: scenes around a campus from drones at four heights, and from satellites."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.published.image_benchmark import DIRECTIONS, ImageBenchmark
from airzoo_bench.datasets.published.image_scene import ImageScene

if TYPE_CHECKING:
    from airzoo_bench.datasets.published.class_folders import ClassImage

__all__ = ["SUES_200", "Sues200"]

HEIGHTS = ("150", "200", "250", "300")
_NUMBERS = (
    "1 2 3 4 5 6 7 9 10 11 13 15 16 20 21 24 25 26 27 28 29 30 31 32 33 34 36 37 39 43 44 45 "
    "51 55 56 57 58 60 64 66 67 69 70 73 74 76 77 80 81 82 84 85 86 87 88 89 90 91 94 96 97 "
    "100 101 102 103 104 105 106 113 116 118 119 120 123 125 126 127 129 132 134 137 139 141 "
    "142 145 146 147 148 149 151 152 155 156 157 158 159 160 163 166 167 168 169 171 174 179 "
    "180 182 183 184 185 186 187 191 192 193 196 197 198 199 200 "
)
TRAINING = frozenset(map(int, _NUMBERS.split()))
"""The 120 classes of the training split, by the authors' script/indexs.yaml."""

_LAYOUT = (
    "as downloaded: a folder with 'drone' in its name (drone_view_512/0001/150/...) and one with "
    "'satellite' (satellite-view/0001/...); or as the authors' split_datasets.py leaves it: "
    "Testing/150/query_drone/0001/... and so on"
)


class Sues200(ImageBenchmark):
    """See `ImageBenchmark`; a scene is a height in a direction."""

    summary = (
        "SUES-200, both ways between drone and satellite at 150, 200, 250 and 300 m, as downloaded "
        "or as its split script leaves it."
    )
    example = "sues-200 --source SUES-200-512x512"
    name = "sues-200"
    about = About(
        title="SUES-200",
        page="https://github.com/Reza-Zhu/SUES-200-Benchmark",
        licence="only for academic research",
        links=("https://drive.google.com/file/d/1UyVyFJ_pRaJHIr_eBY2HL7gkS5y9UxqI/view",),
        unverified=(
            "The tree was not seen; it is what the authors' split_datasets.py reads and writes.",
        ),
    )
    protocols = tuple(f"sues-200-{direction}" for direction in DIRECTIONS)
    gallery_sizes: ClassVar[dict[str, int]] = {
        f"{height}-{direction}": size
        for height in HEIGHTS
        for direction, size in zip(DIRECTIONS, (200, 10_000), strict=True)
    }

    def root(self, source: Path) -> Path:
        """Find the folder of the heights, or that of the two views."""
        from airzoo_bench.datasets.published.class_folders import find_root

        return find_root(
            source,
            ("Testing", "Dataset/Testing", "Datasets/Testing", ""),
            lambda folder: _is_split(folder) or len(_views(folder)) == len(("drone", "satellite")),
            _LAYOUT,
        )

    def read(self, root: Path, scene: str) -> ImageScene:
        """Pair the folders of a height by class."""
        from airzoo_bench.datasets.published.class_folders import (
            class_images,
            image_set,
            scene_of_classes,
        )

        height, asked, _, given = scene.split("-")
        sets = []
        for role, view in (("query", asked), ("gallery", given)):
            if _is_split(root):
                home = root / height / f"{role}_{view}"
                found = class_images(home)
            else:
                home = root / _views(root)[view]
                found = class_images(home, height if view == "drone" else "")
                found = _testing(home, found) if role == "query" else found
            sets.append((home, found, image_set(found)))
        return scene_of_classes(*sets)


def _is_split(folder: Path) -> bool:
    return any((folder / height / "query_drone").is_dir() for height in HEIGHTS)


def _views(folder: Path) -> dict[str, str]:
    """Return the folders of the two views, by the words that are in their names."""
    if not folder.is_dir():
        return {}
    names = [path.name for path in folder.iterdir() if path.is_dir()]
    found = {view: [n for n in names if view in n.lower()] for view in ("drone", "satellite")}
    return {view: few[0] for view, few in found.items() if len(few) == 1}


def _testing(folder: Path, images: list[ClassImage]) -> list[ClassImage]:
    """Leave out the classes of the training split."""
    there = {int(image.label) for image in images}
    lacking = sorted(set(range(1, 201)) - there)
    if lacking or len(there) != 200:
        raise BenchmarkError(
            f"holds {len(there)} classes; missing: {first_of(lacking) if lacking else 'none'}",
            where=folder,
            expected="the classes 0001 to 0200, of which 80 are tested",
            fix="download or unpack it again",
        )
    return [image for image in images if int(image.label) not in TRAINING]


SUES_200 = Sues200()
