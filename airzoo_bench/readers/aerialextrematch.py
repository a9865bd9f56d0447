"""Matches as the wrappers of AerialExtreMatch's benchmark return them, and its results text."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import UnreadableError
from airzoo_bench.evaluation.reader import Reading, ReadPredictions
from airzoo_bench.readers.match_files import PairFiles
from airzoo_bench.readers.pose_text import first_rows, numbers_of

if TYPE_CHECKING:
    from airzoo_bench.geometry.arrays import Floats
    from airzoo_bench.readers.pictures import Picture

__all__ = ["AERIALEXTREMATCH"]

_COLUMNS = 4


class _AerialExtreMatch(PairFiles):
    """Reads (N, 4) arrays; refuses the text that has errors where poses are asked for."""

    title = "matches of AerialExtreMatch's benchmark"
    layout = "npy a pair: x y of the photo, x y of the map, (N, 4)"
    methods = ("AerialExtreMatch",)
    suffix = ".npy"
    conventions = (
        "pixels are taken as they stand, those of the full size whose corner is (0, 0): RoMa's are "
        "such, those of LoFTR and its kin may be off by up to half a pixel of what the model saw",
    )

    def knows(self, path: Path) -> bool:
        """See `PairFiles.knows`."""
        from airzoo_bench.formats.npz import read_header

        try:
            with path.open("rb") as stream:
                shape, _, dtype = read_header(stream)
        except (OSError, ValueError):
            return False
        return dtype.kind == "f" and len(shape) == 2 and shape[1] == _COLUMNS

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        return 0.8 * _has_errors(path) or super().recognise(path)

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        if _has_errors(path):
            raise UnreadableError(
                "holds errors in metres and degrees, a line a photo, and no poses: they were "
                "measured against its own truth, and photos with fewer than 5 matches are left out",
                where=path,
                expected="the matches, or poses as lines of name qw qx qy qz tx ty tz",
                fix="in run_localization.py save what the matcher returns: "
                "np.save(f'{name}.npy', matches)",
            )
        return super().read(path, reading)

    def pixels(
        self, path: Path, one: Picture, other: Picture, reading: Reading
    ) -> tuple[Floats, Floats]:
        """See `PairFiles.pixels`."""
        import numpy as np

        from airzoo_bench.formats.budget import Budget
        from airzoo_bench.formats.npz import map_numbers

        mapped = map_numbers(path)
        if mapped.ndim != 2 or mapped.shape[1] != _COLUMNS:
            raise UnreadableError(
                f"an array of shape {mapped.shape}", where=path, expected="(N, 4): x y and x y"
            )
        Budget(reading.memory_bytes).hold(path, "its matches", mapped.size * 8)
        values = np.array(mapped, dtype=np.float64)
        return values[:, :2], values[:, 2:]


def _has_errors(path: Path) -> bool:
    """Say whether a text begins with a line of name, metres, degrees."""
    rows = first_rows(path)[:1]
    if not rows or len(rows[0]) != 3 or numbers_of(rows, 0) is not None:
        return False
    return numbers_of(rows, 1) is not None


AERIALEXTREMATCH = _AerialExtreMatch()
"""Registered as ``aerialextrematch``."""
