"""Scenes that are finished, each a task, and kept until all are."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError, UserError, agreeing, counted
from airzoo_bench.core.files import temporary_folder
from airzoo_bench.core.progress import shown
from airzoo_bench.datasets.dataset import PrepareSettings
from airzoo_bench.datasets.folder import write_scene
from airzoo_bench.datasets.scene_content import scene_content
from airzoo_bench.datasets.scene_parts import (
    ScenePart,
    SceneSource,
    is_kept,
    link_or_copy,
    options_of,
    read_parts,
    scene_keys,
)
from airzoo_bench.datasets.scene_tasks import made_scenes, unseen
from airzoo_bench.datasets.summary import summary_of
from airzoo_bench.datasets.truths import BenchmarkProtocols

if TYPE_CHECKING:
    from airzoo_bench.datasets.scene_facts import SceneFacts

__all__ = ["SceneRun"]


@dataclass
class SceneRun:
    """Scenes that are being finished.

    Attributes
    ----------
    keys : dict
        By scene, what it is made from, see `scene_keys`.
    parts, facts, failed : dict
        By scene: what is finished, what was measured, why it cannot be made.
    made : bool
        Whether the folder of all stands.
    """

    source: SceneSource
    protocols: BenchmarkProtocols
    settings: PrepareSettings
    keys: dict[str, str] = field(default_factory=dict)
    parts: dict[str, ScenePart] = field(default_factory=dict)
    facts: dict[str, SceneFacts] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    made: bool = False

    @property
    def staging(self) -> Path:
        """Where finished scenes are kept until all are."""
        name = self.protocols.every[0].benchmark
        return self.settings.folder.parent / f".{name}.prepare"

    @property
    def kept(self) -> list[str]:
        """The scenes that the next run can take as they are."""
        return [scene for scene, key in self.keys.items() if is_kept(self.staging / scene, key)]

    def clear(self) -> None:
        """Remove the finished scenes, unless another run can go on from them."""
        if self.made or len(self.source.scenes) == 1 or not self.kept:
            shutil.rmtree(self.staging, ignore_errors=True)

    def finish(self) -> None:
        """Finish the scenes, or say which of them are kept."""
        keys = partial(scene_keys, self.source, self.protocols, self.settings)
        self.keys = shown(keys, "looking through the source", self.settings.progress)
        self.staging.mkdir(parents=True, exist_ok=True)
        try:
            shown(self._take, "looking through earlier runs", self.settings.progress)
            self._make([scene for scene in self.source.scenes if scene not in self.parts])
        except (UserError, KeyboardInterrupt):
            self._say_kept()
            raise
        if not self.parts:
            raise BenchmarkError(
                "no scene could be made:\n" + "\n".join(self.failed.values()),
                where=self.settings.folder,
            )
        # As they come in the protocols, whichever were there before.
        ordered = (scene for scene in self.source.scenes if scene in self.parts)
        self.parts = {scene: self.parts[scene] for scene in ordered}

    def _found(self) -> dict[str, ScenePart]:
        """Return the scenes that earlier runs have finished, by their keys."""
        places = [self.staging / scene for scene in self.source.scenes]
        if not self.settings.replace:
            folder, name = self.settings.folder, self.protocols.every[0].benchmark
            places += [folder, folder.with_name(name), folder.with_name(f"{name}-partial")]
        found: dict[str, ScenePart] = {}
        for place in places:
            if _is_as_written(place):
                found |= {part.key: part for part in read_parts(place).values()}
        return found

    def _take(self) -> None:
        """Take the scenes that nothing has changed for since they were finished."""
        found = self._found()
        for scene, key in self.keys.items():
            if key in found:
                self.settings.note(
                    f"scene {scene}: nothing changed since it was made, taken as it is"
                )
                part, home = found[key], self.staging / scene
                kept = part if part.home == home else part.keep(self.staging, shutil.copyfile)
                self.parts[scene] = kept

    def _make(self, scenes: Sequence[str]) -> None:
        """Make scenes, each a task."""
        staging = (self.staging.absolute(),)
        make = partial(_made, self)
        made = made_scenes(make, self.source, scenes, self.settings, needed=staging)
        for scene, found in made:
            if isinstance(found, UserError):
                self.failed[scene] = str(found)
                continue
            part, facts = found
            if not part.is_whole:
                raise unseen("this machine does not see what a worker made", f"scene {scene}")
            self.parts[scene] = part
            if facts is not None:
                self.facts[scene] = facts

    def _say_kept(self) -> None:
        kept = len(self.kept)
        if kept and len(self.source.scenes) > 1:
            self.settings.note(
                f"{counted(kept, 'finished scene')} of {len(self.source.scenes)} "
                f"{agreeing(kept, 'is', 'are')} kept in {self.staging}; the same "
                "command goes on from there"
            )


def _made(run: SceneRun, scene: str) -> tuple[ScenePart, SceneFacts | None]:
    """Make a scene and keep it among the finished ones: a task, whose files outlive its worker."""
    source, protocols = run.source, run.protocols
    native = source.native(scene, run.settings.progress)
    content = scene_content(native, protocols)
    summary = summary_of(content, protocols, native.notes)
    with temporary_folder(run.staging, scene) as temporary:
        entry = write_scene(temporary, content, protocols.titles[scene], run.settings)
        part = ScenePart(temporary, run.keys[scene], entry, summary, options_of(source))
        return part.keep(run.staging, link_or_copy), content.facts


def _is_as_written(place: Path) -> bool:
    """Whether scenes can be taken from a place: none of its files was changed."""
    if not (place / "benchmark.toml").is_file():
        return True  # a scene that an earlier run has finished
    try:
        Benchmark.open(place)
    except BenchmarkError:
        return False
    return True
