"""Matches as the calls of matchers return them, saved by `numpy.savez` a file a pair."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.readers.match_files import PairFiles, field_of, npz_fields, pixels_of, stated_size

if TYPE_CHECKING:
    from airzoo_bench.evaluation.reader import Reading
    from airzoo_bench.formats.arrays import Arrays
    from airzoo_bench.geometry.arrays import Floats
    from airzoo_bench.readers.pictures import Picture
    from airzoo_bench.readers.stated_shapes import Sizes

__all__ = ["DUST3R", "LOFTR", "MAST3R_VISLOC", "ROMA", "SUPERGLUE"]

_CENTRE = 0.5
_NORMALISED = 1.0 + 1e-6
_MOST = 0.5  # of the matches; pixels of a whole picture are hardly ever in its first
_SIZE_BYTES = 1 << 20
_ALL_TAKEN = "all matches are taken, whatever their confidence"
_RESIZED = (
    "pixels are those of the resized pictures, whose sizes the file states, and whole numbers at "
    "the centres of pixels: 0.5 was added, and each axis scaled by itself",
    _ALL_TAKEN,
)


class _Resized(PairFiles):
    conventions = _RESIZED
    takes_image_size = True

    def sizes(self, path: Path, reading: Reading) -> Sizes | None:
        """See `PairFiles.sizes`."""
        arrays = _opened(path, _SIZE_BYTES)
        return _size(arrays, 0, reading), _size(arrays, 1, reading)


class _Loftr(_Resized):
    title = "matches of LoFTR"
    layout = "npz a pair: mkpts0_f, mkpts1_f, mconf; image_size0, image_size1"
    methods = ("LoFTR", "EfficientLoFTR", "GIM")

    def knows(self, path: Path) -> bool:
        """See `PairFiles.knows`."""
        return {"mkpts0_f", "mkpts1_f"} <= npz_fields(path)

    def pixels(
        self, path: Path, one: Picture, other: Picture, reading: Reading
    ) -> tuple[Floats, Floats]:
        """See `PairFiles.pixels`."""
        arrays = _opened(path, reading.memory_bytes)
        first, second = _together(arrays, "mkpts0_f", "mkpts1_f")
        return _enlarged(arrays, 0, first, one, reading), _enlarged(
            arrays, 1, second, other, reading
        )


class _SuperGlue(_Resized):
    title = "matches of SuperGlue"
    layout = "npz a pair: keypoints0, keypoints1, matches, match_confidence; image_size0 and 1"
    methods = ("SuperGlue", "LightGlue")

    def knows(self, path: Path) -> bool:
        """See `PairFiles.knows`."""
        return {"keypoints0", "keypoints1", "matches"} <= npz_fields(path)

    def pixels(
        self, path: Path, one: Picture, other: Picture, reading: Reading
    ) -> tuple[Floats, Floats]:
        """See `PairFiles.pixels`."""
        import numpy as np

        arrays = _opened(path, reading.memory_bytes)
        first, second = (pixels_of(arrays, name) for name in ("keypoints0", "keypoints1"))
        matches = field_of(arrays, "matches")
        fits = matches.dtype.kind == "i" and matches.shape == (len(first),)
        if not fits or ((matches < -1) | (matches >= len(second))).any():
            raise PredictionError(
                "field 'matches' does not count the keypoints that are there",
                where=path,
                expected=f"whole numbers of shape ({len(first)},): -1, or 0 to {len(second) - 1}",
            )
        found = np.flatnonzero(matches >= 0)
        first, second = first[found], second[matches[found]]
        return _enlarged(arrays, 0, first, one, reading), _enlarged(
            arrays, 1, second, other, reading
        )


class _Roma(PairFiles):
    title = "matches of RoMa"
    layout = "npz a pair: matches (N, 4), certainty"
    methods = ("RoMa", "RoMa (GIM)", "RoMa (Ours)", "DKM")
    conventions = (
        "matches are normalised from -1 to 1, edge to edge, or pixels of the full size whose "
        "corner is (0, 0), as to_pixel_coordinates makes them",
        _ALL_TAKEN,
    )

    def knows(self, path: Path) -> bool:
        """See `PairFiles.knows`: no other npz has matches of its own without keypoints0."""
        names = npz_fields(path)
        return "matches" in names and not names & {"keypoints0", "keypoints1"}

    def pixels(
        self, path: Path, one: Picture, other: Picture, reading: Reading
    ) -> tuple[Floats, Floats]:
        """See `PairFiles.pixels`."""
        import numpy as np

        values = pixels_of(_opened(path, reading.memory_bytes), "matches", 4)
        first, second = values[:, :2], values[:, 2:]
        beyond = int((np.abs(values) > _NORMALISED).any(axis=1).sum())
        if beyond > _MOST * len(values):
            return first, second
        if beyond:
            raise PredictionError(
                f"{counted(beyond, 'match')} of {len(values):,} beyond -1 "
                f"to 1, up to {np.abs(values).max():.4g}: normalised or not?",
                where=path,
                expected="matches from -1 to 1, edge to edge, as RoMa itself cuts them off, or all "
                "in pixels of the full size",
                fix="leave out what lies beyond -1 to 1, or save pixels (to_pixel_coordinates)",
            )
        return (first + 1) / 2 * one.size, (second + 1) / 2 * other.size


class _Dust3r(PairFiles):
    title = "matches of DUSt3R or MASt3R"
    layout = "npz a pair: matches_im0, matches_im1, size"
    methods = ("DUSt3R", "MASt3R")
    conventions = (
        "pixels are those of dust3r.utils.image.load_images at the size that the file states, "
        "whole numbers at the centres of pixels: 0.5 was added, and cropping and resizing undone",
        _ALL_TAKEN,
    )

    def knows(self, path: Path) -> bool:
        """See `PairFiles.knows`."""
        return {"matches_im0", "matches_im1"} <= npz_fields(path)

    def pixels(
        self, path: Path, one: Picture, other: Picture, reading: Reading
    ) -> tuple[Floats, Floats]:
        """See `PairFiles.pixels`."""
        arrays = _opened(path, reading.memory_bytes)
        first, second = _together(arrays, "matches_im0", "matches_im1")
        size = _loaded_size(arrays)
        return _uncropped(first, one, size, path), _uncropped(second, other, size, path)


class _Mast3rVisloc(PairFiles):
    title = "matches that MASt3R's visloc.py keeps"
    layout = "npz QUERY/MAP.npz: valid_pts3d, matches_im_query, matches_im_map, matches_conf"
    methods = ("MASt3R",)
    conventions = (
        "pixels are those of the full size, whole numbers at the centres of pixels: 0.5 was added",
        "the map's pixels are lifted by the benchmark's surface model, not by valid_pts3d",
        _ALL_TAKEN,
    )

    def knows(self, path: Path) -> bool:
        """See `PairFiles.knows`."""
        return {"matches_im_query", "matches_im_map"} <= npz_fields(path)

    def pixels(
        self, path: Path, one: Picture, other: Picture, reading: Reading
    ) -> tuple[Floats, Floats]:
        """See `PairFiles.pixels`."""
        import numpy as np

        arrays = _opened(path, reading.memory_bytes)
        names = ("matches_im_query", "matches_im_map")
        if all(field_of(arrays, name).size == 0 for name in names):  # saved as an empty list
            return np.zeros((0, 2)), np.zeros((0, 2))
        first, second = _together(arrays, *names)
        return first + _CENTRE, second + _CENTRE


def _opened(path: Path, memory_bytes: int) -> Arrays:
    from airzoo_bench.formats.npz import NpzFile

    return NpzFile(path, memory_bytes // 4)  # numbers may grow while they become doubles


def _together(arrays: Arrays, one: str, other: str) -> tuple[Floats, Floats]:
    first, second = pixels_of(arrays, one), pixels_of(arrays, other)
    if len(first) != len(second):
        raise PredictionError(
            f"{one} has {len(first):,} rows, {other} {len(second):,}", where=arrays.path
        )
    return first, second


def _size(arrays: Arrays, side: int, reading: Reading) -> tuple[float, float]:
    """Return the width and height of what the model was given, as the file or the user says."""
    stated, given = stated_size(arrays, side), reading.image_size
    if stated is not None and given is not None:
        raise PredictionError(
            "states to which size of the pictures its pixels belong, and so does --image-size",
            where=arrays.path,
            fix="leave --image-size out",
        )
    size = stated or given
    if size is None:
        raise PredictionError(
            "does not say to which size of the pictures its pixels belong",
            where=arrays.path,
            expected="image_size0 and image_size1, width and height of what the model was given",
            fix=f"add to np.savez: image_size{side}=[image{side}.shape[-1], image{side}.shape[-2]]"
            ", or give --image-size WxH",
        )
    return size


def _enlarged(arrays: Arrays, side: int, xy: Floats, picture: Picture, reading: Reading) -> Floats:
    """Return pixels of the full size, from those of a picture that was resized."""
    import numpy as np

    size = _size(arrays, side, reading)
    xy = xy + _CENTRE
    outside = (xy > np.add(size, 1)).any(axis=1)
    if outside.any():
        x, y = xy[outside][0]
        raise PredictionError(
            f"a pixel at ({x:.1f}, {y:.1f}) in a picture that is said to have "
            f"{size[0]:.0f}x{size[1]:.0f} px",
            where=arrays.path,
            expected="the size that the pixels belong to, width before height",
        )
    return xy * np.divide(picture.size, size)


def _loaded_size(arrays: Arrays) -> int:
    value = arrays.read("size") if "size" in arrays.names() else None
    if value is None or value.size != 1 or value.dtype.kind not in "iu" or value.min() < 16:
        raise PredictionError(
            "does not say at which size the pictures were loaded",
            where=arrays.path,
            expected="size=512, as load_images(..., size=512) was called",
            fix="add to np.savez: size=512",
        )
    return int(value.reshape(-1)[0])


def _uncropped(xy: Floats, picture: Picture, size: int, path: Path) -> Floats:
    """Undo what `dust3r.utils.image.load_images` does with ``square_ok=False``."""
    import numpy as np

    wide, high = picture.size
    longest = round(size * max(wide / high, high / wide)) if size == 224 else size
    resized = [round(side * longest / max(wide, high)) for side in (wide, high)]
    centre = [side // 2 for side in resized]
    if size == 224:
        half = [float(min(centre))] * 2
    else:
        half = [float(2 * one // 16 * 8) for one in centre]
        if resized[0] == resized[1]:
            half[1] = 3 * half[0] / 4
    xy = xy + _CENTRE
    if (xy > np.multiply(2, half) + 1).any():
        raise PredictionError(
            f"pixels up to ({xy[:, 0].max():.1f}, {xy[:, 1].max():.1f}), and load_images makes "
            f"{2 * half[0]:.0f}x{2 * half[1]:.0f} px of a picture of {wide}x{high} at size={size}",
            where=path,
            expected="the size that load_images was called with, square_ok=False, patch_size=16",
        )
    found: Floats = (xy + np.subtract(centre, half)) * np.divide(picture.size, resized)
    return found


LOFTR = _Loftr()
"""Registered as ``loftr``."""

SUPERGLUE = _SuperGlue()
"""Registered as ``superglue``."""

ROMA = _Roma()
"""Registered as ``roma``."""

DUST3R = _Dust3r()
"""Registered as ``dust3r-matches``."""

MAST3R_VISLOC = _Mast3rVisloc()
"""Registered as ``mast3r-visloc``."""
