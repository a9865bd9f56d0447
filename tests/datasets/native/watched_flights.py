"""Flights whose reading waits, or ends its process, as a test says; and what is made of them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.engines.engine import HERE, Engine
from tests.datasets.native.flights import FlightOptions, Flights

T = TypeVar("T")


class WatchedFlights(Flights):
    """Flights that do what files beside the source say, and list there what is read."""

    def read(self, options: FlightOptions, scene: str, progress: Progress) -> NativeScene:
        beside = options.source.parent
        with (beside / "read").open("a") as stream:
            stream.write(f"{scene}\n")
        deadly, waiting = beside / f"{scene}-kills", beside / f"{scene}-waits-for"
        if deadly.exists():
            deadly.unlink()
            os.kill(os.getpid(), signal.SIGKILL)
        while waiting.exists() and not all(map(os.path.exists, waiting.read_text().split("\n"))):
            time.sleep(0.01)
        return super().read(options, scene, progress)


@dataclass
class World:
    """Three flights, and what is said while a folder is made of them."""

    home: Path
    notes: list[str] = field(default_factory=list)
    shown: list[tuple[str, int]] = field(default_factory=list)

    @property
    def source(self) -> Path:
        return self.home / "source"

    @property
    def staging(self) -> Path:
        return self.home / "data" / ".flights.prepare"

    def finished(self, scene: str) -> Path:
        return self.staging / scene / "prepared.json"

    def hold(self, scene: str, *, until: Sequence[str]) -> None:
        """Have the reading of a scene wait until others are finished."""
        others = [str(self.finished(one)) for one in until]
        (self.home / f"{scene}-waits-for").write_text("\n".join(others))

    def read(self) -> list[str]:
        """Return the scenes that were read since this was asked."""
        listed = self.home / "read"
        scenes = listed.read_text().split() if listed.exists() else []
        listed.unlink(missing_ok=True)
        return sorted(scenes)

    def make(self, engine: Engine = HERE, *, keep_going: bool = False) -> Prepared:
        folder = self.home / "data" / "flights"
        settings = PrepareSettings(
            folder, folder.parent, engine=engine, progress=self._show, note=self.notes.append
        )
        options = FlightOptions(self.source, keep_going=keep_going)
        return WatchedFlights().prepare(options, settings)

    def _show(self, items: Iterable[T], label: str, total: int) -> Iterator[T]:
        self.shown.append((label, total))
        yield from items
