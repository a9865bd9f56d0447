"""GTA-UAV: drone images and satellite tiles of a game's map, paired by overlap."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.published.image_benchmark import DIRECTIONS, ImageBenchmark
from airzoo_bench.datasets.published.image_scene import ImageScene

__all__ = ["GTA_UAV", "GtaUav"]

AREAS = ("cross-area", "same-area")
_TILES = 14_640


class GtaUav(ImageBenchmark):
    """See `ImageBenchmark`; a scene is a test list in a direction."""

    summary = (
        "GTA-UAV, cross-area and same-area, both ways between drone and satellite: the pairs of "
        "its test lists."
    )
    example = "gta-uav --source GTA-UAV"
    name = "gta-uav"
    about = About(
        title="GTA-UAV",
        page="https://github.com/Yux1angJi/GTA-UAV",
        licence="Apache 2.0",
        repository="Yux1ang/GTA-UAV-LR",
        unverified=(
            "The tree was not seen; it is that of the authors' README and game4loc/dataset/gta.py.",
        ),
    )
    protocols = tuple(f"gta-uav-{area}-{direction}" for area in AREAS for direction in DIRECTIONS)
    gallery_sizes: ClassVar[dict[str, int]] = {f"{area}-{DIRECTIONS[0]}": _TILES for area in AREAS}

    def root(self, source: Path) -> Path:
        """Find the folder that holds the test lists."""
        from airzoo_bench.datasets.published.class_folders import find_root

        names = [f"{area}-drone2sate-test.json" for area in AREAS]
        return find_root(
            source,
            ("",),
            lambda folder: any((folder / name).is_file() for name in names),
            " and ".join(names) + ", drone/images/ and satellite/",
        )

    def read(self, root: Path, scene: str) -> ImageScene:
        """Read the test list of an area, and turn it round for the way back."""
        from airzoo_bench.datasets.published.gta_uav_files import read_pairs
        from airzoo_bench.datasets.published.gta_uav_scene import scene_of_pairs

        area = next(area for area in AREAS if scene.startswith(area))
        found = read_pairs(root / f"{area}-drone2sate-test.json")
        return scene_of_pairs(root, found, backwards=scene.endswith(DIRECTIONS[1]))


GTA_UAV = GtaUav()
