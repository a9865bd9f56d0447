"""The pictures that matchers are given, by name, and matches between them as predictions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.formats.budget import Budget
from airzoo_bench.readers.names import ImageNames, names_in

if TYPE_CHECKING:
    from airzoo_bench.geometry.arrays import Floats
    from airzoo_bench.matching.predictions import MatchingPredictions
    from airzoo_bench.matching.truth import MatchingTruth

__all__ = ["MatchRows", "Picture", "Pictures", "nothing_matched"]

_SLACK_PX = 1.0  # sub-pixel refinement oversteps the border
_BYTES_OF_MATCH = 160  # of memory: four numbers as read, moved, joined and sorted
# Pixels of nearly all photos reach the far part of them, unless they are those of smaller pictures.
_FAR_PART, _LEAST_MATCHES, _LEAST_QUERIES = 0.75, 100, 3
_CROP = "_dom.tif"  # what `prepare --crops files` adds to a query's name


@dataclass(frozen=True)
class Picture:
    """A photo, a query's crop of the map, or the whole map.

    Attributes
    ----------
    name : str
        As the method has it.
    scene : str
    query : str or None
        The id of a photo; None of crops and maps.
    size : tuple of int
        Width and height.
    origin : tuple of int
        Where a crop begins in the map.
    whole : bool
        Whether it is a whole map.
    """

    name: str
    scene: str
    query: str | None
    size: tuple[int, int]
    origin: tuple[int, int] = (0, 0)
    whole: bool = False


class Pictures:
    """Photos, crops and maps of scenes by their names.

    Parameters
    ----------
    scenes : sequence of MatchingTruth
        Names, sizes and crops are taken from them, and nothing else.
    known : sequence of str
        Ids of further scenes that paths may name, see `Reading`.
    change : callable, optional
        What the method does to names before it writes them.
    """

    def __init__(
        self,
        scenes: Sequence[MatchingTruth],
        known: Sequence[str] = (),
        change: Callable[[str], str] = str,
    ) -> None:
        self._change = change
        self._known: dict[tuple[str, str], Picture] = {}
        photos, crops, maps = [], [], []
        for scene in scenes:
            if scene.scene_map is not None:
                dom = scene.scene_map.dom
                maps.append((scene.scene, dom.path.name))
                size = (dom.width, dom.height)
                self._known["map", scene.scene] = Picture(
                    dom.path.name, scene.scene, None, size, whole=True
                )
            for one, image, photo, crop in _queries(scene):
                photos.append((one, image))
                name = one.split("/", 1)[1] + _CROP
                crops.append((one, name))
                self._known["query", one] = Picture(image, scene.scene, one, photo)
                self._known["crop", one] = Picture(name, scene.scene, None, crop[2:], crop[:2])
        left_out = names_in(scene.excluded for scene in scenes)
        self._names = [
            ImageNames.of("query", photos, left_out=left_out, scenes=known, change=change),
            ImageNames.of("crop", crops, scenes=known, change=change),
            ImageNames.of("map", maps, scenes=known, change=change),
        ]
        self._found: dict[str, Picture | None] = {}

    @property
    def example(self) -> str:
        """Names of a photo and its crop, for messages."""
        ids = [one for what, one in self._known if what == "query"]
        stem = ids[0].split("/", 1)[1] if ids else "photo"
        return f"{stem} and {stem}{_CROP}"

    def find(self, name: str) -> Picture | None:
        """Return the picture of a name; None where it is that of none."""
        if name not in self._found:
            self._found[name] = self._sought(name)
        return self._found[name]

    def _sought(self, name: str) -> Picture | None:
        for names in self._names:
            one = names.find(self._change(name))
            if one is not None:
                known = self._known[names.what, one]
                return Picture(
                    name, known.scene, known.query, known.size, known.origin, known.whole
                )
        return None

    def crop_of(self, photo: Picture) -> Picture:
        """Return the crop of a photo."""
        return self._known["crop", str(photo.query)]


def _queries(scene: MatchingTruth) -> Iterable[tuple[str, str, tuple[int, int], Any]]:
    cameras = scene.cameras
    sizes = zip(cameras.width.tolist(), cameras.height.tolist(), strict=True)
    crops = map(tuple, scene.crops.tolist())
    table = scene.queries
    return zip(table["id"].tolist(), table["image"].tolist(), sizes, crops, strict=True)


@dataclass(eq=False)
class MatchRows:
    """Matches of photos with crops or maps, query by query.

    Attributes
    ----------
    path : Path
    budget : Budget
    """

    path: Path
    budget: Budget
    _rows: dict[str, list[tuple[Floats, Floats]]] = field(default_factory=dict)
    _pairs: dict[tuple[str, tuple[int, int], bool], str] = field(default_factory=dict)
    _farthest: dict[str, Floats] = field(default_factory=dict)
    _count: int = 0

    @property
    def empty(self) -> bool:
        """Whether no pair was taken yet."""
        return not self._rows

    def add(
        self, photo: Picture, reference: Picture, photo_xy: Floats, map_xy: Floats, source: str
    ) -> None:
        """Take the matches of a pair, in pixels of the two pictures, corners being (0, 0)."""
        first = self._pairs.setdefault(
            (str(photo.query), reference.origin, reference.whole), source
        )
        if first != source:
            raise PredictionError(
                f"{first[:200]} and {source[:200]} are both {photo.query} with the same part of "
                "the map",
                expected="the matches of each pair once, and not those of two runs together",
                fix="leave out one of the two",
            )
        self._count += len(photo_xy)
        self.budget.hold(self.path, "its matches", self._count * _BYTES_OF_MATCH)
        self._check(photo, photo_xy, "photo")
        self._check(reference, map_xy, "map" if reference.whole else "crop")
        rows = self._rows.setdefault(str(photo.query), [])
        rows.append((photo_xy, map_xy + reference.origin))

    def _check(self, picture: Picture, xy: Floats, kind: str) -> None:
        import numpy as np

        if not np.isfinite(xy).all():
            raise PredictionError(f"pixels of {picture.name[:200]!r} are not finite")
        if not len(xy):
            return
        outside = ((xy < -_SLACK_PX) | (xy > np.add(picture.size, _SLACK_PX))).any(axis=1)
        if outside.any():
            width, height = picture.size
            x, y = xy[outside][0]
            raise PredictionError(
                f"{counted(int(outside.sum()), 'pixel')} of {picture.name[:200]!r} outside it, the "
                f"first at ({x:.1f}, {y:.1f}); it is a {kind} of {width}x{height} px",
                expected="pixels of the picture at its full size",
                fix="was another picture matched, or one of another size? Match the files that "
                "prepare wrote, and write pixels of their full size",
            )
        farthest = (xy / picture.size).max(axis=0)
        self._farthest[kind] = np.maximum(self._farthest.get(kind, farthest), farthest)

    def predictions(self) -> MatchingPredictions:
        """Return what was taken as predictions, in pixels of the whole map."""
        import numpy as np

        from airzoo_bench.evaluation.queries import QueryPredictions
        from airzoo_bench.matching.predictions import Correspondences

        self._refuse_smaller()
        counts = [sum(len(xy) for xy, _ in rows) for rows in self._rows.values()]
        offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        parts = [pair for rows in self._rows.values() for pair in rows]
        sides = [np.concatenate([np.zeros((0, 2)), *side]) for side in zip(*parts, strict=True)]
        query_xy, map_xy = sides if sides else (np.zeros((0, 2)), np.zeros((0, 2)))
        content = Correspondences(offsets, query_xy, map_xy, "map", None, None)
        return QueryPredictions(self.path, None, np.array(list(self._rows), dtype=str), content)

    def _refuse_smaller(self) -> None:
        if self._count < _LEAST_MATCHES or len(self._rows) < _LEAST_QUERIES:
            return
        for kind in ("photo", "crop"):
            far = self._farthest.get(kind)
            if far is not None and (far < _FAR_PART).all():
                raise PredictionError(
                    f"no pixel of {counted(len(self._rows), 'query')} lies beyond {far[0]:.0%} of "
                    f"the width and {far[1]:.0%} of the height of its {kind}: they look like "
                    "pixels of smaller pictures",
                    where=self.path,
                    expected="pixels of the pictures at their full size",
                    fix="multiply x and y by the ratio of the widths and of the heights, or state "
                    "the size that they belong to where the layout has a field for it",
                )


def nothing_matched(path: Path, names: Iterable[str], pictures: Pictures) -> PredictionError:
    """Make the error of a file that pairs no photo with a part of the map."""
    return PredictionError(
        f"pairs no photo with its crop or the map; it has {first_of([n[:200] for n in names])}",
        where=path,
        expected=f"pairs such as {pictures.example}",
        fix="prepare with --crops files, and match each photo to its crop",
    )
