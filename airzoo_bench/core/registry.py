"""Tables of tracks, datasets and readers by name, and options of the command line.

Modules are imported when they are chosen; packages add theirs by an entry point of the group.
"""

from __future__ import annotations

import logging
import sys
import tomllib
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import UserError, printable

_LOG = logging.getLogger(__name__)  # which prints warnings on stderr
_BUILT_IN = tomllib.loads(Path(__file__).with_name("built_in.toml").read_text("utf-8"))


@dataclass(frozen=True)
class Option:
    """An option of the command line, as an annotation of a field of a dataclass of settings.

    ``pixels: Annotated[int, Option("pixels", "Of the longer side.", least=64)] = 640`` is
    ``--pixels``; without a default it must be given, and ``--no-`` turns a bool off.
    """

    name: str
    help: str
    least: float | None = None
    most: float | None = None


def resolve(place: str) -> Any:
    """Import ``module:name``, such as "airzoo_bench.retrieval.info:INFO"."""
    return EntryPoint("", place, "").load()


class Registry:
    """Instances of a class by name: of ``built_in.toml``, or of installed packages."""

    def __init__(self, kind: str, base: str) -> None:
        self.kind, self.base, self.places = kind, base, _BUILT_IN[kind]

    def __contains__(self, name: str) -> bool:
        return name in self.places or name in self._installed()

    def names(self) -> list[str]:
        """Return all names: built-in first, in their own order, then others by name."""
        return [*self.places, *sorted(self._installed())]

    def get(self, name: str) -> Any:
        """Import the object of a name; raise KeyError for an unknown one."""
        if name in self.places:
            return resolve(self.places[name])
        with self.blaming(name):
            found, base = self._installed()[name].load(), resolve(self.base)
            lacking = ", ".join(one for one in base.__annotations__ if not hasattr(found, one))
            if lacking or not isinstance(found, base):
                raise TypeError(f"no instance of {self.base}, lacks {lacking or 'its methods'}")
            return found

    def load_all(self) -> dict[str, Any]:
        """Import the objects of all names; one of another package that fails is left out."""
        found = {}
        for name in self.names():
            with self.warning(name):
                found[name] = self.get(name)
        return found

    @contextmanager
    def blaming(self, name: str, task: str = "") -> Iterator[None]:
        """Turn a fault of another package, at a task, into an error that names it and the line."""
        try:
            yield
        except Exception as error:
            point = self._installed().get(name)
            if point is None or isinstance(error, (UserError, MemoryError)):
                raise
            calls = traceback.extract_tb(error.__traceback__)
            own = [one for one in calls if point.module.split(".")[0] in one.filename][-1:]
            line = "".join(f", line {one.lineno} of {Path(one.filename).name}" for one in own)
            what = f"{type(error).__name__}: {printable(error)}{line}{printable(task)}"
            raise UserError(what, where=_describe(self.kind, point)) from error

    @contextmanager
    def warning(self, name: str) -> Iterator[None]:
        """Leave out what another package cannot do, with a line on stderr."""
        try:
            with self.blaming(name):
                yield
        except UserError as error:
            _LOG.warning("airzoo-bench: left out: %s", str(error).partition("\n")[0])

    def _installed(self) -> dict[str, EntryPoint]:
        return _search(self.kind, tuple(sys.path))


@cache
def _search(kind: str, _: tuple[str, ...]) -> dict[str, EntryPoint]:
    """Return what other packages add, searched once for each search path."""
    found: dict[str, EntryPoint] = {}
    for one in entry_points(group=f"airzoo_bench.{kind}"):
        if one.name in _BUILT_IN[kind] or one.name in found:
            _LOG.warning("airzoo-bench: left out: %s: name taken, rename it", _describe(kind, one))
        else:
            found[one.name] = one
    return found


def _describe(kind: str, point: EntryPoint) -> str:
    return f"{kind[:-1]} {point.name} (package {getattr(point.dist, 'name', '')})"


TRACKS = Registry("tracks", "airzoo_bench.evaluation.info:TrackInfo")
DATASETS = Registry("datasets", "airzoo_bench.datasets.dataset:Dataset")
READERS = Registry("readers", "airzoo_bench.evaluation.predictions:Reader")


def load_track(name: str) -> Any:
    """Import the `airzoo_bench.evaluation.track.Track` of a name."""
    return resolve(TRACKS.get(name).track)
