"""Benchmarks that give images, and say themselves which belong together."""

from __future__ import annotations

from typing import ClassVar

from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.dataset import Dataset, Prepared, PrepareSettings
from airzoo_bench.datasets.native import NativeOptions
from airzoo_bench.datasets.published.image_scene import ImageLayout

__all__ = ["DIRECTIONS", "ImageBenchmark"]

DIRECTIONS = ("drone-to-satellite", "satellite-to-drone")
"""Which view asks, and which is the gallery."""


class ImageBenchmark(ImageLayout, Dataset[NativeOptions]):
    """A benchmark of class folders or pair lists.

    Attributes
    ----------
    about : About
    """

    options = NativeOptions
    about: ClassVar[About]
    jobs = 1

    def benchmark(self, options: NativeOptions) -> str:
        """See `Dataset.benchmark`."""
        return self.name

    def is_prepared(self, options: NativeOptions, settings: PrepareSettings) -> bool:
        """See `Dataset.is_prepared`: the truth is made again, which takes seconds, and compared."""
        from airzoo_bench.datasets.published.image_folder import is_prepared

        return is_prepared(self, options, settings)

    def prepare(self, options: NativeOptions, settings: PrepareSettings) -> Prepared:
        """Make the benchmark folder, see `image_folder.prepare_images`."""
        from airzoo_bench.datasets.published.image_folder import prepare_images

        return prepare_images(self, options, settings)
