"""Names of images, as methods write them, and the ids that they mean.

Methods name an image by its path: absolute or relative to some folder, with or without its ending,
with either kind of slash, or by its last part alone. The id is the one whose own name the path ends
with. A path with a folder that is called as a scene means images of that scene only; of several
such folders the innermost counts, as in ``/east/exports/west/x.jpg``, which is of west. What names
no scene means the only image that it fits, and is refused where it fits several. A name with
positions, ``@east@north@...@x@.png``, means the image x.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any

import pandas as pd

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.evaluation.reader import Reading

_LIMIT_BYTES = 256 << 20
_ENDINGS = {suffix.removeprefix(".") for suffix in (*PHOTO_SUFFIXES, ".npy", ".txt")}
_NO_PARTS = ("", ".")
_FOLDERS_KEPT = 64

_Parts = tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ImageNames:
    """The images of a benchmark by their names; `what` is "query" or "tile"."""

    what: str
    alone: Mapping[str, str]  # ids by names of one part which no other name ends with: nearly all
    by_last: Mapping[str, list[tuple[_Parts, str, str]]]  # parts, scene and id by the last part
    left_out: Collection[str]  # ids of images whose names mean none
    scene_of: Callable[[str], str | None]  # the innermost scene in a folder's path, or its home's

    @classmethod
    def build(
        cls,
        what: str,
        names: Iterable[tuple[str, str]],
        *,
        left_out: Iterable[tuple[str, str]] = (),
        scenes: Iterable[str] = (),
        home: str = "",
        change: Callable[[str], str] = str,
    ) -> ImageNames:
        """Take ids with their images' names, relative to the folder of their scene."""
        others = dict(left_out)
        alone: dict[str, str] = {}
        by_last: dict[str, list[tuple[_Parts, str, str]]] = {}
        own = set()
        for one, raw in chain(names, others.items()):
            name = change(raw)
            own.add(_scene(one))
            last = _last(name)
            new = last not in alone and last not in by_last
            if new and last and "/" not in name and "\\" not in name:
                alone[last] = one
                continue
            found = by_last.setdefault(last, [])
            if last in alone:
                found.append(((last,), _scene(alone[last]), alone.pop(last)))
            found.append((_parts(name), _scene(one), one))
        scene_of = scene_finder({*scenes, *own}, change, scene_finder(own)(home))
        return cls(what, alone, by_last, frozenset(others), scene_of)

    def find(self, path: str) -> str | None:
        """Return the id of the image that a path means; None where it means none."""
        found = self._find(path)
        folder, _, last = path.strip().rpartition("/")
        if found is None and last.startswith("@"):
            return self._find(f"{folder}/{_stem(last).rstrip('@').rpartition('@')[2]}")
        return found

    def _find(self, path: str) -> str | None:
        folder, _, last = path.strip().rpartition("/")
        alone = self.alone.get(_stem(last))
        if alone is not None and alone not in self.left_out:
            return alone if self.scene_of(folder) in (None, _scene(alone)) else None
        fitting = self._fitting(_parts(path))
        longest = max((shared for shared, _ in fitting), default=0)
        best = [one for shared, one in fitting if shared == longest]
        asked = [one for one in best if one not in self.left_out]
        if len(best) == 1 or not asked:
            return asked[0] if asked else None
        raise PredictionError(
            f"{path[:200]!r} could be {first_of(best)}",
            expected=f"names that mean one {self.what} each",
            fix="write the scene before the name, as in " + asked[0],
        )

    def _fitting(self, parts: _Parts) -> list[tuple[int, str]]:
        """Return the ids that a path fits, with how many of its last parts are their names'."""
        if not parts:
            return []
        called = self.by_last.get(parts[-1], [])
        if parts[-1] in self.alone:
            one = self.alone[parts[-1]]
            called = [(parts[-1:], _scene(one), one)]
        named: list[tuple[int, str]] = []
        unnamed: list[tuple[int, str]] = []
        for own, scene, one in called:
            shared = min(len(parts), len(own))
            if parts[-shared:] != own[-shared:]:
                continue
            said = self.scene_of("/".join(parts[:-shared]))
            if said in (None, scene):
                (unnamed if said is None else named).append((shared, one))
        return named or unnamed

    def find_all(self, paths: Sequence[str], where: Path) -> list[str | None]:
        """Return the id of each path; refuse paths that all mean none, and two of one image."""
        try:
            found = [self.find(path) for path in paths]
        except PredictionError as error:
            raise error.inside(where) from error
        if paths and not any(found):
            ids = chain(self.alone.values(), (one[0][2] for one in self.by_last.values()))
            asked = (one for one in ids if one not in self.left_out)
            example = next(asked, "none, since the benchmark folder is missing")
            raise PredictionError(
                f"none of its names is that of a {self.what}: {first_of(map(repr, paths))}",
                where=where,
                expected=f"names such as {example}",
                fix="name the right protocol with --protocol, or give the names with --names",
            )
        if len(set(found) - {None}) < len(found) - found.count(None):
            times = Counter(one for one in found if one is not None)
            twice = next(one for one, count in times.items() if count > 1)
            named = [paths[row][:200] for row, one in enumerate(found) if one == twice]
            raise PredictionError(
                f"{named[0]!r} and {named[1]!r} are both {twice}",
                where=where,
                expected=f"each {self.what} once",
                fix="leave out one of the two",
            )
        return found


def scene_finder(
    scenes: Iterable[str], change: Callable[[str], str] = str, otherwise: str | None = None
) -> Callable[[str], str | None]:
    """Return what finds the innermost scene in a folder's path; the images of a folder are many."""
    spelled = {_folders(change(scene)): scene for scene in sorted(scenes)}
    lengths = sorted({*map(len, spelled)} - {0}, reverse=True)

    @lru_cache(_FOLDERS_KEPT)
    def scene_of(folder: str) -> str | None:
        parts = _folders(folder)
        ends = ((end, length) for end in range(len(parts), 0, -1) for length in lengths)
        runs = (parts[max(0, end - length) : end] for end, length in ends)
        return next((spelled[run] for run in runs if run in spelled), otherwise)

    return scene_of


def _parts(path: str) -> _Parts:
    """Split a path, and leave out the ending of its last part where it is that of a photo."""
    parts = _folders(path)
    return (*parts[:-1], *map(_stem, parts[-1:]))


def _folders(path: str) -> _Parts:
    parts = path.strip().replace("\\", "/").split("/")
    return tuple([part for part in parts if part not in _NO_PARTS])


def _last(path: str) -> str:
    """Return the last of a path's parts, empty where it has none."""
    last = path.strip().rpartition("/")[2]
    return "".join(_parts(path)[-1:]) if "\\" in last or last in _NO_PARTS else _stem(last)


def _stem(name: str) -> str:
    stem, dot, ending = name.rpartition(".")
    return stem if dot and ending.lower() in _ENDINGS else name


def _scene(one: str) -> str:
    return one.split("/", 1)[0]


def names_in(tables: Iterable[pd.DataFrame]) -> Iterator[tuple[str, str]]:
    """Yield the ids of images with their names, from the columns ``id`` and ``image``."""
    return chain.from_iterable(
        zip(table["id"].tolist(), table["image"].tolist(), strict=True) for table in tables
    )


def query_names(reading: Reading, where: Path, home: str = "") -> ImageNames:
    """Return the queries of a protocol by name."""
    truths = truths_of(reading, where)
    return ImageNames.build(
        "query",
        names_in(truth.queries for truth in truths),
        left_out=names_in(truth.excluded for truth in truths),
        scenes=reading.scenes,
        home=home,
    )


def truths_of(reading: Reading, where: Path) -> Sequence[Any]:
    """Return the scenes whose images names are looked up in; refuse a missing benchmark."""
    if not reading.truths:
        raise PredictionError(
            "its names of images mean nothing without the benchmark, whose folder is missing",
            where=where,
            expected="a prepared benchmark",
            fix="say where it is with --data, or prepare it",
        )
    return reading.truths


def read_names(path: Path) -> list[str]:
    """Read a list of image names, a line each; empty lines are left out."""
    text = read_text(path, PredictionError, "list of image names", _LIMIT_BYTES)
    lines = text.removeprefix("\ufeff").splitlines()
    return [line.strip() for line in lines if line.strip()]
