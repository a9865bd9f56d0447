"""A file a pair of pictures: matches as the calls of matchers return them, saved by NumPy."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from airzoo_bench.core.errors import PredictionError, UsageError, counted
from airzoo_bench.core.files import first_bytes, npz_fields
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.predictions import PredictionFile, Reader, ReadRequest
from airzoo_bench.formats.arrays import Arrays, numbers
from airzoo_bench.formats.npz import Budget, NpzFile, map_numbers, read_header
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.readers.pictures import MatchRows, Pair, Picture, Pictures, Pixels, matched_pixels

_CENTRE = 0.5
_NORMALISED = 1.0 + 1e-6
_ALL_TAKEN = "all matches are taken, whatever their confidence"


class PairFiles(Reader):
    """Reads a file a pair of pictures, or a folder of them.

    A file is called after the photo, which was then matched to its crop, or after photo and crop or
    map in the order of the fields, as in ``q0_q0_dom_matches.npz`` or ``q0.jpg/q0_dom.tif.npz``.
    Where `takes_image_size` is True pixels are those of resized pictures, whose sizes the file
    states, or ``--image-size``.
    """

    track = "matching"
    fields: ClassVar[tuple[str, str]]  # pixels (N, 2), whole numbers being centres of pixels
    suffix: ClassVar[str] = ".npz"
    takes_image_size: ClassVar[bool] = False

    def knows(self, path: Path) -> bool:
        """Say whether a file has this layout."""
        names = npz_fields(path)
        return {*self.fields} <= names and not names & {"query_ids", "protocol"}

    def matches(self, path: Path, pair: Pair, request: ReadRequest) -> Pixels:
        """Return the matched pixels of both pictures at full size, corners being (0, 0)."""
        arrays = NpzFile(path, request.memory_bytes // 4)  # numbers may grow as doubles
        sides = zip((0, 1), self.pixels(arrays), pair, strict=True)
        found = [self.enlarged(arrays, side, xy + _CENTRE, one, request) for side, xy, one in sides]
        return found[0], found[1]

    def pixels(self, arrays: Arrays) -> Pixels:
        """Return the matched pixels, as the file has them."""
        one, other = self.fields
        return pixels_of(arrays, one), pixels_of(arrays, other)

    def enlarged(
        self, arrays: Arrays, side: int, xy: Floats, picture: Picture, request: ReadRequest
    ) -> Floats:
        """Bring pixels (N, 2), corners being (0, 0), to a picture's full size."""
        if not self.takes_image_size:
            return xy
        size = size_of(arrays, side, request)
        _check_within(arrays, xy, size)
        return xy * np.divide(picture.size, size)

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`: all of the first few files have this layout."""
        files = list(islice(_files(path, self.suffix), 3))
        return 0.8 if files and all(self.knows(one) for one in files) else 0.0

    def read(self, path: Path, request: ReadRequest) -> PredictionFile:
        """See `Reader.read`."""
        pictures = Pictures(request)
        reader = f"{request.reader} ({self.layout})"
        rows, left = MatchRows(path, Budget(request.memory_bytes), reader, pictures), []
        for one in sorted(_files(path, self.suffix)):
            inside = one.name if one == path else one.relative_to(path).as_posix()
            name = inside.removesuffix(self.suffix)
            try:
                pair = _pair(name, pictures)
                if pair is None:
                    left.append(name)
                else:
                    with READERS.blaming(str(request.reader), f", reading {one}"):
                        rows.add(pair, self.matches(one, pair, request), name)
            except PredictionError as error:
                raise error if str(one) in str(error.where) else error.inside(one) from error
        notes = rows.notes(len(left), "file")
        said = (f"pictures were {request.image_size} px: --image-size",) * bool(request.image_size)
        return PredictionFile(rows.predictions(left), (*self.conventions, *said), notes)


def _files(path: Path, suffix: str) -> Iterator[Path]:
    """Yield the files of a suffix, in no order."""
    every = path.rglob(f"*{suffix}") if path.is_dir() else [path]
    yield from (one for one in every if one.suffix == suffix and one.is_file())


def _pair(name: str, pictures: Pictures) -> Pair | None:
    """Find the photo and the part of the map in the name of a file, in its order."""
    stem = name.removesuffix("_matches")
    folder, _, last = stem.rpartition("/")
    above, slash, _ = folder.rpartition("/")
    found = pictures.pair(folder, above + slash + last)
    if found is not None:
        return found
    cuts = [at for at, letter in enumerate(stem) if letter == "_" and at >= len(folder)]
    home = folder and f"{folder}/"
    halves = [(stem[:at], stem[at + 1 :].removeprefix("_")) for at in cuts]  # or as in A__B
    different = {pictures.pair(one, home + other) for one, other in halves} - {None}
    if len(different) == 1:
        return different.pop()
    alone = pictures.find(stem)
    return None if alone is None or alone.query is None else (alone, pictures.crop_of(alone))


def pixels_of(arrays: Arrays, name: str, columns: int = 2) -> Floats:
    """Read a field of pixels, whole or not, in double precision; an empty list is no match."""
    if name not in arrays.names():
        raise PredictionError(f"lacks the field {name!r}", where=arrays.path)
    if not arrays.read(name).size:
        return np.zeros((0, columns))
    pixels = numbers(arrays, name, (None, columns)).astype(np.float64)
    if not np.isfinite(pixels).all():
        raise PredictionError(f"field {name!r} has pixels that are not finite", where=arrays.path)
    return pixels


def size_of(arrays: Arrays, side: int, request: ReadRequest) -> tuple[float, float]:
    """Return the width and height of the model's input, from the file or the user."""
    name = f"image_size{side}"
    if (name in arrays.names()) == (request.image_size is not None):
        raise PredictionError(
            "says not, or twice, to which size of the pictures its pixels belong",
            where=arrays.path,
            expected="image_size0 and image_size1, width and height of what the model was given",
            fix=f"add to np.savez: image_size{side}=[image{side}.shape[-1], image{side}.shape[-2]]"
            ", or give --image-size WxH for files that do not state it",
        )
    if request.image_size is not None:
        size = re.fullmatch(r"([1-9]\d{0,5})x([1-9]\d{0,5})", request.image_size)
        if size is None:
            what = f"{request.image_size[:40]!r} is no size of a picture"
            raise UsageError(what, where="--image-size", expected="such as 640x480")
        return float(size[1]), float(size[2])
    values: Any = arrays.read(name)
    if values.dtype.kind not in "iu" or values.size != 2 or values.min() < 1:
        what = f"field {name!r} is {values.reshape(-1)[:4].tolist()}"
        raise PredictionError(what, where=arrays.path, expected="width and height, in pixels")
    width, height = map(float, values.reshape(-1))
    return width, height


def _check_within(arrays: Arrays, xy: Floats, size: tuple[float, float]) -> None:
    if (xy > np.add(size, 1)).any():
        what = f"pixels up to {xy.max(axis=0)} in pictures of {size[0]:g}x{size[1]:g} px"
        fix = "state the size at which the model was given the pictures"
        raise PredictionError(what, where=arrays.path, expected="width before height", fix=fix)


# --- methods ---


class _Resized(PairFiles):
    takes_image_size = True
    conventions = (
        "pixels are those of the resized pictures, whose sizes the file states, and whole numbers "
        "at the centres of pixels: 0.5 was added, and each axis scaled by itself",
        _ALL_TAKEN,
    )


class _Loftr(_Resized):
    title = "matches of LoFTR"
    layout = "npz a pair: mkpts0_f, mkpts1_f, mconf; image_size0, image_size1"
    methods = ("LoFTR", "EfficientLoFTR", "GIM")
    fields = ("mkpts0_f", "mkpts1_f")


class _SuperGlue(_Resized):
    title = "matches of SuperGlue"
    layout = "npz a pair: keypoints0, keypoints1, matches, match_confidence; image_size0 and 1"
    methods = ("SuperGlue", "LightGlue")
    fields = ("keypoints0", "keypoints1")

    def knows(self, path: Path) -> bool:
        return super().knows(path) and "matches" in npz_fields(path)

    def pixels(self, arrays: Arrays) -> Pixels:
        return matched_pixels(*super().pixels(arrays), arrays.read("matches"))


class _Roma(PairFiles):
    title = "matches of RoMa"
    layout = "npz a pair: matches (N, 4), certainty"
    methods = ("RoMa", "RoMa (GIM)", "RoMa (Ours)", "DKM")
    fields = ("matches", "matches")
    conventions = (
        "matches are normalised from -1 to 1, edge to edge, or pixels of the full size whose "
        "corner is (0, 0), as to_pixel_coordinates makes them",
        _ALL_TAKEN,
    )

    def knows(self, path: Path) -> bool:
        return super().knows(path) and not npz_fields(path) & {*_SuperGlue.fields}

    def matches(self, path: Path, pair: Pair, request: ReadRequest) -> Pixels:
        values = pixels_of(NpzFile(path, request.memory_bytes // 4), "matches", 4)
        beyond = int((np.abs(values) > _NORMALISED).any(axis=1).sum())
        if beyond > 0.5 * len(values):  # pixels of a picture are hardly ever in its first
            return values[:, :2], values[:, 2:]
        if beyond:
            raise PredictionError(
                f"{counted(beyond, 'match')} of {len(values):,} beyond -1 to 1: normalised or not?",
                where=path,
                expected="matches from -1 to 1, as RoMa cuts them off, or all in pixels",
            )
        first, second = pair
        return (values[:, :2] + 1) / 2 * first.size, (values[:, 2:] + 1) / 2 * second.size


class _Dust3r(PairFiles):
    title = "matches of DUSt3R or MASt3R"
    layout = "npz a pair: matches_im0, matches_im1, size"
    methods = ("DUSt3R", "MASt3R")
    fields = ("matches_im0", "matches_im1")
    conventions = (
        "pixels are those of dust3r.utils.image.load_images at the size that the file states, "
        "whole numbers at the centres of pixels: 0.5 was added, and cropping and resizing undone",
        _ALL_TAKEN,
    )

    def enlarged(
        self, arrays: Arrays, side: int, xy: Floats, picture: Picture, request: ReadRequest
    ) -> Floats:
        """Undo what `dust3r.utils.image.load_images` does with ``square_ok=False``."""
        value = arrays.read("size") if "size" in arrays.names() else np.zeros(0)
        if value.size != 1 or value.dtype.kind not in "iu" or value.min() < 16:
            what = "does not say at which size the pictures were loaded"
            fix = "add to np.savez: size=512, as load_images(..., size=512) was called"
            raise PredictionError(what, where=arrays.path, fix=fix)
        size = int(value.reshape(-1)[0])
        wide, high = picture.size
        longest = round(size * max(wide / high, high / wide)) if size == 224 else size
        resized = [round(one * longest / max(wide, high)) for one in (wide, high)]
        centre = [one // 2 for one in resized]
        half = [float(2 * one // 16 * 8) for one in centre]
        if size == 224:
            half = [float(min(centre))] * 2
        elif resized[0] == resized[1]:
            half[1] = 3 * half[0] / 4
        _check_within(arrays, xy, (2 * half[0], 2 * half[1]))
        found: Floats = (xy + np.subtract(centre, half)) * np.divide(picture.size, resized)
        return found


class _Mast3rVisloc(PairFiles):
    title = "matches that MASt3R's visloc.py keeps"
    layout = "npz QUERY/MAP.npz: valid_pts3d, matches_im_query, matches_im_map, matches_conf"
    methods = ("MASt3R",)
    fields = ("matches_im_query", "matches_im_map")
    conventions = (
        "pixels are those of the full size, whole numbers at the centres of pixels: 0.5 was added",
        "the map's pixels are lifted by the benchmark's surface model, not by valid_pts3d",
        _ALL_TAKEN,
    )


class _AerialExtreMatch(PairFiles):
    title = "matches of AerialExtreMatch's benchmark"
    layout = "npy a pair: x y of the photo, x y of the map, (N, 4)"
    methods = ("AerialExtreMatch",)
    suffix = ".npy"
    conventions = (
        "pixels are taken as they stand, those of the full size whose corner is (0, 0): RoMa's are "
        "such, those of LoFTR and its kin may be off by up to half a pixel of what the model saw",
    )

    def knows(self, path: Path) -> bool:
        try:
            with path.open("rb") as stream:
                shape, _, dtype = read_header(stream)
        except (OSError, ValueError):
            return False
        return dtype.kind == "f" and len(shape) == 2 and shape[1] == 4

    def matches(self, path: Path, pair: Pair, request: ReadRequest) -> Pixels:
        values = np.atleast_1d(map_numbers(path))
        return values[..., :2], values[..., 2:]


# --- pickles, which are recognised, never loaded ---


class _PickledMatches(Reader):
    """Files that only running them would read; a recipe has the lines that convert them.

    The `layout` begins with the names of files, and `mark` is near the beginning of the pickle.
    """

    track = "matching"

    def __init__(self, title: str, layout: str, mark: bytes, *methods: str) -> None:
        self.title, self.layout, self.mark, self.methods = title, layout, mark, methods

    def recognise(self, path: Path) -> float:
        found = islice(path.iterdir(), 1000) if path.is_dir() else [path]
        ending = Path(self.layout.partition(":")[0]).suffix
        first = next((one for one in found if one.suffix == ending and one.is_file()), None)
        # The zip of torch.save begins with its pickle, not compressed.
        return 0.9 * (first is not None and self.mark in first_bytes(first, 1 << 16))

    def read(self, path: Path, request: ReadRequest) -> PredictionFile:
        what = f"is {self.title}: a Python pickle, which would run whatever it says, never loaded"
        fix = "convert it by the lines in docs/recipes/matching.md, under Pickles"
        raise PredictionError(what, where=path, expected="arrays that numpy.savez wrote", fix=fix)


_TORCH = "*.torch: what torch.save made of a dictionary with matched_kpts0"
_DUMP = "LoFTR_pred_eval.npy: an array of dictionaries with mkpts0_f"
_LOGS = "*_logs.pkl: a dictionary with the PnP of each query"
_MODELS = ("vismatch", "image-matching-models")
VISMATCH = _PickledMatches("results of vismatch", _TORCH, b"matched_kpts0", *_MODELS)
LOFTR_DUMP = _PickledMatches("LoFTR's dump of an evaluation", _DUMP, b"mkpts0_f", "LoFTR")
HLOC_LOGS = _PickledMatches("hloc's logs of a localisation", _LOGS, b"keypoints_query", "hloc")
LOFTR, SUPERGLUE, ROMA = _Loftr(), _SuperGlue(), _Roma()
DUST3R_MATCHES, MAST3R_VISLOC, AERIALEXTREMATCH = _Dust3r(), _Mast3rVisloc(), _AerialExtreMatch()
