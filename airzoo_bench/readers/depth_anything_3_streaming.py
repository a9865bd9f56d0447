"""A streaming run of Depth Anything 3: poses and intrinsics as text, and an npz a frame.

The poses are written last, so that frames without them are those of a run that did not end.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.readers.view_files import GivenArrays, ViewNames, check_count, inverted

if TYPE_CHECKING:
    from airzoo_bench.formats.budget import Budget
    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = ["is_streaming", "streaming_scene"]

_POSES, _INTRINSICS, _FRAMES = "camera_poses.txt", "intrinsic.txt", "results_output"
_FRAME = re.compile(r"frame_(\d{1,9})\.npz")
_LIMIT_BYTES = 256 << 20
_BYTES_A_NUMBER = 80  # as text, as Python's and as NumPy's
_FIX = "run it again, to its end"


def is_streaming(place: Path) -> bool:
    """Whether a folder is that of a streaming run, whole or not."""
    if not place.is_dir():
        return False
    texts = [(place / name).is_file() for name in (_POSES, _INTRINSICS)]
    return all(texts) or (_has_frames(place / _FRAMES) and (any(texts) or (place / "pcd").is_dir()))


def _has_frames(folder: Path) -> bool:
    return folder.is_dir() and any(_FRAME.fullmatch(one.name) for one in folder.iterdir())


def streaming_scene(place: Path, memory: int, names: ViewNames | None) -> ScenePrediction:
    """Read poses, intrinsics, and the frames, one in memory at a time."""
    import numpy as np

    from airzoo_bench.formats.budget import Budget
    from airzoo_bench.reconstruction.predictions import maps_of

    budget = Budget(memory)
    for name in (_POSES, _INTRINSICS):
        if not (place / name).is_file():
            raise _half(place, f"{name} is missing, which is written when all frames are done")
    poses = _table(place / _POSES, 16, budget).reshape(-1, 4, 4)
    focal = _table(place / _INTRINSICS, 4, budget)
    files = _frame_files(place, len(poses))
    if len(focal) != len(poses):
        raise _half(place, f"{_POSES} has {len(poses):,} lines, {_INTRINSICS} {len(focal):,}")
    check_count(place, names, len(poses))
    frames = _Frames(files, budget)
    matrices = np.tile(np.eye(3), (len(focal), 1, 1))
    matrices[:, (0, 1, 0, 1), (0, 1, 2, 2)] = focal
    given = {
        "depth": lambda: frames.maps("depth"),
        "conf": lambda: frames.maps("conf"),
        "intrinsics": lambda: matrices,
        "extrinsics": lambda: inverted(poses),
        "pixel_centres": lambda: np.array("integer"),
    }
    if names is not None:
        given["image_names"] = lambda: np.array(names.names, dtype=str)
    return maps_of(GivenArrays(place, budget, given))


def _frame_files(place: Path, count: int) -> list[Path]:
    """Return the frames' files by number: 0 to `count` - 1, none missing."""
    folder = place / _FRAMES
    matches = [_FRAME.fullmatch(one.name) for one in folder.iterdir()] if folder.is_dir() else []
    numbers = sorted(int(one.group(1)) for one in matches if one is not None)
    if not numbers:
        raise PredictionError(
            f"has no {_FRAMES}/frame_<i>.npz: the run wrote no depth",
            where=place,
            expected="a frame's depth for each line of camera_poses.txt",
            fix="set save_depth_conf_result: True in the config, and run it again",
        )
    missing = sorted(set(range(count)) - set(numbers))
    if missing or len(numbers) != count:
        lacking = f", without {first_of(missing)}" if missing else ""
        raise _half(place, f"{counted(len(numbers), 'frame')} for {count:,} poses{lacking}")
    return [folder / f"frame_{number}.npz" for number in numbers]


class _Frames:
    """Maps of the frames, each read from its file when it is asked for."""

    def __init__(self, files: list[Path], budget: Budget) -> None:
        self._files, self._budget = files, budget

    def maps(self, name: str) -> Any:
        """Return the maps of a field, all of the first frame's size."""
        import numpy as np

        from airzoo_bench.reconstruction.fusion import LazyMaps

        first = self._read(name, 0)
        if first.ndim != 2:
            raise PredictionError(
                f"field '{name}' has shape {first.shape}",
                where=self._files[0],
                expected="shape (H, W)",
            )

        def frame(row: int) -> Any:
            found = self._read(name, row)
            if found.shape != first.shape or found.dtype != first.dtype:
                raise PredictionError(
                    f"field '{name}' is {found.dtype} of shape {found.shape}",
                    where=self._files[row],
                    expected=f"{first.dtype} of shape {first.shape}, as of {self._files[0].name}",
                )
            return found

        return LazyMaps(np.arange(len(self._files)), first.shape, first.dtype, frame)

    def _read(self, name: str, row: int) -> Any:
        from airzoo_bench.formats.npz import NpzFile

        file = NpzFile(self._files[row], self._budget.limit_bytes, ("image",))
        if name not in file.names():
            raise PredictionError(
                f"lacks the field {name}", where=file.path, expected="depth, conf, intrinsics"
            )
        return file.read(name)


def _table(path: Path, columns: int, budget: Budget) -> Any:
    """Read lines of numbers, all with as many."""
    import numpy as np

    text = read_text(path, PredictionError, "text of numbers", _LIMIT_BYTES)
    budget.hold(path, f"the numbers of {path.name}", text.count(" ") * _BYTES_A_NUMBER)
    rows = [line.split() for line in text.splitlines() if line.strip()]
    odd = [number for number, row in enumerate(rows, 1) if len(row) != columns]
    try:
        if odd or not rows:
            raise ValueError
        return np.array([[float(one) for one in row] for row in rows])
    except ValueError as error:
        where = f": line {odd[0]} has {len(rows[odd[0] - 1])}" if odd else ""
        raise PredictionError(
            f"is no text of {columns} numbers a line{where}",
            where=path,
            expected=f"{columns} numbers a line, as da3_streaming.py writes it",
            fix=_FIX,
        ) from error


def _half(place: Path, why: str) -> PredictionError:
    return PredictionError(
        f"is a streaming run that did not end: {why}",
        where=place,
        expected=f"{_POSES}, {_INTRINSICS}, and {_FRAMES}/frame_<i>.npz for each of their lines",
        fix=_FIX,
    )
