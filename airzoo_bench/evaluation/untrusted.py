"""Opening predictions of strangers: a child reads them under limits, as `core.sandbox` says.

Predictions with a row a query come back whole. Those of scenes come back as a list of scenes
(`Track.portable`), and each is read by a child of its own when it is opened.
"""

from __future__ import annotations

import tempfile
import weakref
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.sandbox import Limits, call_limited, check_limits
from airzoo_bench.core.temporaries import temporary_folder
from airzoo_bench.evaluation.given import AnyTrack, Given, ReadBy, open_predictions
from airzoo_bench.evaluation.near_places import refuse_special
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.protocol.lookup import choose_protocol
from airzoo_bench.results.result import ReaderUsed

__all__ = ["Request", "open_as_trusted"]

_HERE = __name__


@dataclass(frozen=True)
class Request:
    """Which predictions a child opens, and how."""

    path: Path
    track: str | None
    protocol: str | None
    data: Path
    memory_bytes: int
    reader: str | None
    names: Path | None
    image_size: str | None

    def open(self) -> Given:
        """Open the predictions in this process."""
        read_by = ReadBy(self.reader, self.names, self.image_size)
        resources = Resources(self.memory_bytes)
        return open_predictions(self.path, self.track, self.protocol, self.data, resources, read_by)


@dataclass(frozen=True)
class _Opened:
    track: str
    predictions: Any
    reader: tuple[str, tuple[str, ...]] | None
    notes: tuple[str, ...]


def open_as_trusted(
    path: Path,
    track: str | None,
    protocol: str | None,
    data: Path,
    resources: Resources,
    read_by: ReadBy,
) -> Given:
    """Open predictions in this process where they are trusted, else in a child under limits."""
    if resources.limits is None:
        return open_predictions(path, track, protocol, data, resources, read_by)
    check_limits()
    refuse_special(path)
    request = Request(
        *(path, track, protocol, data, resources.memory_bytes),
        *(read_by.reader, read_by.names, read_by.image_size),
    )
    limits = resources.limits
    found: _Opened = _call("open_here", request, limits, {})
    kind: AnyTrack = TRACKS.get(found.track)
    predictions = kind.restored(
        found.predictions, lambda **scene: _call("open_scene_here", request, limits, scene)
    )
    chosen = choose_protocol(
        path, predictions.protocol, protocol, data, kind.protocol, kind.says_protocol
    )
    used = found.reader and ReaderUsed(name=found.reader[0], conventions=found.reader[1])
    return Given(kind, predictions, chosen, data, used, found.notes)


def _call(function: str, request: Request, limits: Limits, more: dict[str, Any]) -> Any:
    """Call a function of this file in a child; its files stay for as long as what it returns."""
    with ExitStack() as stack:
        parent = Path(tempfile.gettempdir())
        folder = stack.enter_context(temporary_folder(parent, "airzoo-bench"))
        found = call_limited(
            f"{_HERE}:{function}",
            {"request": request, **more},
            where=request.path,
            limits=limits,
            folder=folder,
        )
        weakref.finalize(getattr(found, "predictions", found), stack.pop_all().close)
        return found


def open_here(request: Request, folder: Path) -> _Opened:
    """Open predictions, in the child."""
    given = request.open()
    predictions = given.track.portable(given.predictions)
    used = (given.reader.name, given.reader.conventions) if given.reader else None
    return _Opened(given.track.name, predictions, used, given.notes)


def open_scene_here(request: Request, folder: Path, **scene: Any) -> Any:
    """Read one scene of predictions, in the child, into files of a folder."""
    given = request.open()
    return given.track.store_scene(given.predictions, folder, **scene)
