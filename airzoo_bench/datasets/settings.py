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
    keep_going: bool = False


@dataclass(frozen=True)
class PrepareSettings:
    """Options of every dataset.

    Attributes
    ----------
    folder : Path
        The benchmark folder to make; it appears when it is complete.
    root : Path
        The data root, for protocols to start from and for what is kept between runs.
    tiles_on_disk : bool
        Write each tile as PNG; otherwise tiles are windows of the map.
    crops_on_disk : bool
        Write the crop of each query as two GeoTIFF; otherwise crops are windows of the map.
    copy : bool
        Copy photos, maps and clouds into the folder; otherwise they are left where they are.
    replace : bool
        Whether a folder that stands there is replaced.
    engine : Engine
        Where work is done that is shared out; the benchmark does not depend on it.
    progress : Progress
    note : callable
        Takes a sentence for the user while the folder is made.
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
    """Lines that `prepare` prints about a scene; `facts` has one for each part."""

    photos: int
    facts: tuple[str, ...] = ()
    tracks: Mapping[str, TrackSummary] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Prepared:
    """The result of `prepare`.

    `protocols` are names with their tracks; `summaries` and `failed` (why it could not be made) are
    by scene.
    """

    folder: Path
    protocols: Mapping[str, str]
    summaries: Mapping[str, SceneSummary] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)
