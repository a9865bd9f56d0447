"""The results of hloc's localisation, and of LTVL: a pose a line, by the photo's own name."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.core.errors import counted
from airzoo_bench.evaluation.reader import SURE, Reader, Reading, ReadPredictions
from airzoo_bench.readers.pose_text import first_rows, numbers_of, pose_rows, unit_share

__all__ = ["HLOC_POSES"]

_COLUMNS = 8


class HlocPoses(Reader):
    """Reads ``name qw qx qy qz tx ty tz``, whose names are no ids of the benchmark."""

    track = "matching"
    title = "poses of hloc"
    layout = "text, a line a photo: its name without a scene, qw qx qy qz, tx ty tz"
    methods = ("hloc", "MASt3R", "DUSt3R")

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`; names with a scene are those of the suite's own pose lists."""
        rows = first_rows(path)
        if not rows or {len(row) for row in rows} != {_COLUMNS}:
            return 0.0
        values = numbers_of(rows, 1)
        if values is None or unit_share(values[:, :4]) < SURE:
            return 0.0
        if unit_share(values[:, 3:]) >= SURE and numbers_of(rows, 0) is not None:
            return 0.0  # a time stamp and an odd place
        return 0.2 if any("/" in row[0] for row in rows) else 0.8

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        import numpy as np

        from airzoo_bench.readers.matching import NamedPoses, posed

        rows = pose_rows(path, _COLUMNS - 1, named=True, memory_bytes=reading.memory_bytes)
        finite = np.isfinite(rows.values).all(axis=1)
        found = finite & ~(rows.values == (1, 0, 0, 0, 0, 0, 0)).all(axis=1)
        given = NamedPoses(rows.names, rows.values[:, :4], rows.values[:, 4:], found)
        predictions, strange = posed(given, reading, path)
        notes = []
        if strange:
            notes.append(f"{counted(strange, 'pose')} of photos that are no queries left out")
        failed = int((~predictions.content.found).sum())
        if failed:
            notes.append(f"{counted(failed, 'photo')} at the identity or NaN count as not found")
        else:
            notes.append(
                "hloc writes the pose of the best retrieved image, unmarked, where it found none: "
                "such poses are scored as they stand"
            )
        return ReadPredictions(
            predictions,
            (
                "poses are world-to-camera, x_cam = R X + t, OpenCV axes, in the scene's CRS",
                "quaternions are w x y z",
                "names without a scene are those of the only photos that they fit",
                "the identity stands for a pose that was not found",
            ),
            tuple(notes),
        )


HLOC_POSES = HlocPoses()
"""Registered as ``hloc-poses``."""
