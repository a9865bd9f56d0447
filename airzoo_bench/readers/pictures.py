"""The pictures that matchers are given, by name, and matches between them as predictions."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.evaluation.predictions import QueryPredictions, ReadRequest
from airzoo_bench.formats.npz import Budget
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.matching.predictions import Correspondences, MatchingPredictions
from airzoo_bench.readers.names import ImageNames, names_in

_SLACK_PX = 1.0  # sub-pixel refinement oversteps the border
_BYTES_OF_MATCH = 160  # of memory: four numbers as read, moved, joined and sorted
_CROP = "_dom.tif"  # what `prepare --crops files` adds to a query's name

Pair = tuple["Picture", "Picture"]
Pixels = tuple[Floats, Floats]


@dataclass(frozen=True)
class Picture:
    """A photo, which has the id of its `query`, its crop of the map, or the `whole` map.

    `name` is the method's, `size` width and height; a crop begins at `origin` and is `of` a query.
    """

    name: str
    scene: str
    query: str | None
    size: tuple[int, int]
    origin: tuple[int, int] = (0, 0)
    whole: bool = False
    of: str = ""


class Pictures:
    """Photos, crops and maps of a protocol's scenes by their names."""

    def __init__(self, request: ReadRequest, change: Callable[[str], str] = str) -> None:
        """Take names; the method makes a `change` to them before it writes them."""
        self._change = change
        self._known: dict[tuple[str, str], Picture] = {}
        photos, crops, maps = [], [], []
        scenes = request.truths
        for scene in scenes:
            if not scene.map_per_query:
                dom = scene.maps[0].dom
                name, size = dom.path.name, (dom.width, dom.height)
                maps.append((scene.scene, name))
                self._known["map", scene.scene] = Picture(name, scene.scene, None, size, whole=True)
            sizes = zip(scene.cameras.width.tolist(), scene.cameras.height.tolist(), strict=True)
            rows = zip(names_in([scene.queries]), sizes, scene.crops.tolist(), strict=True)
            for (one, image), photo, (x, y, w, h) in rows:
                name = one.split("/", 1)[1] + _CROP
                photos.append((one, image))
                crops.append((one, name))
                self._known["query", one] = Picture(image, scene.scene, one, photo)
                self._known["crop", one] = Picture(name, scene.scene, None, (w, h), (x, y), of=one)
        left_out = names_in(scene.excluded for scene in scenes)
        kinds = (("query", photos, left_out), ("crop", crops, ()), ("map", maps, ()))
        self._names = [
            ImageNames(what, names, left_out=others, scenes=request.scenes, change=change)
            for what, names, others in kinds
        ]
        self._found: dict[str, Picture | None] = {}
        self.example = " and ".join((*(name for _, name in photos[:1]), *(n for _, n in crops[:1])))

    def find(self, name: str) -> Picture | None:
        """Return the picture of a name, or None."""
        if name not in self._found:
            ids = ((names.what, names.find(self._change(name))) for names in self._names)
            known = next((self._known[what, one] for what, one in ids if one is not None), None)
            self._found[name] = None if known is None else replace(known, name=name)
        return self._found[name]

    def pair(self, one: str, other: str) -> Pair | None:
        """Return the pictures of two names, see `paired`."""
        first = self.find(one)  # the other may be unclear where this is no picture
        return None if first is None else paired(first, self.find(other))

    def crop_of(self, photo: Picture) -> Picture:
        """Return the crop of a photo."""
        return self._known["crop", str(photo.query)]


def paired(first: Picture | None, second: Picture | None) -> Pair | None:
    """Return two pictures if one is a photo and the other a part of the map of its scene."""
    if first is None or second is None or first.scene != second.scene:
        return None
    return (first, second) if (first.query is None) != (second.query is None) else None


def matched_pixels(first: Floats, second: Floats, matches: NDArray[Any]) -> Pixels:
    """Return pairs of keypoints: of each of the first, `matches` has a number of the second, or -1.

    Numbers of 16 bits, as hloc writes them, wrap around at 32,767.
    """
    sound = matches.dtype.kind == "i" and matches.shape == (len(first),)
    narrow = matches.dtype.itemsize == 2 and len(second) > 1 << 15
    if not sound or narrow or (matches < -1).any() or (matches >= len(second)).any():
        what = f"matches are {matches.dtype} of shape {matches.shape}, or have numbers beyond the "
        what += f"{len(first):,} and {counted(len(second), 'keypoint')} of the pictures"
        fix = "match again, with at most 32,767 keypoints where numbers have 16 bits"
        raise PredictionError(what, fix=fix)
    found = np.flatnonzero(matches != -1)
    return first[found], second[matches[found]]


class MatchRows:
    """Matches of photos with crops or maps, query by query."""

    def __init__(self, path: Path, budget: Budget, reader: str | None, pictures: Pictures) -> None:
        """Begin with none."""
        self.path, self.budget, self.reader, self.pictures = path, budget, reader, pictures
        self._rows: dict[str, list[Pixels]] = {}
        self._crossed: list[str] = []
        self._sources: dict[tuple[str, tuple[int, int], bool], str] = {}
        self._count = 0

    def add(self, pair: Pair, xy: Pixels, source: str) -> None:
        """Take the matches of a pair, in pixels of the two pictures, corners being (0, 0)."""
        one, other = (np.asarray(side, float) if np.size(side) else np.zeros((0, 2)) for side in xy)
        if one.shape != other.shape or one.shape[1:] != (2,):
            what = f"reader {self.reader} takes matches of shapes {one.shape} and {other.shape}"
            raise PredictionError(what, expected="(N, 2) and (N, 2): x y in each picture")
        if pair[0].query is None:
            pair, one, other = pair[::-1], other, one
        photo, reference = pair
        query = str(photo.query)
        first = self._sources.setdefault((query, reference.origin, reference.whole), source)
        if first != source:
            what = f"{first[:200]} and {source[:200]} are both {query} with one part of the map"
            fix = "leave out one of the two: runs are not pooled"
            raise PredictionError(what, expected="the matches of each pair once", fix=fix)
        if reference.of not in ("", query):
            self._crossed.append(f"{photo.name[:200]} with {reference.name[:200]}")
        self._count += len(one)
        self.budget.hold(self.path, "its matches", self._count * _BYTES_OF_MATCH)
        self._check(photo, one)
        self._check(reference, other)
        self._rows.setdefault(query, []).append((one, other + reference.origin))

    def _check(self, picture: Picture, xy: Floats) -> None:
        if not np.isfinite(xy).all():
            raise PredictionError(f"pixels of {picture.name[:200]!r} are not finite")
        most = np.add(picture.size, _SLACK_PX)
        beyond = [(one < -_SLACK_PX) | (one > most) for one in (xy, xy[:, ::-1])]
        outside, turned = (np.asarray(one.any(axis=1)) for one in beyond)
        if outside.any():
            (x, y), fix = xy[outside][0], "x and y look exchanged: write x, the column, before y"
            if turned.any():
                fix = "match the files that prepare wrote, and write pixels of their full size"
                fix += "; for the whole map name files PHOTO_MAP: q0_dom.tif.npz" * bool(picture.of)
            many, size = counted(int(outside.sum()), "pixel"), "x".join(map(str, picture.size))
            what = f"{many} outside {picture.name[:200]!r}, {size} px, the first ({x:.1f}, {y:.1f})"
            raise PredictionError(what, expected="pixels of the picture at its full size", fix=fix)

    def notes(self, left_out: int, noun: str) -> tuple[str, ...]:
        """Say how many were left out, and which photos were matched with the crop of another."""
        left = f"{counted(left_out, noun)} of other pictures left out"
        crossed = f"photos matched with the crop of another: {first_of(self._crossed)}"
        return (*[left] * bool(left_out), *[crossed] * bool(self._crossed))

    def predictions(self, names: Iterable[str]) -> MatchingPredictions:
        """Return what was taken, in pixels of the whole map; `names` are what the file has."""
        if not self._rows:
            what = "pairs no photo with its crop or the map; it has "
            what += first_of([name[:200] for name in names])
            expected = f"pairs such as {self.pictures.example}"
            fix = "prepare with --crops files, and match each photo to its crop"
            raise PredictionError(what, where=self.path, expected=expected, fix=fix)
        counts = [sum(len(xy) for xy, _ in rows) for rows in self._rows.values()]
        offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        parts = [pair for rows in self._rows.values() for pair in rows]
        query_xy, map_xy = (np.concatenate(side) for side in zip(*parts, strict=True))
        content = Correspondences(offsets, query_xy, map_xy, "map", None, None)
        return QueryPredictions(self.path, None, np.array(list(self._rows), dtype=str), content)
