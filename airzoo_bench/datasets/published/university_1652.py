"""University-1652: buildings of universities from drones and satellites."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.published.image_benchmark import DIRECTIONS, ImageBenchmark
from airzoo_bench.datasets.published.image_scene import ImageScene

__all__ = ["UNIVERSITY_1652", "University1652"]

_FOLDERS = ("query_drone", "gallery_satellite", "query_satellite", "gallery_drone")


class University1652(ImageBenchmark):
    """See `ImageBenchmark`; street views are not read."""

    summary = (
        "University-1652, both ways between drone and satellite: images of one class folder answer "
        "each other."
    )
    example = "university-1652 --source University-Release"
    name = "university-1652"
    about = About(
        title="University-1652",
        page="https://github.com/layumi/University1652-Baseline",
        licence="for research only, not to be passed on; on request from its authors",
        unverified=("The tree was not seen; it is that of the authors' README and test.py.",),
    )
    protocols = tuple(f"university-1652-{direction}" for direction in DIRECTIONS)
    gallery_sizes: ClassVar[dict[str, int]] = {
        "drone-to-satellite": 951,
        "satellite-to-drone": 51_355,
    }

    def root(self, source: Path) -> Path:
        """Find the folder test/, or a folder like it."""
        from airzoo_bench.datasets.published.class_folders import find_root

        return find_root(
            source,
            ("", "test"),
            lambda folder: any((folder / name).is_dir() for name in _FOLDERS),
            "test/ with " + ", ".join(_FOLDERS) + ", each with a folder a class",
        )

    def read(self, root: Path, scene: str) -> ImageScene:
        """Pair a direction's folders by class."""
        from airzoo_bench.datasets.published.class_folders import (
            class_images,
            image_set,
            scene_of_classes,
        )

        asked, _, given = scene.split("-")
        homes = root / f"query_{asked}", root / f"gallery_{given}"
        images = [class_images(home) for home in homes]
        queries, gallery = (
            (home, found, image_set(found)) for home, found in zip(homes, images, strict=True)
        )
        return scene_of_classes(queries, gallery)


UNIVERSITY_1652 = University1652()
