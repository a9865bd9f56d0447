"""Benchmarks that give images, and say themselves which belong together."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from airzoo_bench.datasets.dataset import Dataset, Prepared, PrepareSettings
from airzoo_bench.datasets.native import About, NativeOptions

if TYPE_CHECKING:
    from airzoo_bench.retrieval.stated_truth import ImageSet, StatedPairs

__all__ = ["DIRECTIONS", "ImageBenchmark", "ImageScene"]

DIRECTIONS = ("drone-to-satellite", "satellite-to-drone")
"""Which view asks, and which is the gallery."""


@dataclass(frozen=True, eq=False)
class ImageScene:
    """The queries and the gallery of a scene, as a benchmark's files state them.

    Attributes
    ----------
    queries, gallery : ImageSet
    images, tiles : Path
        The folders of both.
    pairs : StatedPairs
    notes : tuple of str
        Sentences for the user.
    """

    queries: ImageSet
    gallery: ImageSet
    images: Path
    tiles: Path
    pairs: StatedPairs
    notes: tuple[str, ...] = ()


class ImageBenchmark(Dataset[NativeOptions]):
    """A benchmark of class folders or pair lists.

    Attributes
    ----------
    about : About
    name : str
    protocols : tuple of str
        Those that are shipped for it.
    gallery_sizes : dict of str to int
        Published number of images, by scene.
    """

    options = NativeOptions
    about: ClassVar[About]
    name: ClassVar[str]
    protocols: ClassVar[tuple[str, ...]]
    gallery_sizes: ClassVar[dict[str, int]]

    def benchmark(self, options: NativeOptions) -> str:
        """See `Dataset.benchmark`."""
        return self.name

    @abstractmethod
    def root(self, source: Path) -> Path:
        """Find the benchmark at the source, or in a folder of it.

        Raises
        ------
        UserError
            It is not there; the message says what was found and what the layout is.
        """

    @abstractmethod
    def read(self, root: Path, scene: str) -> ImageScene:
        """Read a scene's native files.

        Raises
        ------
        UserError
            A file is missing, half there or not as the benchmark has it.
        """

    def is_prepared(self, options: NativeOptions, settings: PrepareSettings) -> bool:
        """See `Dataset.is_prepared`: the truth is made again, which takes seconds, and compared."""
        from airzoo_bench.datasets.published.image_folder import is_prepared

        return is_prepared(self, options, settings)

    def prepare(self, options: NativeOptions, settings: PrepareSettings) -> Prepared:
        """Make the benchmark folder, see `image_folder.prepare_images`."""
        from airzoo_bench.datasets.published.image_folder import prepare_images

        return prepare_images(self, options, settings)
