"""Datasets turn native data into a benchmark folder (``airzoo-bench prepare NAME``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from airzoo_bench.core.errors import ProtocolError, UsageError
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.core.validation import nearest
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.prepare import Run
from airzoo_bench.datasets.scenes import ImageScene, NativeScene
from airzoo_bench.datasets.settings import Prepared, PrepareSettings, SourceOptions
from airzoo_bench.datasets.truths import BenchmarkProtocols

OptionsT = TypeVar("OptionsT")


class Dataset(Generic[OptionsT]):
    """A kind of data, such as own photos, or a benchmark as it is downloaded.

    It states what it is, names the scenes below its source (`scenes`) and reads one (`read`).
    `name` is that of the benchmark and of its folder in the data root; `options` a frozen dataclass
    whose fields become options of the command, with texts in `about`; `protocols` names or files of
    the protocols that its truth is made for; `jobs` the default of ``--jobs``.
    """

    name: ClassVar[str] = ""
    about: ClassVar[About]
    options: type[Any] = SourceOptions
    protocols: ClassVar[Sequence[str]] = ()
    jobs: ClassVar[int] = 1

    def scenes(self, options: OptionsT) -> Mapping[str, Sequence[Path]]:
        """Return the scenes below the source by id, with the files that each is read from.

        They are in the protocols' order. Raise a UserError where there is none.
        """
        raise NotImplementedError

    def read(self, options: OptionsT, scene: str, progress: Progress) -> NativeScene | ImageScene:
        """Read one of `scenes`; several processes may read several at once.

        Raise a UserError where a file is missing or wrong; `progress` shows what takes long.
        """
        raise NotImplementedError

    def benchmark_protocols(self, options: OptionsT, root: Path) -> BenchmarkProtocols:
        """Return the protocols that truth is made for with these options."""
        found = BenchmarkProtocols.find(self.protocols, root)
        for name, one in zip(self.protocols, found.every, strict=True):
            if one.benchmark != self.name:
                what = f"key 'benchmark' is {one.benchmark!r}"
                raise ProtocolError(what, where=name, expected=repr(self.name))
        return found

    def folder_name(self, options: OptionsT, root: Path) -> str:
        """Name the folder, which is another where only some of the scenes are there or wanted."""
        return self.benchmark_protocols(options, root).restrict(self._wanted(options)).benchmark

    def is_prepared(self, options: OptionsT, settings: PrepareSettings) -> bool:
        """Whether the folder is complete, and made from files that did not change since."""
        return self._run(options, settings).is_prepared()

    def prepare(self, options: OptionsT, settings: PrepareSettings) -> Prepared:
        """Make the benchmark folder of all scenes."""
        for path in path_options(options):
            if settings.folder.resolve() in (path.resolve(), *path.resolve().parents):
                what = f"the folder to make holds {path}, which it is made from"
                raise UsageError(what, where=settings.folder, fix="name another --out")
        return self._run(options, settings).prepare()

    def _run(self, options: OptionsT, settings: PrepareSettings) -> Run:
        protocols = self.benchmark_protocols(options, settings.root)
        return Run(self, options, settings, self._wanted(options), protocols)

    def _wanted(self, options: Any) -> dict[str, Sequence[Path]]:
        """Return the requested scenes in the dataset's order."""
        only = getattr(options, "scene", None)
        with DATASETS.blaming(self.name, ", finding its scenes"):
            there = self.scenes(options)
        if unknown := [scene for scene in only or () if scene not in there]:
            what = f"there is no scene {', '.join(map(repr, unknown))} below {options.source}"
            what += nearest(unknown[0], list(there), 1)
            raise UsageError(what, where="--scene", expected=f"some of {', '.join(there)}")
        return {scene: files for scene, files in there.items() if only is None or scene in only}


def path_options(options: Any) -> list[Path]:
    """Return the options that are paths."""
    return [path for one in fields(options) if isinstance(path := getattr(options, one.name), Path)]
