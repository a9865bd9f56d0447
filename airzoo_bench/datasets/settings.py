"""Options of every dataset, and the result of `prepare`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.engines.engine import HERE, Engine

Files = list[str] | None
"""What is given as SCENE=FILE, repeated."""


@dataclass(frozen=True)
class SourceOptions:
    """The options that a dataset has unless it states more."""

    source: Path
    scene: list[str] | None = None


@dataclass(frozen=True)
class PrepareSettings:
    """Options of every dataset.

    `folder`, which appears when it is complete, is the benchmark folder to make; `root` is the data
    root, for protocols to start from and for what is kept between runs. Tiles and crops are written
    as files if they are wanted `on_disk`, else they are windows of the map; `copy` puts photos,
    maps and clouds into the folder; `replace` allows to replace one that is there. `note` takes
    sentences for the user. The benchmark does not depend on the `engine`.
    """

    folder: Path
    root: Path
    tiles_on_disk: bool = False
    crops_on_disk: bool = False
    copy: bool = False
    replace: bool = False
    engine: Engine = HERE
    progress: Progress = silent
    note: Callable[[str], None] = lambda _: None

    def __reduce__(self) -> tuple[Callable[[], PrepareSettings], tuple[()]]:
        """Leave out what other processes cannot show."""
        flags = (self.tiles_on_disk, self.crops_on_disk, self.copy, self.replace)
        places = (self.folder.absolute(), self.root.absolute())
        return partial(PrepareSettings, *places, *flags), ()


@dataclass(frozen=True)
class TrackSummary:
    """A line on a scene's truth for a track, its queries, and how many photos are left out."""

    text: str
    count: int
    left_out: int = 0


@dataclass(frozen=True)
class SceneSummary:
    """Lines that `prepare` prints about a scene; `facts` has one for each part.

    `without_truth` says why a track has no truth, where the dataset's own reason is not the one.
    """

    photos: int
    facts: tuple[str, ...] = ()
    tracks: Mapping[str, TrackSummary] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    without_truth: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Prepared:
    """The result of `prepare`.

    `protocols` are names with their tracks; `summaries` are by scene.
    """

    folder: Path
    protocols: Mapping[str, str]
    summaries: Mapping[str, SceneSummary] = field(default_factory=dict)
