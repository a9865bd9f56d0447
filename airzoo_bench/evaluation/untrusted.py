"""Opening predictions of strangers: a child reads them under limits, as `core.sandbox` says.

Predictions with a row a query come back whole. Of `ScenePredictions` a list comes back, and each
scene is read by a child of its own when it is opened.
"""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from airzoo_bench.core.files import temporary_folder
from airzoo_bench.core.registry import load_track
from airzoo_bench.core.sandbox import call_limited, check_limits
from airzoo_bench.evaluation.given import Given, ReadBy, open_predictions
from airzoo_bench.evaluation.near_places import refuse_special
from airzoo_bench.evaluation.track import Run, ScenePredictions
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
        run = Run(self.memory_bytes)
        return open_predictions(self.path, self.track, self.protocol, self.data, run, read_by)


@dataclass(frozen=True)
class _Opened:
    track: str
    predictions: Any
    reader: tuple[str, tuple[str, ...]] | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _ListedScenes(ScenePredictions):
    """Scenes as a child lists them; another child reads each when it is opened."""

    path: Path
    protocol: str | None
    unknown_files: tuple[str, ...]
    names: tuple[str, ...]
    request: Request
    run: Run | None = None

    @property
    def scenes(self) -> tuple[str, ...]:
        return self.names

    @contextmanager
    def opened(self, scene: str, *, limit_bytes: int, sampling: Any) -> Iterator[Any]:
        assert self.run is not None
        more = {"scene": scene, "limit_bytes": limit_bytes, "sampling": sampling}
        yield _call("open_scene_here", self.request, self.run, more)


def open_as_trusted(
    path: Path,
    track: str | None,
    protocol: str | None,
    data: Path,
    run: Run,
    read_by: ReadBy,
) -> Given:
    """Open predictions in this process where they are trusted, else in a child under limits."""
    if run.limits is None:
        return open_predictions(path, track, protocol, data, run, read_by)
    check_limits()
    refuse_special(path)
    request = Request(
        *(path, track, protocol, data, run.memory_bytes),
        *(read_by.reader, read_by.names, read_by.image_size),
    )
    found: _Opened = _call("open_here", request, run, {})
    predictions = found.predictions
    if isinstance(predictions, _ListedScenes):
        predictions = replace(predictions, run=run)
    kind = load_track(found.track)
    chosen = choose_protocol(path, predictions.protocol, protocol, data, kind.protocol)
    used = found.reader and ReaderUsed(name=found.reader[0], conventions=found.reader[1])
    return Given(kind, predictions, chosen, data, used, found.notes)


def _call(function: str, request: Request, run: Run, more: dict[str, Any]) -> Any:
    """Call a function of this file in a child; its files stay for as long as what it returns."""
    assert run.limits is not None
    with ExitStack() as stack:
        parent = Path(tempfile.gettempdir())
        folder = stack.enter_context(temporary_folder(parent, "airzoo-bench"))
        found = call_limited(
            f"{_HERE}:{function}",
            {"request": request, **more},
            where=request.path,
            limits=run.limits,
            folder=folder,
        )
        weakref.finalize(getattr(found, "predictions", found), stack.pop_all().close)
        return found


def open_here(request: Request) -> _Opened:
    """Open predictions, in the child."""
    given = request.open()
    found: Any = given.predictions
    if isinstance(found, ScenePredictions):
        found = _ListedScenes(
            found.path, found.protocol, tuple(found.unknown_files), tuple(found.scenes), request
        )
    used = (given.reader.name, given.reader.conventions) if given.reader else None
    return _Opened(given.track.info.name, found, used, given.notes)


def open_scene_here(
    request: Request, scene: str, limit_bytes: int, sampling: Any
) -> AbstractContextManager[Any]:
    """Open one scene of predictions, in the child."""
    predictions: Any = request.open().predictions
    opened: AbstractContextManager[Any] = predictions.opened(
        scene, limit_bytes=limit_bytes, sampling=sampling
    )
    return opened
