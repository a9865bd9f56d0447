"""A benchmark that gives images, and a scene of it: queries, gallery, and which belong together."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from airzoo_bench.retrieval.stated_truth import ImageSet, StatedPairs

__all__ = ["ImageLayout", "ImageScene"]


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


class ImageLayout(ABC):
    """What a benchmark of class folders or pair lists consists of, and how it is read.

    Attributes
    ----------
    name : str
    protocols : tuple of str
        Those that are shipped for it.
    gallery_sizes : dict of str to int
        Published number of images, by scene.
    """

    name: ClassVar[str]
    protocols: ClassVar[tuple[str, ...]]
    gallery_sizes: ClassVar[dict[str, int]]

    @abstractmethod
    def root(self, source: Path) -> Path:
        """Find the benchmark at the source, or in a folder of it."""

    @abstractmethod
    def read(self, root: Path, scene: str) -> ImageScene:
        """Read a scene's native files."""
