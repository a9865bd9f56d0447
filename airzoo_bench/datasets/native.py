"""Datasets that are read scene by scene, such as published benchmarks as downloaded."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar

from airzoo_bench.core.progress import Progress
from airzoo_bench.core.registry import Option
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.dataset import Dataset, Prepared, PrepareSettings
from airzoo_bench.datasets.native_scene import NativeScene

if TYPE_CHECKING:
    from airzoo_bench.datasets.scene_parts import SceneSource
    from airzoo_bench.datasets.truths import BenchmarkProtocols

__all__ = ["NativeDataset", "NativeOptions", "files_among", "paths_among"]


@dataclass(frozen=True)
class NativeOptions:
    """What every benchmark asks for; each may add options of its own."""

    source: Annotated[Path, Option("source", "Folder of the benchmark, as it is downloaded.")]
    scene: Annotated[
        list[str] | None, Option("scene", "Only this scene; repeat it (default: all).")
    ] = None
    keep_going: Annotated[
        bool, Option("keep-going", "Leave out scenes that cannot be read, instead of stopping.")
    ] = False


OptionsT = TypeVar("OptionsT", bound=NativeOptions)


class NativeDataset(Dataset[OptionsT]):
    """A published benchmark as it is downloaded.

    Attributes
    ----------
    about : About
    """

    about: ClassVar[About]
    jobs = 1

    @abstractmethod
    def protocols(self, options: OptionsT, root: Path) -> BenchmarkProtocols:
        """Return the protocols that the benchmark's truth is made for."""

    @abstractmethod
    def scenes(self, options: OptionsT) -> list[str]:
        """Return the ids of the scenes that stand below the source, in the protocols' order."""

    @abstractmethod
    def read(self, options: OptionsT, scene: str, progress: Progress) -> NativeScene:
        """Read a scene's native files, of several scenes at once where processes share them."""

    def files(self, options: OptionsT, scene: str) -> Iterable[Path]:
        """Return the files and folders that a scene is read from, all else may change."""
        return paths_among(options)

    def folder_name(self, options: OptionsT, root: Path) -> str:
        """Name the folder, which is another where only some of the scenes are there or wanted."""
        source, protocols = self._source(options), self.protocols(options, root)
        return protocols.of_scenes(source.scenes).every[0].benchmark

    def is_prepared(self, options: OptionsT, settings: PrepareSettings) -> bool:
        """Whether the folder is complete, and made from files that did not change since."""
        from airzoo_bench.datasets.native_prepare import is_prepared

        protocols = self.protocols(options, settings.root)
        return is_prepared(self._source(options), protocols, settings)

    def prepare(self, options: OptionsT, settings: PrepareSettings) -> Prepared:
        """Make the benchmark folder of all scenes."""
        from airzoo_bench.datasets.native_prepare import prepare_scenes
        from airzoo_bench.datasets.sources import check_target

        check_target(paths_among(options), settings.folder)
        protocols = self.protocols(options, settings.root)
        return prepare_scenes(self._source(options), protocols, settings)

    def _source(self, options: OptionsT) -> SceneSource:
        from airzoo_bench.datasets.native_prepare import chosen_scenes
        from airzoo_bench.datasets.scene_parts import SceneSource

        return SceneSource(
            chosen_scenes(self.scenes(options), options.scene, options.source),
            self.read,
            partial(self.files, options),
            options,
            options.keep_going,
        )


def paths_among(options: Any) -> list[Path]:
    """Return the values of a dataclass that are paths."""
    values = [getattr(options, one.name) for one in fields(options)]
    return [value for value in values if isinstance(value, Path)]


def files_among(options: Any, scene: str) -> list[Path]:
    """Return the same paths for any scene: all that are among the options."""
    del scene
    return paths_among(options)
