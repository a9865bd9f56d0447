"""Names of images, as methods write them, and the ids that they mean.

Methods name an image by its path: absolute or relative to some folder, with or without its ending,
with either kind of slash, or by its last part alone. The id is the one whose own name the path ends
with; where several do, that whose scene stands in the path.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.ids import PHOTO_SUFFIXES

__all__ = ["ImageNames", "read_names"]

_LIMIT_BYTES = 256 << 20
_SLASHES = re.compile(r"[/\\]+")

_Parts = tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ImageNames:
    """The images of a benchmark, by what they are called.

    Attributes
    ----------
    what : str
        What they are, in the singular: "query", "tile".
    by_last : mapping of str to list of (parts, scene, id)
        Images by the last part of their names, without its ending.
    """

    what: str
    by_last: Mapping[str, list[tuple[_Parts, str, str]]]

    @classmethod
    def of(cls, what: str, names: Iterable[tuple[str, str]]) -> ImageNames:
        """Take ids with their images' names, relative to the folder of their scene.

        Parameters
        ----------
        what : str
        names : iterable of (id, name)
        """
        found: dict[str, list[tuple[_Parts, str, str]]] = {}
        for one, name in names:
            parts = _parts(name)
            found.setdefault(parts[-1], []).append((parts, one.split("/", 1)[0], one))
        return cls(what, found)

    def find(self, path: str) -> str | None:
        """Return the id of the image that a path means; None where it means none.

        Raises
        ------
        PredictionError
            It could be several; they are named.
        """
        parts = _parts(path)
        known = self.by_last.get(parts[-1], []) if parts else []
        fitting = [one for one in known if _ends_with(parts, one[0]) or _ends_with(one[0], parts)]
        if len(fitting) == 1:
            return fitting[0][2]
        in_scene = [one for one in fitting if one[1] in parts[:-1]]
        for several in (in_scene, fitting):
            longest = max((_shared(parts, one[0]) for one in several), default=0)
            best = [one[2] for one in several if _shared(parts, one[0]) == longest]
            if len(best) == 1:
                return best[0]
        if not fitting:
            return None
        ids = [one[2] for one in in_scene or fitting]
        raise PredictionError(
            f"{path[:200]!r} could be {first_of(ids)}",
            expected=f"names that mean one {self.what} each",
            fix="write the scene before the name, as in " + ids[0],
        )

    def find_all(self, paths: Sequence[str], where: Path) -> list[str | None]:
        """Return the id of each path.

        Raises
        ------
        PredictionError
            A path could mean several images, two mean the same, or none means any.
        """
        try:
            found = [self.find(path) for path in paths]
        except PredictionError as error:
            raise error.inside(where) from error
        if paths and not any(found):
            raise PredictionError(
                f"none of its names is that of a {self.what}: {first_of(map(repr, paths))}",
                where=where,
                expected=f"names such as {self._example()}",
                fix="name the right protocol with --protocol, or give the names with --names",
            )
        seen: dict[str, str] = {}
        for path, one in zip(paths, found, strict=True):
            if one is None:
                continue
            if one in seen:
                raise PredictionError(
                    f"{seen[one][:200]!r} and {path[:200]!r} are both {one}",
                    where=where,
                    expected=f"each {self.what} once",
                    fix="leave out one of the two",
                )
            seen[one] = path
        return found

    def _example(self) -> str:
        ids = (images[0][2] for images in self.by_last.values())
        return next(ids, "none, since the benchmark folder is missing")


def _parts(path: str) -> _Parts:
    """Split a path, and leave out the ending of its last part where it is that of a photo."""
    parts = [part for part in _SLASHES.split(path.strip()) if part not in ("", ".")]
    if parts and parts[-1].lower().endswith((*PHOTO_SUFFIXES, ".npy", ".txt")):
        parts[-1] = parts[-1].rsplit(".", 1)[0]
    return tuple(parts)


def _ends_with(parts: _Parts, end: _Parts) -> bool:
    return len(end) <= len(parts) and parts[len(parts) - len(end) :] == end


def _shared(one: _Parts, other: _Parts) -> int:
    """Count the last parts that two paths share."""
    pairs = zip(reversed(one), reversed(other), strict=False)
    count = 0
    for mine, theirs in pairs:
        if mine != theirs:
            break
        count += 1
    return count


def read_names(path: Path) -> list[str]:
    """Read a list of image names, a line each; empty lines are left out.

    Raises
    ------
    PredictionError
        It is missing, too large or no text.
    """
    text = read_text(path, PredictionError, "list of image names", _LIMIT_BYTES)
    lines = text.removeprefix("\ufeff").splitlines()
    return [line.strip() for line in lines if line.strip()]
