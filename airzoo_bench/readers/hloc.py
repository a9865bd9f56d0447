"""Features and matches of hloc, sparse or dense, in HDF5."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions
from airzoo_bench.formats.hdf5 import Hdf5File
from airzoo_bench.readers.hloc_files import (
    MATCHES,
    NO_MATCH,
    Features,
    check_indices,
    hdf5_files,
    kind_of,
    pair_of_files,
    pixels_of,
)

if TYPE_CHECKING:
    from airzoo_bench.geometry.arrays import Floats
    from airzoo_bench.readers.pictures import Picture, Pictures

__all__ = ["HLOC"]

_CENTRE = 0.5  # hloc counts from the centre of the first pixel


class Hloc(Reader):
    """Reads a file of matches with that of features beside it, or a folder with both."""

    track = "matching"
    title = "features and matches of hloc"
    layout = "HDF5, or a folder of it: PHOTO/keypoints, and PHOTO/CROP/matches0 or keypoints0"
    methods = ("hloc", "SuperPoint", "LightGlue", "SuperGlue", "LoFTR")

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        kinds = {kind_of(one) for one in hdf5_files(path)}
        return 0.9 if "matches" in kinds else 0.6 * ("features" in kinds and path.is_file())

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        from airzoo_bench.readers.matching import scenes_of
        from airzoo_bench.readers.pictures import MatchRows, Pictures, nothing_matched

        matches, features = pair_of_files(path)
        scenes = scenes_of(reading, path)
        limit = reading.memory_bytes // 2  # for each of the two files
        opened = Hdf5File(matches, limit)
        given = None if features is None else Features.of(features, limit)
        plain, dashed = (Pictures(scenes, reading.scenes, change) for change in (str, _dashed))
        pairs = _Pairs(opened, given, plain, dashed)
        rows = MatchRows(path, opened.budget)
        left = 0
        for group, one, other in pairs:
            if not _joins(one, other):
                left += 1
                continue
            swapped = one.query is None
            photo, reference = (other, one) if swapped else (one, other)
            try:
                first, second = pairs.pixels(group, one, other)
                xy = (second, first) if swapped else (first, second)
                rows.add(photo, reference, *xy, group)
            except PredictionError as error:
                raise error.inside(f"{matches}, pair {group[:200]}") from error
        if not pairs.used:
            raise nothing_matched(path, pairs.groups, pairs.pictures)
        notes = [f"{counted(left, 'pair')} of other pictures left out"] if left else []
        steps = [] if given is None else given.steps()
        return ReadPredictions(
            rows.predictions(),
            (
                "pixels are those of the picture at its full size, and whole numbers at the "
                "centres of pixels: 0.5 was added",
                *steps,
            ),
            (*notes, *steps),
            () if features is None or path.is_dir() else (features,),
        )


def _joins(one: Picture | None, other: Picture | None) -> bool:
    """Say whether a pair is of a photo and a part of the map of its scene."""
    if one is None or other is None or one.scene != other.scene:
        return False
    return (one.query is None) != (other.query is None)


@dataclass(eq=False)
class _Pairs:
    """The pairs of a file of matches, with the pictures that their names mean."""

    file: Hdf5File
    features: Features | None
    pictures: Pictures
    dashed: Pictures
    used: int = 0

    @property
    def groups(self) -> list[str]:
        """The names of the pairs."""
        ends = (MATCHES, "/keypoints0")
        names = [n.rsplit("/", 1)[0] for n in self.file.names() if n.endswith(ends)]
        return list(dict.fromkeys(names))

    def __iter__(self) -> Iterator[tuple[str, Any, Any]]:
        for group in self.groups:
            one, other = self._split(group)
            self.used += _joins(one, other)
            yield group, one, other

    def _split(self, group: str) -> tuple[Picture | None, Picture | None]:
        """Find the two pictures of a pair; older files join their names by _ and not by /."""
        first, slash, second = group.partition("/")
        if slash:
            return self._picture(first), self._picture(second)
        cuts = [at for at, letter in enumerate(group) if letter == "_"]
        halves = [(group[:at], group[at + 1 :]) for at in cuts]
        sides = [tuple(map(self._picture, two)) for two in halves if all(map(_is_file_name, two))]
        whole = [(one, other) for one, other in sides if one is not None and other is not None]
        if len(whole) > 1:
            named = [f"{one.name} with {other.name}" for one, other in whole]
            raise PredictionError(
                f"{group[:200]!r} could be {first_of(named)}",
                where=self.file.path,
                fix="match again with a newer hloc, which writes / between the names",
            )
        return whole[0] if whole else (None, None)

    def _picture(self, key: str) -> Picture | None:
        try:
            if self.features is None:
                return self.dashed.find(key)
            name = self.features.by_key.get(key)
            return self.dashed.find(key) if name is None else self.pictures.find(name)
        except PredictionError as error:
            raise error.inside(self.file.path) from error

    def pixels(self, group: str, one: Picture, other: Picture) -> tuple[Floats, Floats]:
        """Return the matched pixels of the first and second picture, corners being (0, 0)."""
        dense = [f"{group}/keypoints{side}" for side in (0, 1)]
        if not all(name in self.file for name in dense):
            first, second = self._indexed(group, one, other)
        elif f"{group}/keypoint_scores0" in self.file:
            raise PredictionError(
                "this is glue-factory's, whose matches0 count its own keypoints",
                fix="write query_xy and map_xy of the matches into an npz (docs/predictions.md)",
            )
        else:
            first, second = (pixels_of(self.file, name) for name in dense)
        if len(first) != len(second):
            raise PredictionError(
                f"keypoints0 has {len(first):,} rows, keypoints1 {len(second):,}",
                fix="write the file again",
            )
        return first + _CENTRE, second + _CENTRE

    def _indexed(self, group: str, one: Picture, other: Picture) -> tuple[Floats, Floats]:
        import numpy as np

        if self.features is None:
            raise PredictionError(
                "counts keypoints of a file of features, which is not beside it",
                expected="the .h5 of extract_features in the same folder",
                fix="copy it there, or name the folder that holds both",
            )
        first, second = self.features.keypoints(one), self.features.keypoints(other)
        matches = self.file.read(group + MATCHES)
        check_indices(matches, len(first), len(second))
        found = np.flatnonzero(matches != NO_MATCH)
        return first[found], second[matches[found]]


def _is_file_name(key: str) -> bool:
    return key.lower().endswith(PHOTO_SUFFIXES)


def _dashed(name: str) -> str:
    """Make the two separators one, as far as names are compared."""
    return name.replace("-", "/")


HLOC = Hloc()
"""Registered as ``hloc``."""
