"""Maps of views that a method writes into a file each, one of which at a time is in memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, counted, first_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from airzoo_bench.reconstruction.fusion import LazyMaps

__all__ = ["check_same_number", "maps_of_files", "npy_size", "numbered", "read_npy"]

_DIGITS = 6


def numbered(folder: Path, ending: str) -> list[Path]:
    """Return the files ``000000<ending>`` and on of a folder, none of which is missing."""
    files = [one for one in folder.iterdir() if one.name.endswith(ending) and one.is_file()]
    files = sorted(one for one in files if one.stem.isascii() and one.stem.isdigit())
    found = {int(one.stem): one for one in files}
    twice = [one.name for one in files if found[int(one.stem)] != one]
    if twice:
        raise PredictionError(
            f"files of one number with another: {first_of(twice)}",
            where=folder,
            expected=f"000000{ending} and on, one a view, as the method wrote them",
            fix="take away those of another run",
        )
    last = max(found, default=-1)
    lost = [f"{number:0{_DIGITS}d}{ending}" for number in range(min(last, 1 << 20))]
    lost = [name for number, name in enumerate(lost) if number not in found]
    if lost or not found:
        raise PredictionError(
            f"files are missing: {first_of(lost, last + 1)}" if lost else "holds no numbered files",
            where=folder,
            expected=f"000000{ending} and on, one a view, as the method wrote them",
            fix="copy the whole folder",
        )
    return [found[number] for number in range(last + 1)]


def npy_size(path: Path) -> tuple[tuple[int, ...], Any, int]:
    """Return shape, dtype and the byte where the data of an npy file begin."""
    import math

    from airzoo_bench.formats.npz import read_header

    try:
        with path.open("rb") as stream:
            header = read_header(stream)
            start = stream.tell()
    except ValueError as error:
        raise _damaged(path, "the npy header is damaged") from error
    shape, fortran, dtype = header
    if dtype.hasobject or dtype.kind not in "fiu" or fortran or any(side < 1 for side in shape):
        raise PredictionError(
            f"an array of {str(dtype)[:40]} and shape {str(shape)[:40]}",
            where=path,
            expected="numbers, as the method wrote them",
        )
    if path.stat().st_size != start + math.prod(shape) * dtype.itemsize:
        raise _damaged(path, "is not as long as its header says")
    return shape, dtype, start


def read_npy(path: Path) -> NDArray[Any]:
    """Read an npy file that `npy_size` has let pass."""
    import math

    import numpy as np

    shape, dtype, start = npy_size(path)
    values: NDArray[Any] = np.fromfile(path, dtype, math.prod(shape), offset=start)
    return values.reshape(shape)


def maps_of_files(
    files: Sequence[Path],
    size_of: Callable[[Path], tuple[tuple[int, ...], Any]],
    read: Callable[[Path], NDArray[Any]],
) -> LazyMaps:
    """Return the maps of files, each read when it is asked for."""
    import numpy as np

    from airzoo_bench.reconstruction.fusion import LazyMaps

    shape, dtype = size_of(files[0])
    for one in files[1:]:
        other = size_of(one)
        if other != (shape, dtype):
            raise PredictionError(
                f"is {other[1]} of shape {other[0]}",
                where=one,
                expected=f"{dtype} of shape {shape}, as in {files[0].name}",
                fix="give the method photos of one size, or score each size apart",
            )
    if len(shape) not in (2, 3):
        raise PredictionError(f"has shape {shape}", where=files[0], expected="a map a file")
    return LazyMaps(np.arange(len(files)), shape, dtype, lambda row: read(files[row]))


def check_same_number(one: Sequence[Path], other: Sequence[Path]) -> None:
    """Refuse two folders of another number of files."""
    if len(one) != len(other):
        raise PredictionError(
            f"{one[0].parent.name} holds {counted(len(one), 'file')}, {other[0].parent.name} "
            f"{len(other):,}",
            where=one[0].parent.parent,
            expected="one a view in each",
            fix="copy the whole folder",
        )


def _damaged(path: Path, what: str) -> PredictionError:
    return PredictionError(what, where=path, fix="write or copy the file again")
