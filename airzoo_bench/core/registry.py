"""Tables of tracks, datasets and readers by name, and options of the command line.

Modules are imported when they are chosen; packages add theirs by an entry point of the group.
"""

from __future__ import annotations

import sys
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

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
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


class Registry:
    """Places ``module:name`` by name: of ``built_in.toml``, or of installed packages."""

    def __init__(self, kind: str) -> None:
        self.group, self.places = f"airzoo_bench.{kind}", _BUILT_IN[kind]

    def __contains__(self, name: str) -> bool:
        return name in self.places or name in _installed(self.group, tuple(sys.path))

    def names(self) -> list[str]:
        """Return all names: built-in first, in their own order, then others by name."""
        return [*self.places, *sorted(_installed(self.group, tuple(sys.path)).keys() - self.places)]

    def get(self, name: str) -> Any:
        """Import the object of a name, a built-in one first; raise KeyError for an unknown one."""
        if name in self.places:
            return resolve(self.places[name])
        return _installed(self.group, tuple(sys.path))[name].load()


@cache
def _installed(group: str, _: tuple[str, ...]) -> dict[str, EntryPoint]:
    """Return what other packages add to a group, searched once for each search path."""
    return {point.name: point for point in entry_points(group=group)}


TRACKS = Registry("tracks")  # each an `evaluation.info.TrackInfo`
DATASETS = Registry("datasets")  # each a `datasets.dataset.Dataset`
READERS = Registry("readers")  # each an `evaluation.predictions.Reader`


def load_track(name: str) -> Any:
    """Import the `airzoo_bench.evaluation.track.Track` of a name."""
    return resolve(TRACKS.get(name).track)
