"""Opening a benchmark for a method that is to be scored on it: all it may know, and no truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import SupportsIndex, overload

from airzoo_bench.api.arrays import path_of
from airzoo_bench.api.scene import BlindScene
from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.benchmark.mirrored import data_here
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.storage.urls import is_url

__all__ = ["BlindBenchmark", "load_benchmark"]


def load_benchmark(name_or_path: str | Path, data: str | Path | None = None) -> BlindBenchmark:
    """Open a benchmark for a method that is to be scored on it.

    What comes back leads to all that a method may know, and to nothing of the truth: no positives,
    no true pose, no true cloud.

    Parameters
    ----------
    name_or_path : str or Path
        The benchmark's name, such as ``airzoo-mini``, or its folder, as ``airzoo-bench prepare``
        wrote it.
    data : str or Path, optional
        The folder that holds benchmark folders; by default ``$AIRZOO_BENCH_DATA`` or the cache
        folder.

    Returns
    -------
    BlindBenchmark
        Scenes, photos, tiles, crops.

    Raises
    ------
    BenchmarkError
        It is not there, or a file of it is missing or was changed.

    Examples
    --------
    >>> load_benchmark("nowhere")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    airzoo_bench.core.errors.BenchmarkError: ...benchmark nowhere is not there...

    With one that is there::

        for scene in load_benchmark("airzoo-mini").scenes:
            gallery = [(tile.id, tile.image) for tile in scene.tiles()]
            photos = [(photo.id, photo.image) for photo in scene.queries()]
    """
    if is_url(name_or_path):
        return BlindBenchmark.of(Benchmark.open(data_here(name_or_path), sealed=True))
    folder = path_of("name_or_path", name_or_path)
    if (folder / "benchmark.toml").is_file() or len(folder.parts) > 1:
        return BlindBenchmark.of(Benchmark.open(folder, sealed=True))
    root = data_here(data if data is None or is_url(data) else path_of("data", data))
    return BlindBenchmark.of(find_benchmark(str(name_or_path), root, sealed=True))


class BlindScenes(tuple[BlindScene, ...]):
    """Scenes in their order, of which ``scenes["city"]`` is the one of that id."""

    __slots__ = ()

    @overload
    def __getitem__(self, key: str | SupportsIndex) -> BlindScene: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[BlindScene, ...]: ...
    def __getitem__(self, key: str | SupportsIndex | slice) -> BlindScene | tuple[BlindScene, ...]:
        if not isinstance(key, str):
            return super().__getitem__(key)
        for scene in self:
            if scene.id == key:
                return scene
        raise BenchmarkError(f"has no scene {key!r}", expected=", ".join(one.id for one in self))


@dataclass(frozen=True, eq=False, repr=False)
class BlindBenchmark:
    """A benchmark without its truth, as `load_benchmark` opens it."""

    _source: Benchmark

    @classmethod
    def of(cls, benchmark: Benchmark) -> BlindBenchmark:
        """Leave the truth out of an opened benchmark folder.

        Parameters
        ----------
        benchmark : Benchmark
            With its truth.

        Returns
        -------
        BlindBenchmark
            Which leads to nothing of it.
        """
        return cls(_without_truth(benchmark))

    @property
    def name(self) -> str:
        """The benchmark's name, as protocols give it."""
        return self._source.name

    @property
    def folder(self) -> Path:
        """The benchmark folder."""
        return self._source.folder

    @property
    def tracks(self) -> tuple[str, ...]:
        """The tracks that it serves: retrieval, matching, reconstruction."""
        return tuple(self._source.file.tracks)

    @property
    def scenes(self) -> BlindScenes:
        """All scenes, by number or by id: ``scenes[0]``, ``scenes["city"]``."""
        return BlindScenes(BlindScene(self._source, one.id) for one in self._source.file.scenes)

    def scene(self, scene_id: str) -> BlindScene:
        """Return a scene by its id.

        Parameters
        ----------
        scene_id : str
            Such as "city".

        Returns
        -------
        BlindScene
            Without its truth.

        Raises
        ------
        BenchmarkError
            There is none of that id.
        """
        try:
            return self.scenes[scene_id]
        except BenchmarkError as error:
            raise error.inside(self.folder) from error

    def scenes_of(self, protocol: Protocol) -> tuple[BlindScene, ...]:
        """Return the scenes of a protocol.

        Parameters
        ----------
        protocol : Protocol
            Of this benchmark.

        Returns
        -------
        tuple of BlindScene
            In the protocol's order.

        Raises
        ------
        BenchmarkError
            The benchmark was not prepared for it.
        """
        self._source.check_fits(protocol)
        return tuple(self.scene(scene.id) for scene in protocol.scenes)

    def __repr__(self) -> str:
        scenes = ", ".join(scene.id for scene in self.scenes)
        return f"BlindBenchmark({self.name!r}: {', '.join(self.tracks)}; scenes {scenes})"


def _without_truth(benchmark: Benchmark) -> Benchmark:
    """Return a benchmark folder whose manifest does not name the true cloud."""
    nothing = {"cloud": None, "cloud_sha256": None}
    scenes = tuple(scene.model_copy(update=nothing) for scene in benchmark.file.scenes)
    file = benchmark.file.model_copy(update={"scenes": scenes, "checksums": {}})
    return Benchmark(benchmark.folder, file)
