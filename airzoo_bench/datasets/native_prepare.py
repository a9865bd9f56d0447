"""From scenes as their files state them to a benchmark folder, for every dataset."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.folder import write_benchmark
from airzoo_bench.datasets.native import NativeScene
from airzoo_bench.datasets.scene_content import scene_content
from airzoo_bench.datasets.truths import BenchmarkProtocols

__all__ = ["chosen_scenes", "prepare_scenes"]


def chosen_scenes(there: Sequence[str], only: Sequence[str] | None) -> list[str]:
    """Return the scenes that were asked for, in the order of those that are there.

    Raises
    ------
    UsageError
        One that was asked for is not there.
    """
    unknown = [scene for scene in only or () if scene not in there]
    if unknown:
        raise UsageError(
            f"there is no scene {', '.join(map(repr, unknown))}",
            where="--scene",
            expected="some of " + ", ".join(there),
        )
    return [scene for scene in there if only is None or scene in only]


def prepare_scenes(
    scenes: Sequence[str],
    read: Callable[[str], NativeScene],
    protocols: BenchmarkProtocols,
    settings: PrepareSettings,
) -> Prepared:
    """Make the benchmark folder of some scenes.

    Parameters
    ----------
    scenes : sequence of str
        Where they are not all that a protocol names, the folder and its protocols are named
        "partial", so that no table takes them for the whole.
    read : callable
        Takes a scene's id.
    protocols : BenchmarkProtocols
    settings : PrepareSettings

    Raises
    ------
    UserError
        A scene's files are missing or wrong, or no photo of it can be answered.
    """
    partial = protocols.of_scenes(scenes)
    if partial != protocols and settings.folder.name == protocols.every[0].benchmark:
        name = partial.every[0].benchmark
        settings = replace(settings, folder=settings.folder.with_name(name))
    contents = []
    for scene in scenes:
        native = read(scene)
        for sentence in native.notes:
            settings.note(f"scene {scene}: {sentence}")
        contents.append(scene_content(native, protocols))
    return write_benchmark(contents, partial, settings)
