"""The files of hloc: which hold features and which matches, and what is in them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.formats.hdf5 import Hdf5File, dataset_names

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from airzoo_bench.geometry.arrays import Floats, Ints
    from airzoo_bench.readers.pictures import Picture

__all__ = [
    "MATCHES",
    "NO_MATCH",
    "Features",
    "check_indices",
    "hdf5_files",
    "kind_of",
    "pair_of_files",
    "pixels_of",
]

MATCHES = "/matches0"
NO_MATCH = -1
_KEYPOINTS = "/keypoints"
_SUFFIXES = (".h5", ".hdf5")
_MOST_FILES = 1000
_HEAD = 40
_LAST_INT16 = (1 << 15) - 1


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
        """Open a file of features."""
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
        """Return the keypoints of a picture, as hloc counts them."""
        import numpy as np

        name = self.by_key.get(picture.name.replace("/", "-"))
        if name is None:
            raise PredictionError(f"no features of {picture.name[:200]!r} in {self.file.path}")
        if name not in self._kept:
            given = pixels_of(self.file, name + _KEYPOINTS)
            if given.dtype == np.float16 and given.size:
                self._rounded = True
                self._step = max(self._step, float(np.spacing(np.abs(given).max())))
            self._check_size(name, picture)
            self.file.budget.hold(self.file.path, f"pixels of {name[:200]}", given.size * 8)
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


def pixels_of(file: Hdf5File, name: str) -> NDArray[Any]:
    """Read a dataset of pixels (N, 2)."""
    values = file.read(name)
    if values.ndim != 2 or values.shape[1] != 2 or values.dtype.kind not in "iuf":
        raise PredictionError(
            f"{name.rsplit('/', 1)[1]} is {values.dtype} of shape {values.shape}",
            expected="numbers of shape (N, 2)",
        )
    return values


def check_indices(matches: Ints, first: int, second: int) -> None:
    """Refuse matches that count other keypoints, or wrapped around at 32,767."""
    if matches.ndim != 1 or matches.dtype.kind != "i" or len(matches) != first:
        raise PredictionError(
            f"matches0 is {matches.dtype} of shape {matches.shape}, and its picture has "
            f"{counted(first, 'keypoint')}",
            expected="a whole number for each keypoint of the first picture",
            fix="match the features again: these are of another run",
        )
    wrapped = matches.dtype.itemsize == 2 and second - 1 > _LAST_INT16
    if wrapped or (matches < NO_MATCH).any():
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


def hdf5_files(path: Path) -> list[Path]:
    """Return the HDF5 files of a folder, or a file as it is."""
    if path.is_file():
        return [path]
    if not path.is_dir():
        return []
    found = itertools.islice(path.iterdir(), _MOST_FILES)
    return sorted(one for one in found if one.suffix in _SUFFIXES and one.is_file())


def kind_of(path: Path) -> str:
    """Return "matches" or "features", by the names of the first datasets; "" for others."""
    names = dataset_names(path, _HEAD)
    if any(name.endswith((MATCHES, "/keypoints0")) and name.count("/") <= 2 for name in names):
        return "matches"
    return "features" if any(name.endswith(_KEYPOINTS) for name in names) else ""


def pair_of_files(path: Path) -> tuple[Path, Path | None]:
    """Return the file of matches, and that of features where there is one."""
    beside = hdf5_files(path if path.is_dir() else path.parent)
    kinds = {one: kind_of(one) for one in {*beside, *hdf5_files(path)}}
    matches = [one for one in hdf5_files(path) if kinds[one] == "matches"]
    if len(matches) != 1:
        raise PredictionError(
            f"files of matches: {first_of([one.name for one in matches])}"
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
