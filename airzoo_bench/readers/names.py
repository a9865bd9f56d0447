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
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import chain
from pathlib import Path

import pandas as pd

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.evaluation.predictions import ReadRequest
from airzoo_bench.formats.photos import PHOTO_SUFFIXES

_LIMIT_BYTES = 256 << 20
_ENDINGS = {suffix.removeprefix(".") for suffix in (*PHOTO_SUFFIXES, ".npy", ".txt")}
_FOLDERS_KEPT = 64

_Parts = tuple[str, ...]


class ImageNames:
    """The images of a benchmark by their names, which are relative to the folder of their scene.

    `what` is "query", "tile" or "photo"; `names` and `left_out` are ids with names; names of
    `left_out` mean none. A name without a scene is of the one that the folder `home` names.
    """

    def __init__(
        self,
        what: str,
        names: Iterable[tuple[str, str]],
        *,
        left_out: Iterable[tuple[str, str]] = (),
        scenes: Iterable[str] = (),
        home: str = "",
        change: Callable[[str], str] = str,
    ) -> None:
        self.what = what
        others = dict(left_out)
        self._left_out = frozenset(others)
        # By the last part: nearly always an id alone, whose name has no other part.
        self._by_last: dict[str, str | list[tuple[_Parts, str]]] = {}
        self._example, own = "", set()
        for one, raw in chain(names, others.items()):
            own.add(_scene(one))
            self._example = self._example or one
            parts = _parts(change(raw)) or ("",)
            found = self._by_last.get(parts[-1])
            if found is None and len(parts) == 1:
                self._by_last[parts[-1]] = one
                continue
            if not isinstance(found, list):
                found = [] if found is None else [(parts[-1:], found)]
                self._by_last[parts[-1]] = found
            found.append((parts, one))
        self._scene_of = scene_finder({*scenes, *own}, change, scene_finder(own)(folders_of(home)))

    def find(self, path: str) -> str | None:
        """Return the id of the image that a path means; None where it means none."""
        parts = _parts(path)
        found = self._find(parts, path)
        if found is None and parts and parts[-1].startswith("@"):
            last = _stem(parts[-1].rstrip("@").rpartition("@")[2])
            return self._find((*parts[:-1], last), path)
        return found

    def _find(self, parts: _Parts, path: str) -> str | None:
        fitting = self._fitting(parts)
        longest = max((shared for shared, _ in fitting), default=0)
        best = [one for shared, one in fitting if shared == longest]
        asked = [one for one in best if one not in self._left_out]
        if len(best) == 1 or not asked:
            return asked[0] if asked else None
        raise PredictionError(
            f"{path[:200]!r} could be {first_of(best)}",
            expected=f"names that mean one {self.what} each",
            fix="write the scene before the name, as in " + asked[0],
        )

    def _fitting(self, parts: _Parts) -> list[tuple[int, str]]:
        """Return the ids that a path fits, with how many of its last parts are their names'."""
        called = self._by_last.get(parts[-1], []) if parts else []
        if isinstance(called, str):
            called = [(parts[-1:], called)]
        named: list[tuple[int, str]] = []
        unnamed: list[tuple[int, str]] = []
        for own, one in called:
            shared = min(len(parts), len(own))
            if parts[-shared:] == own[-shared:]:
                said = self._scene_of(parts[:-shared])
                if said in (None, _scene(one)):
                    (unnamed if said is None else named).append((shared, one))
        return named or unnamed

    def find_all(self, paths: Sequence[str], where: Path) -> list[str | None]:
        """Return the id of each path; refuse paths that all mean none, and two of one image."""
        try:
            found = [self.find(path) for path in paths]
        except PredictionError as error:
            raise error.inside(where) from error
        if paths and not any(found):
            raise PredictionError(
                f"none of its names is that of a {self.what}: {first_of(map(repr, paths))}",
                where=where,
                expected=f"names such as {self._example or 'none, since there is no benchmark'}",
                fix="name the right protocol with --protocol, or give the names with --names",
            )
        times = Counter(one for one in found if one is not None)
        twice = next((one for one, count in times.items() if count > 1), None)
        if twice is not None:
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
) -> Callable[[_Parts], str | None]:
    """Return what finds the innermost scene among folders; the images of a folder are many."""
    spelled = {folders_of(change(scene)): scene for scene in sorted(scenes)}
    lengths = sorted({*map(len, spelled)} - {0}, reverse=True)

    @lru_cache(_FOLDERS_KEPT)
    def scene_of(parts: _Parts) -> str | None:
        ends = ((end, length) for end in range(len(parts), 0, -1) for length in lengths)
        runs = (parts[max(0, end - length) : end] for end, length in ends)
        return next((spelled[run] for run in runs if run in spelled), otherwise)

    return scene_of


def folders_of(path: str) -> _Parts:
    """Split a path at slashes of either kind."""
    parts = path.strip().replace("\\", "/").split("/")
    return tuple([part for part in parts if part not in ("", ".")])


def _parts(path: str) -> _Parts:
    """Split a path, and leave out a photo's ending of its last part."""
    parts = folders_of(path)
    return (*parts[:-1], _stem(parts[-1])) if parts else ()


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


def query_names(request: ReadRequest, home: str = "") -> ImageNames:
    """Return the queries of a protocol by name."""
    return ImageNames(
        "query",
        names_in(truth.queries for truth in request.truths),
        left_out=names_in(truth.excluded for truth in request.truths),
        scenes=request.scenes,
        home=home,
    )


def read_names(path: Path) -> list[str]:
    """Read a list of image names, a line each; empty lines are left out."""
    text = read_text(path, PredictionError, "list of image names", _LIMIT_BYTES)
    lines = text.removeprefix("\ufeff").splitlines()
    return [line.strip() for line in lines if line.strip()]
