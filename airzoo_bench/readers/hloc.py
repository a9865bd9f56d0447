"""Features and matches of hloc, sparse or dense, in HDF5."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.evaluation.predictions import PredictionFile, Reader, ReadRequest
from airzoo_bench.formats.foreign_arrays import Hdf5File, dataset_names
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.readers.pictures import (
    MatchRows,
    Pair,
    Picture,
    Pictures,
    Pixels,
    matched_pixels,
    paired,
)

_CENTRE = 0.5  # hloc counts from the centre of the first pixel
_MATCHES, _DENSE, _KEYPOINTS = "/matches0", "/keypoints0", "/keypoints"
_SUFFIXES = (".h5", ".hdf5")
_MOST_FILES, _HEAD = 1000, 40


class _Hloc(Reader):
    """Reads a file of matches with a file of features next to it, or a folder with both."""

    track = "matching"
    title = "features and matches of hloc"
    layout = "HDF5, or a folder of it: PHOTO/keypoints, and PHOTO/CROP/matches0 or keypoints0"
    methods = ("hloc", "SuperPoint", "LightGlue", "SuperGlue", "LoFTR")
    conventions = (
        "pixels of the picture at its full size, whole numbers at centres: 0.5 was added",
    )

    def recognise(self, path: Path) -> float:
        kinds = {_kind_of(one) for one in _hdf5_files(path)}
        return 0.9 if "matches" in kinds else 0.6 * ("features" in kinds and path.is_file())

    def read(self, path: Path, request: ReadRequest) -> PredictionFile:
        matches, features = _pair_of_files(path)
        limit = request.memory_bytes // 2  # for each of the two files
        file = Hdf5File(matches, limit)
        given = None if features is None else _Features(features, limit)
        pictures = Pictures(request)
        dashed = Pictures(request, lambda name: name.replace("-", "/"))

        def picture(key: str) -> Picture | None:
            name = None if given is None else given.names.get(key)
            return dashed.find(key) if name is None else pictures.find(name)

        ends = (_MATCHES, _DENSE)
        pairs = (name.rsplit("/", 1)[0] for name in file.names() if name.endswith(ends))
        groups = list(dict.fromkeys(pairs))
        rows, left = MatchRows(path, file.budget, request.reader, pictures), 0
        for group in groups:
            try:
                pair = paired(*map(picture, group.split("/"))) if group.count("/") == 1 else None
                if pair is None:
                    left += 1
                else:
                    rows.add(pair, _pixels(file, given, group, pair), group)
            except PredictionError as error:
                raise error.inside(f"{matches}, pair {group[:200]}") from error
        steps = () if given is None else given.steps()
        beside = () if features is None or path.is_dir() else (features,)
        predictions, notes = rows.predictions(groups), (*rows.notes(left, "pair"), *steps)
        return PredictionFile(predictions, (*self.conventions, *steps), notes, beside)


class _Features:
    """Keypoints by the name of their picture, with - for / as files of matches have it."""

    def __init__(self, path: Path, limit_bytes: int) -> None:
        self.file = Hdf5File(path, limit_bytes)
        self._step = 0.0
        self._kept: dict[str, Floats] = {}
        found = (name for name in self.file.names() if name.endswith(_KEYPOINTS))
        names = [one.removesuffix(_KEYPOINTS) for one in found]
        self.names = {name.replace("/", "-"): name for name in names}

    def keypoints(self, picture: Picture, partner: Picture) -> Floats:
        """Return the keypoints of a picture of a pair, as hloc counts them."""
        name = self.names.get(picture.name.replace("/", "-"))
        if name is None:
            raise PredictionError(f"no features of {picture.name[:200]!r} in {self.file.path}")
        if name not in self._kept:
            given = _pixels_of(self.file, name + _KEYPOINTS)
            if given.dtype == np.float16 and given.size:
                self._step = max(self._step, float(np.spacing(np.abs(given).max())))
            if f"{name}/image_size" in self.file:
                size = tuple(self.file.read(f"{name}/image_size").reshape(-1).tolist())
                if size != picture.size:
                    what = f"its image_size is {size}, and the picture has {picture.size} px"
                    fix = "extract the features again from the files that prepare wrote"
                    if size == partner.size:
                        fix = f"that is {partner.name[:200]}'s: name the photo first in a pair"
                    raise PredictionError(what, where=f"{self.file.path}, {name[:200]}", fix=fix)
            self.file.budget.hold(self.file.path, f"pixels of {name[:200]}", given.size * 8)
            self._kept[name] = given.astype(np.float64)
        return self._kept[name]

    def steps(self) -> tuple[str, ...]:
        """Say how far float16 has rounded the keypoints."""
        said = f"keypoints were rounded to float16, in steps of up to {self._step:g} px: "
        return (said + "hloc keeps float32 with as_half=False",) if self._step else ()


def _pixels(file: Hdf5File, features: _Features | None, group: str, pair: Pair) -> Pixels:
    """Return the matched pixels of the first and second picture, corners being (0, 0)."""
    dense = [f"{group}/keypoints{side}" for side in (0, 1)]
    if all(name in file for name in dense):
        first, second = (_pixels_of(file, name) for name in dense)
        return first + _CENTRE, second + _CENTRE
    if features is None:
        what = "counts keypoints of a file of features, which is not beside it"
        raise PredictionError(what, fix="copy the .h5 of extract_features there")
    first, second = (features.keypoints(*two) for two in (pair, pair[::-1]))
    return matched_pixels(first + _CENTRE, second + _CENTRE, file.read(group + _MATCHES))


def _pixels_of(file: Hdf5File, name: str) -> NDArray[Any]:
    """Read a dataset of pixels (N, 2)."""
    values = file.read(name)
    if values.ndim != 2 or values.shape[1] != 2 or values.dtype.kind not in "iuf":
        what = f"{name.rsplit('/', 1)[1]} is {values.dtype} of shape {values.shape}"
        raise PredictionError(what, expected="numbers of shape (N, 2)")
    return values


def _hdf5_files(path: Path) -> list[Path]:
    """Return the HDF5 files of a folder, or a file as it is."""
    found = itertools.islice(path.iterdir(), _MOST_FILES) if path.is_dir() else [path]
    return sorted(one for one in found if one.suffix in _SUFFIXES and one.is_file())


def _kind_of(path: Path) -> str:
    """Return "matches" or "features", by the names of the first datasets; "" for others."""
    names = dataset_names(path, _HEAD)
    if any(name.endswith((_MATCHES, _DENSE)) and name.count("/") <= 2 for name in names):
        return "matches"
    return "features" if any(name.endswith(_KEYPOINTS) for name in names) else ""


def _pair_of_files(path: Path) -> tuple[Path, Path | None]:
    """Return the file of matches, and the file of features where there is one."""
    kinds = {one: _kind_of(one) for one in _hdf5_files(path)}
    matches = [one for one, kind in kinds.items() if kind == "matches"]
    beside = _hdf5_files(path if path.is_dir() else path.parent)
    features = sorted(one for one in beside if kinds.get(one, _kind_of(one)) == "features")
    # hloc begins the name of a file of matches with that of its features.
    own = [one for one in features if matches and matches[0].stem.startswith(one.stem)] or features
    longest = max((len(one.stem) for one in own), default=0)
    best = [one for one in own if len(one.stem) == longest]
    if len(matches) != 1 or len(best) > 1:
        what = f"has {counted(len(matches), 'file')} of matches and of features {first_of(best)}"
        fix = "put one file of matches and that of its features into a folder of their own"
        raise PredictionError(what, where=path, fix=fix)
    return matches[0], next(iter(best), None)


HLOC = _Hloc()
