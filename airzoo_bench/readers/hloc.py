"""Features and matches of hloc, sparse or dense, in HDF5."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.core.plurals import counted
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions
from airzoo_bench.formats.hdf5 import Hdf5File, dataset_names

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from airzoo_bench.geometry.arrays import Floats, Ints
    from airzoo_bench.readers.pictures import Picture, Pictures

__all__ = ["HLOC"]

_SUFFIXES = (".h5", ".hdf5")
_MOST_FILES = 1000
_HEAD = 40
_MATCHES, _KEYPOINTS = "/matches0", "/keypoints"
_LAST_INT16 = (1 << 15) - 1
_NO_MATCH = -1
_CENTRE = 0.5  # hloc counts from the centre of the first pixel


class Hloc(Reader):
    """Reads a file of matches with that of features beside it, or a folder with both."""

    track = "matching"
    title = "features and matches of hloc"
    layout = "HDF5, or a folder of it: PHOTO/keypoints, and PHOTO/CROP/matches0 or keypoints0"
    methods = ("hloc", "SuperPoint", "LightGlue", "SuperGlue", "LoFTR")

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        kinds = {_kind(one) for one in _files(path)}
        return 0.9 if "matches" in kinds else 0.6 * ("features" in kinds and path.is_file())

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        from airzoo_bench.readers.matching import scenes_of
        from airzoo_bench.readers.pictures import MatchRows, Pictures, nothing_matched

        matches, features = _pair_of_files(path)
        scenes = scenes_of(reading, path)
        opened = Hdf5File(matches, reading.memory_bytes)
        given = None if features is None else Features.of(features, reading.memory_bytes)
        pairs = _Pairs(opened, given, Pictures(scenes), Pictures(scenes, _dashed))
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
                rows.add(photo, reference, *xy)
            except PredictionError as error:
                raise error.inside(f"{matches}, pair {group[:200]}") from error
        if not pairs.used:
            raise nothing_matched(path, pairs.groups, pairs.pictures)
        notes = [f"{counted(left, 'pair')} of other pictures left out"] if left else []
        steps = [] if given is None else given.steps()
        return ReadPredictions(
            rows.predictions(rounded=bool(steps)),
            (
                "pixels are those of the picture at its full size, and whole numbers at the "
                "centres of pixels: 0.5 was added",
                *steps,
            ),
            (*notes, *steps),
        )


def _joins(one: Picture | None, other: Picture | None) -> bool:
    """Say whether a pair is of a photo and a part of the map of its scene."""
    if one is None or other is None or one.scene != other.scene:
        return False
    return (one.query is None) != (other.query is None)


@dataclass(eq=False)
class Features:
    """Keypoints by the name of their picture."""

    file: Hdf5File
    names: list[str]
    by_key: Mapping[str, str]
    _step: float = 0.0
    _rounded: bool = False
    _kept: dict[str, Floats] = field(default_factory=dict)

    @classmethod
    def of(cls, path: Path, limit_bytes: int) -> Features:
        """Open a file of features.

        Raises
        ------
        PredictionError
            It is damaged, or two names are one where hloc writes - for /.
        """
        file = Hdf5File(path, limit_bytes)
        names = [n.removesuffix(_KEYPOINTS) for n in file.names() if n.endswith(_KEYPOINTS)]
        by_key: dict[str, str] = {}
        for name in names:
            key = name.replace("/", "-")
            if key in by_key:
                raise PredictionError(
                    f"{by_key[key][:200]!r} and {name[:200]!r} have one name in files of matches, "
                    "which have - for /",
                    where=path,
                    fix="rename one of the two and run hloc again",
                )
            by_key[key] = name
        return cls(file, names, by_key)

    def keypoints(self, picture: Picture) -> Floats:
        """Return the keypoints of a picture, as hloc counts them.

        Raises
        ------
        PredictionError
            They are those of another size of the picture.
        """
        import numpy as np

        name = self.by_key.get(picture.name.replace("/", "-"))
        if name is None:
            raise PredictionError(f"no features of {picture.name[:200]!r} in {self.file.path}")
        if name not in self._kept:
            given = _pixels(self.file, name + _KEYPOINTS)
            if given.dtype == np.float16 and given.size:
                self._rounded = True
                self._step = max(self._step, float(np.spacing(np.abs(given).max())))
            self._check_size(name, picture)
            self._kept[name] = given.astype(np.float64)
        return self._kept[name]

    def _check_size(self, name: str, picture: Picture) -> None:
        if f"{name}/image_size" not in self.file:
            return
        size = tuple(self.file.read(f"{name}/image_size").reshape(-1).tolist())
        if size != picture.size:
            raise PredictionError(
                f"its image_size is {size}, and the picture has {picture.size} px",
                where=f"{self.file.path}, {name[:200]}",
                expected="features of the pictures of this benchmark",
                fix="extract the features again from the files that prepare wrote",
            )

    def steps(self) -> list[str]:
        """Say how far float16 has rounded the keypoints."""
        if not self._rounded:
            return []
        return [
            f"keypoints were rounded to float16, in steps of up to {self._step:g} px: hloc keeps "
            "float32 with as_half=False"
        ]


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
        ends = (_MATCHES, "/keypoints0")
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
            first, second = (_pixels(self.file, name) for name in dense)
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
        matches = self.file.read(group + _MATCHES)
        _check_indices(matches, len(first), len(second))
        found = np.flatnonzero(matches != _NO_MATCH)
        return first[found], second[matches[found]]


def _pixels(file: Hdf5File, name: str) -> NDArray[Any]:
    values = file.read(name)
    if values.ndim != 2 or values.shape[1] != 2 or values.dtype.kind != "f":
        raise PredictionError(
            f"{name.rsplit('/', 1)[1]} is {values.dtype} of shape {values.shape}",
            expected="floating point of shape (N, 2)",
        )
    return values


def _check_indices(matches: Ints, first: int, second: int) -> None:
    """Refuse matches that count other keypoints, or wrapped around at 32,767."""
    if matches.ndim != 1 or matches.dtype.kind != "i" or len(matches) != first:
        raise PredictionError(
            f"matches0 is {matches.dtype} of shape {matches.shape}, and its picture has "
            f"{counted(first, 'keypoint')}",
            expected="a whole number for each keypoint of the first picture",
            fix="match the features again: these are of another run",
        )
    wrapped = matches.dtype.itemsize == 2 and second - 1 > _LAST_INT16
    if wrapped or (matches < _NO_MATCH).any():
        raise PredictionError(
            f"matches0 is {matches.dtype}, and the other picture has {second:,} keypoints: beyond "
            f"{_LAST_INT16:,} numbers wrap around",
            expected=f"at most {_LAST_INT16 + 1:,} keypoints a picture",
            fix="extract fewer keypoints (max_keypoints), and match again",
        )
    if (matches >= second).any():
        raise PredictionError(
            f"matches0 names keypoint {int(matches.max()):,}, and the other picture has "
            f"{counted(second, 'keypoint')}",
            fix="match the features again: these are of another run",
        )


def _is_file_name(key: str) -> bool:
    return key.lower().endswith(PHOTO_SUFFIXES)


def _dashed(name: str) -> str:
    """Make the two separators one, as far as names are compared."""
    return name.replace("-", "/")


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    if not path.is_dir():
        return []
    found = itertools.islice(path.iterdir(), _MOST_FILES)
    return sorted(one for one in found if one.suffix in _SUFFIXES and one.is_file())


def _kind(path: Path) -> str:
    names = dataset_names(path, _HEAD)
    if any(name.endswith((_MATCHES, "/keypoints0")) and name.count("/") <= 2 for name in names):
        return "matches"
    return "features" if any(name.endswith(_KEYPOINTS) for name in names) else ""


def _pair_of_files(path: Path) -> tuple[Path, Path | None]:
    """Return the file of matches, and that of features where there is one."""
    beside = _files(path if path.is_dir() else path.parent)
    kinds = {one: _kind(one) for one in {*beside, *_files(path)}}
    matches = [one for one in _files(path) if kinds[one] == "matches"]
    if len(matches) != 1:
        raise PredictionError(
            f"{len(matches)} files of matches: {first_of([one.name for one in matches])}"
            if matches
            else "features without matches",
            where=path,
            expected="one file of matches, with that of its features beside it",
            fix="name the file of matches",
        )
    features = sorted(one for one, kind in kinds.items() if kind == "features")
    # hloc begins the name of a file of matches with that of its features.
    own = [one for one in features if matches[0].stem.startswith(one.stem)]
    chosen = max(own, key=lambda one: len(one.stem)) if own else None
    if chosen is None and len(features) > 1:
        raise PredictionError(
            f"which features {matches[0].name} counts is unclear: "
            f"{first_of([one.name for one in features])}",
            where=path,
            expected="one file of features beside that of matches",
            fix="put the two into a folder of their own",
        )
    return matches[0], chosen or (features[0] if features else None)


HLOC = Hloc()
"""Registered as ``hloc``."""
