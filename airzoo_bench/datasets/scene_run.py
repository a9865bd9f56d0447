"""Scenes that are finished one after the other, and kept until all are."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.core.plurals import agreeing, counted
from airzoo_bench.core.temporaries import temporary_folder
from airzoo_bench.datasets.dataset import PrepareSettings
from airzoo_bench.datasets.folder import write_scene
from airzoo_bench.datasets.scene_content import scene_content
from airzoo_bench.datasets.scene_parts import (
    ScenePart,
    SceneSource,
    link_or_copy,
    options_of,
    read_parts,
    scene_keys,
)
from airzoo_bench.datasets.summary import summary_of
from airzoo_bench.datasets.truths import BenchmarkProtocols

if TYPE_CHECKING:
    from airzoo_bench.datasets.scene_facts import SceneFacts

__all__ = ["SceneRun"]


@dataclass
class SceneRun:
    """Scenes that are being finished, one after the other.

    Attributes
    ----------
    parts, facts, failed : dict
        By scene: what is finished, what was measured, why it cannot be made.
    made : bool
        Whether the folder of all stands.
    """

    source: SceneSource
    protocols: BenchmarkProtocols
    settings: PrepareSettings
    parts: dict[str, ScenePart] = field(default_factory=dict)
    facts: dict[str, SceneFacts] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    made: bool = False

    @property
    def staging(self) -> Path:
        """Where finished scenes are kept until all are."""
        name = self.protocols.every[0].benchmark
        return self.settings.folder.parent / f".{name}.prepare"

    def clear(self) -> None:
        """Remove the finished scenes, unless another run can go on from them."""
        if self.made or len(self.source.scenes) == 1 or not self.parts:
            shutil.rmtree(self.staging, ignore_errors=True)

    def finish(self) -> None:
        """Finish the scenes, or say which of them are kept.

        Raises
        ------
        UserError
            A scene cannot be made and is not to be left out, or none can.
        """
        keys = scene_keys(self.source, self.protocols, self.settings)
        found = self._found()
        for scene in self.source.scenes:
            try:
                self.parts[scene] = self._part(scene, keys[scene], found)
            except UserError as error:
                if not self.source.keep_going:
                    self._say_kept()
                    self._add_way_out(error)
                    raise
                self.failed[scene] = str(error)
            except KeyboardInterrupt:
                self._say_kept()
                raise
        if not self.parts:
            raise BenchmarkError(
                "no scene could be made:\n" + "\n".join(self.failed.values()),
                where=self.settings.folder,
            )

    def _found(self) -> dict[str, ScenePart]:
        """Return the scenes that earlier runs have finished, by their keys."""
        places = [self.staging / scene for scene in self.source.scenes]
        if not self.settings.replace and self.settings.add_to is None:
            folder, name = self.settings.folder, self.protocols.every[0].benchmark
            places += [folder, folder.with_name(name), folder.with_name(f"{name}-partial")]
        found: dict[str, ScenePart] = {}
        for place in places:
            if _is_as_written(place):
                found |= {part.key: part for part in read_parts(place).values()}
        return found

    def _part(self, scene: str, key: str, found: Mapping[str, ScenePart]) -> ScenePart:
        if key in found:
            self.settings.note(f"scene {scene}: nothing changed since it was made, taken as it is")
            part = found[key]
            in_staging = part.home == self.staging / scene
            return part if in_staging else part.keep(self.staging, shutil.copyfile)
        native = self.source.read(scene)
        content = scene_content(native, self.protocols)
        summary = summary_of(content, self.protocols, native.notes)
        self.staging.mkdir(parents=True, exist_ok=True)
        with temporary_folder(self.staging, scene) as temporary:
            title = self.protocols.titles[scene]
            entry = write_scene(temporary, content, title, self.settings)
            part = ScenePart(temporary, key, entry, summary, options_of(self.source))
            part = part.keep(self.staging, link_or_copy)
        if content.facts is not None:
            self.facts[scene] = content.facts
        return part

    def _add_way_out(self, error: UserError) -> None:
        """Add to the error of one scene of several how the others are made without it."""
        if len(self.source.scenes) > 1 and hasattr(self.source.options, "keep_going"):
            others = "leave the scene out with --keep-going, or name those to make with --scene"
            error.fix = f"{error.fix}; or {others}" if error.fix else others

    def _say_kept(self) -> None:
        if self.parts and len(self.source.scenes) > 1:
            self.settings.note(
                f"{counted(len(self.parts), 'finished scene')} of {len(self.source.scenes)} "
                f"{agreeing(len(self.parts), 'is', 'are')} kept in {self.staging}; the same "
                "command goes on from there"
            )


def _is_as_written(place: Path) -> bool:
    """Whether scenes can be taken from a place: none of its files was changed."""
    if not (place / "benchmark.toml").is_file():
        return True  # a scene that an earlier run has finished
    try:
        Benchmark.open(place)
    except BenchmarkError:
        return False
    return True
