"""What readers of matches in a file a pair share: which files, which pictures, which pixels."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from airzoo_bench.core.errors import PredictionError, UnreadableError, counted
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from airzoo_bench.formats.arrays import Arrays
    from airzoo_bench.geometry.arrays import Floats
    from airzoo_bench.readers.pictures import Picture, Pictures
    from airzoo_bench.readers.stated_shapes import Sizes

__all__ = ["PairFiles", "field_of", "npz_fields", "pixels_of", "stated_size"]

_MOST_FILES, _HEAD = 100_000, 3
_HEADER_BYTES = 1 << 20
_FARTHEST_PX = 1e9
_OWN = {"query_ids", "protocol"}


class PairFiles(Reader):
    """Reads a file a pair of pictures, or a folder of them.

    A file is called after the photo, which was then matched to its crop, or after photo and crop or
    map in the order of the fields, as in ``q0_q0_dom_matches.npz`` or ``q0.jpg/q0_dom.tif.npz``.

    Attributes
    ----------
    suffix : str
        Of the files.
    conventions : tuple of str
    """

    track = "matching"
    suffix: ClassVar[str] = ".npz"
    conventions: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def knows(self, path: Path) -> bool:
        """Say whether a file is of this layout, from its header."""

    @abstractmethod
    def pixels(
        self, path: Path, one: Picture, other: Picture, reading: Reading
    ) -> tuple[Floats, Floats]:
        """Return the matched pixels of both pictures, (N, 2) each, corners being (0, 0)."""

    def sizes(self, path: Path, reading: Reading) -> Sizes | None:
        """Return the sizes of the pictures that the model was given, if the layout has them."""
        return None

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`: all of the first few files are of this layout."""
        files = list(islice(_files(path, self.suffix), _HEAD))
        return 0.8 if files and all(self.knows(one) for one in files) else 0.0

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        from airzoo_bench.formats.budget import Budget
        from airzoo_bench.readers.matching import scenes_of
        from airzoo_bench.readers.pictures import MatchRows, Pictures, nothing_matched
        from airzoo_bench.readers.stated_shapes import StatedShapes

        shapes = StatedShapes()
        pictures = Pictures(scenes_of(reading, path), reading.scenes)
        rows = MatchRows(path, Budget(reading.memory_bytes))
        left = []
        for one in sorted(_files(path, self.suffix)):
            name = one.name if one == path else one.relative_to(path).as_posix()
            name = name.removesuffix(self.suffix)
            try:
                pair = _pair(name, pictures)
                if pair is None:
                    left.append(name)
                    continue
                xy = self.pixels(one, *pair, reading)
                rows.add(*_photo_first(pair, xy), name)
                sizes = self.sizes(one, reading)
                if sizes is not None:
                    shapes.add(pair, xy, sizes)
            except PredictionError as error:
                known = str(one) in str(error.where)
                raise error if known else error.inside(one) from error
        if rows.empty:
            raise nothing_matched(path, left, pictures)
        shapes.check(path)
        notes = (f"{counted(len(left), 'file')} of other pictures left out",) if left else ()
        size = reading.image_size
        said = () if size is None else (f"pictures were {size[0]:g}x{size[1]:g} px: --image-size",)
        return ReadPredictions(rows.predictions(), (*self.conventions, *said), notes)


def _files(path: Path, suffix: str) -> Iterator[Path]:
    """Yield the files of a suffix, in no order."""
    if path.is_file() and path.suffix == suffix:
        yield path
    if not path.is_dir():
        return
    for number, one in enumerate(path.rglob(f"*{suffix}")):
        if number == _MOST_FILES:
            raise UnreadableError(f"more than {_MOST_FILES:,} files", where=path)
        if one.is_file():
            yield one


def _pair(name: str, pictures: Pictures) -> tuple[Picture, Picture] | None:
    """Find the photo and the part of the map in the name of a file, in its order."""
    stem = name.removesuffix("_matches")
    folder, _, last = stem.rpartition("/")
    found = _joined(folder, last, pictures)
    if found is not None:
        return found
    cuts = [at for at, letter in enumerate(stem) if letter == "_" and at >= len(folder)]
    halves = [(stem[:at], rest) for at in cuts for rest in (stem[at + 1 :], _after(stem, at))]
    joined = [_joined(*two, pictures) for two in halves]
    different = {pair for pair in joined if pair is not None}
    if len(different) == 1:
        return different.pop()
    alone = pictures.find(stem)
    return None if alone is None or alone.query is None else (alone, pictures.crop_of(alone))


def _after(stem: str, at: int) -> str:
    """Return what follows one _ or, as in ``A__B``, two."""
    return stem[at + 1 :].removeprefix("_")


def _joined(one: str, other: str, pictures: Pictures) -> tuple[Picture, Picture] | None:
    """Return the pictures of two names where one is a photo and the other a part of the map."""
    folder, slash, _ = one.rpartition("/")
    first = pictures.find(one)
    second = None if first is None else pictures.find(folder + slash + other)
    if first is None or second is None or first.scene != second.scene:
        return None
    if (first.query is None) == (second.query is None):
        return None
    return first, second


def _photo_first(
    pair: tuple[Picture, Picture], xy: tuple[Floats, Floats]
) -> tuple[Picture, Picture, Floats, Floats]:
    return (*pair, *xy) if pair[1].query is None else (*pair[::-1], *xy[::-1])


def npz_fields(path: Path) -> set[str]:
    """Return the fields of an npz; none of what is none, or is the suite's own layout."""
    from airzoo_bench.formats.npz import NpzFile

    try:
        names = NpzFile(path, _HEADER_BYTES).names()
    except PredictionError:
        return set()
    return set() if names & _OWN else names


def pixels_of(arrays: Arrays, name: str, columns: int = 2) -> Floats:
    """Read a field of pixels, whole or not, in double precision."""
    import numpy as np

    from airzoo_bench.formats.arrays import wrong_type

    values = field_of(arrays, name)
    if values.dtype.kind not in "iuf" or values.ndim != 2 or values.shape[1] != columns:
        raise wrong_type(
            arrays.path, name, values, expected=f"numbers of shape (any, {columns})", fix="save it"
        )
    with np.errstate(all="ignore"):
        pixels = values.astype(np.float64)
        if not (np.abs(pixels) <= _FARTHEST_PX).all():
            raise PredictionError(
                f"field {name!r} has pixels that are not finite, or absurd", where=arrays.path
            )
    return pixels


def field_of(arrays: Arrays, name: str) -> NDArray[Any]:
    """Read a field that must be there."""
    if name not in arrays.names():
        raise PredictionError(f"lacks the field {name!r}", where=arrays.path)
    return arrays.read(name)


def stated_size(arrays: Arrays, side: int) -> tuple[float, float] | None:
    """Return the width and height that pixels belong to, where the file says so."""
    name, turned = f"image_size{side}", f"hw{side}_i"
    names = arrays.names() & {name, turned}
    if not names:
        return None
    name = name if name in names else turned
    values: Any = arrays.read(name)
    if values.dtype.kind not in "iu" or values.size != 2 or values.min() < 1:
        raise PredictionError(
            f"field {name!r} is {values.reshape(-1)[:4].tolist()}",
            where=arrays.path,
            expected="width and height" if name != turned else "height and width",
        )
    first, second = map(float, values.reshape(-1))
    return (second, first) if name == turned else (first, second)
