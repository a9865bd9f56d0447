"""Names of the rows of VPR-methods-evaluation's descriptors, which its files do not hold."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.readers.names import read_names
from airzoo_bench.readers.retrieval import SceneImages, tile_images
from airzoo_bench.readers.vpr_log import VprLog

if TYPE_CHECKING:
    from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = ["BY_COUNT", "FIX", "NameSource", "name_source"]

_LISTED = (".jpg", ".jpeg", ".png")
_LISTED_BEFORE = (".jpg",)  # until March 2025, and in this case only
_TIMES_LISTED, _LEAST_LISTED = 8, 100_000  # what a log names may be any folder of this computer
FIX = "list the database images, then the queries, in the method's order, and add --names LIST"
_BY_FILE = "names are those of the _images_paths.txt beside the folders that info.log names"
_BY_LIST = "names are the lines of --names: each run's database images, then its queries"
_BY_LISTING = "names are the files in the folders that info.log names, in the order of their paths"
BY_COUNT = (
    "names are taken by order: the folders of info.log are neither the benchmark's nor below the "
    "predictions, and as many images as were described are in the benchmark, sorted by path"
)


@dataclass
class NameSource:
    """Gives names to rows, and remembers where they came from.

    Attributes
    ----------
    given : list of str or None
        The lines of ``--names`` that are left.
    path : Path or None
        Where these stand.
    folders : tuple of Path
        What a log may name must lie in one of these: it comes from a stranger.
    """

    given: list[str] | None
    path: Path | None
    folders: tuple[Path, ...]
    used: dict[str, None] = field(default_factory=dict)
    lists: dict[Path, None] = field(default_factory=dict)

    @property
    def said(self) -> tuple[str, ...]:
        """The conventions, for the result."""
        return tuple(self.used)

    def beside(self, path: Path) -> tuple[Path, ...]:
        """Return the lists of images that were read and do not lie below the predictions."""
        home = path.resolve()
        return tuple(one for one in self.lists if not one.resolve().is_relative_to(home))

    def of(
        self, log: VprLog, images: SceneImages, tiles: int, photos: int
    ) -> tuple[Sequence[str], Sequence[str], bool]:
        """Return the names of a run's database images and queries, and whether they are assumed."""
        if self.given is not None:
            return *self._from_list(tiles, photos), False
        listed = [
            _from_folder(self._ours(folder), rows)
            for folder, rows in ((log.database, tiles), (log.queries, photos))
        ]
        if listed[0] is None or listed[1] is None:
            self.used[BY_COUNT] = None
            return *_by_count(log, images, tiles, photos), True
        self.used |= dict.fromkeys((listed[0].said, listed[1].said))
        self.lists |= dict.fromkeys(one.file for one in listed if one and one.file)
        return listed[0].checked(tiles), listed[1].checked(photos), False

    def _ours(self, folder: str | None) -> str | None:
        """Return a folder that may be listed, None for another; which it is is not told."""
        if not folder:
            return None
        place = Path(os.path.realpath(folder))
        roots = [Path(os.path.realpath(root)) for root in self.folders]
        return folder if any(place.is_relative_to(root) for root in roots) else None

    def check_used_up(self) -> None:
        """Refuse a list of names that is longer than all rows."""
        if self.given:
            raise _other_count(self.path, f"{counted(len(self.given), 'name')} more than rows")

    def _from_list(self, tiles: int, photos: int) -> tuple[Sequence[str], Sequence[str]]:
        self.used[_BY_LIST] = None
        given = self.given or []
        if len(given) < tiles + photos:
            raise _other_count(
                self.path,
                f"{counted(len(given), 'name')} for {tiles:,} database images and "
                f"{counted(photos, 'query')}",
            )
        self.given = given[tiles + photos :]
        return given[:tiles], given[tiles : tiles + photos]


def name_source(names: Path | None, folders: tuple[Path, ...]) -> NameSource:
    """Make what names rows, by a list where there is one, else by what is in some folders."""
    return NameSource(None if names is None else read_names(names), names, folders)


def _other_count(path: Any, what: str) -> PredictionError:
    return PredictionError(
        what, where=path, expected="a name for each row of the descriptors", fix=FIX
    )


@dataclass(frozen=True)
class _Listed:
    folder: str
    names: list[str]
    said: str
    file: Path | None = None

    def checked(self, rows: int) -> Sequence[str]:
        if len(self.names) != rows:
            raise _other_count(
                self.folder, f"{counted(len(self.names), 'image')} for {counted(rows, 'row')}"
            )
        return _Below(self.folder, self.names)


@dataclass(frozen=True)
class _Below(Sequence[str]):
    """Paths of files in a folder, made when they are asked for: there may be millions."""

    folder: str
    names: list[str]

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[str]:
        return (f"{self.folder}/{name}" for name in self.names)

    @overload
    def __getitem__(self, place: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> _Below: ...
    def __getitem__(self, place: int | slice) -> str | _Below:
        if isinstance(place, slice):
            return _Below(self.folder, self.names[place])
        return f"{self.folder}/{self.names[place]}"


def _from_folder(folder: str | None, rows: int) -> _Listed | None:
    """Name the images of a folder as the method's dataset class does; None where it is not here."""
    if not folder or not _is_folder(folder):
        return None
    listed = Path(folder + "_images_paths.txt")
    if listed.is_file() and not listed.is_symlink():
        return _Listed(folder, read_names(listed), _BY_FILE, listed)
    files = sorted(_files(folder, _TIMES_LISTED * rows + _LEAST_LISTED))
    now = [name for name in files if name.lower().endswith(_LISTED)]
    before = [name for name in files if name.endswith(_LISTED_BEFORE)]
    return _Listed(folder, before if len(before) == rows != len(now) else now, _BY_LISTING)


def _is_folder(folder: str) -> bool:
    try:
        return Path(folder).is_dir()
    except OSError:  # a name that is longer than names can be
        return False


def _files(folder: str, most: int) -> Iterator[str]:
    """Yield files below a folder, relative to it, as ``glob("**/*")`` finds them."""
    count = 0
    for home, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        inside = Path(home).relative_to(folder).as_posix()
        for name in files:
            count += 1
            if count > most:
                raise _other_count(folder, f"more than {most:,} files")
            if not name.startswith("."):
                yield name if inside == "." else f"{inside}/{name}"


def _by_count(
    log: VprLog, images: SceneImages, tiles: int, photos: int
) -> tuple[list[str], list[str]]:
    """Take the benchmark's own order where one scene, or all, has as many images as rows."""
    choices: list[tuple[RetrievalTruth, ...]] = [
        (truth,) for truth in images.truths if images.home in ("", truth.scene)
    ]
    if len(images.truths) > 1:
        choices.append(images.truths)
    found = [
        (_tile_paths(some), asked)
        for some in choices
        if sum(len(truth.tiles) for truth in some) == tiles
        for asked in _photo_paths(some)
        if len(asked) == photos
    ]
    if len(found) == 1:
        for paths in found[0]:
            _check_order(log, paths)
        return found[0]
    what = "could be several scenes by their numbers" if found else "fit no scene"
    raise PredictionError(
        f"its {counted(tiles, 'database image')} and {counted(photos, 'query')} have no names, "
        f"and {what}",
        where=log.folder,
        expected="folders in info.log that are the benchmark's or below the predictions, or a list "
        "of names",
        fix=FIX,
    )


def _check_order(log: VprLog, paths: Sequence[str]) -> None:
    """Refuse images whose order depends on the folders that they lay in."""
    last = [path.rsplit("/", 1)[1] for path in paths]
    if len(set(last)) == len(last) and sorted(last) != last:
        raise PredictionError(
            f"its {counted(len(paths), 'image')} have no names, and all in one folder they have "
            "another order than in a folder a scene",
            where=log.folder,
            expected="folders in info.log that are the benchmark's or below the predictions, or a "
            "list of names",
            fix=FIX,
        )


def _tile_paths(truths: Sequence[RetrievalTruth]) -> list[str]:
    """Return the names of tile files, with their scene, by path."""
    return sorted(f"{truth.scene}/{name}" for truth in truths for _, name in tile_images(truth))


def _photo_paths(truths: Sequence[RetrievalTruth]) -> list[list[str]]:
    """Return the names of queries, and of all photos if they are more, by path."""
    tables = [[truth.queries for truth in truths]]
    if any(len(truth.excluded) for truth in truths):
        tables.append([pd for truth in truths for pd in (truth.queries, truth.excluded)])
    return [
        sorted(
            f"{one.split('/', 1)[0]}/{image}"
            for table in some
            for one, image in zip(table["id"], table["image"], strict=True)
        )
        for some in tables
    ]
