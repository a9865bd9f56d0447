"""The steps of structure from motion, each kept in a file named by what it was made from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.images import read_rgb_photo
from airzoo_bench.core.files import (
    atomic_write,
    fingerprint,
    sha256_of,
    temporary_folder,
    write_npz,
)
from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.geometry.arrays import Ints
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.sift import extract, mutual_nearest
from airzoo_bench.reconstruction.baseline_settings import SfmSettings
from airzoo_bench.reconstruction.sfm.colmap import Lens, Model, TwoViews, map_photos, verify

__all__ = [
    "Batch",
    "Photo",
    "build_model",
    "extract_features",
    "list_photo",
    "match_batch",
    "plan_batches",
]

_GREY = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601
_VERSION = 2  # of the files in the folder


class Photo(NamedTuple):
    """A photo at full size, and where its features go."""

    path: Path
    width: int
    height: int
    features: Path


class Batch(NamedTuple):
    """A photo, those to match it with, and where the matches go."""

    first: int
    seconds: tuple[int, ...]
    matches: Path


def list_photo(path: Path, lens: Lens, settings: SfmSettings, folder: Path) -> Photo:
    """Return a photo, its features named by its bytes and the settings."""
    pycolmap = load_pycolmap()
    extraction = [settings.long_side_px, settings.max_features, settings.peak_threshold]
    made_by = [_VERSION, pycolmap.__version__, *extraction, settings.doubled]
    key = fingerprint([*made_by, sha256_of(path)])
    return Photo(path, lens.width, lens.height, folder / "features" / f"{key}.npz")


def extract_features(settings: SfmSettings, photo: Photo) -> None:
    """Extract features of a photo into its file: pixels at full size, descriptors, colours."""
    colour = read_rgb_photo(photo.path, settings.long_side_px)
    grey = np.round(colour @ _GREY).astype(np.uint8)
    seen, found = extract(
        grey, settings.max_features, settings.peak_threshold, doubled=settings.doubled
    )
    column, row = np.floor(seen).astype(np.int64).T
    scale = np.array((photo.width, photo.height)) / (grey.shape[1], grey.shape[0])
    arrays: dict[str, NDArray[np.generic]] = {
        "places": seen * scale,
        "descriptors": found.astype(np.uint8),
        "colours": colour[row, column],
    }
    with atomic_write(photo.features) as stream:
        write_npz(stream, arrays)


def plan_batches(
    photos: Sequence[Photo],
    lenses: Sequence[Lens],
    pairs: Ints,
    settings: SfmSettings,
    folder: Path,
) -> list[Batch]:
    """Group sorted pairs (P, 2) of photos by the first, a file of matches each."""
    batches = []
    firsts, starts = np.unique(pairs[:, 0], return_index=True)
    parts = np.split(pairs[:, 1], starts[1:])
    for first, part in zip(firsts.tolist(), parts[: len(firsts)], strict=True):
        seconds = tuple(part.tolist())
        involved = [(photos[row].features.stem, lenses[row]) for row in (first, *seconds)]
        key = fingerprint([_VERSION, involved, asdict(replace(settings, neighbours=None))])
        batches.append(Batch(first, seconds, folder / "matches" / f"{key}.npz"))
    return batches


def match_batch(shared: tuple[SfmSettings, Sequence[Photo], Sequence[Lens]], batch: Batch) -> None:
    """Match a photo with its others into the batch's file."""
    settings, photos, lenses = shared
    here = _load(photos[batch.first].features)
    configs, kept = [], []
    for second in batch.seconds:
        there = _load(photos[second].features)
        a, b = (side["descriptors"].astype(np.float32) for side in (here, there))
        matches = np.stack(mutual_nearest(a, b, settings.ratio), axis=1)
        pair = (photos[batch.first], photos[second])
        config, inliers = verify(
            (lenses[batch.first], lenses[second]),
            (here["places"], there["places"]),
            matches,
            max_error_px=settings.max_error_px * _shrunk(pair, settings),
            least_inliers=settings.least_inliers,
            seed=settings.seed,
        )
        configs.append(config)
        kept.append(inliers)
    counts = np.array([len(part) for part in kept], np.int64)
    arrays: dict[str, NDArray[np.generic]] = {
        "configs": np.array(configs, np.int64),
        "counts": counts,
        "matches": np.concatenate(kept),
    }
    with atomic_write(batch.matches) as stream:
        write_npz(stream, arrays)


def build_model(
    photos: Sequence[Photo],
    lenses: Sequence[Lens],
    batches: Sequence[Batch],
    settings: SfmSettings,
    folder: Path,
) -> Iterator[Model]:
    """Yield the one model, from its file where it has been made."""
    images = [photo.features.stem for photo in photos]
    matched = [(batch.first, batch.seconds, batch.matches.stem) for batch in batches]
    path = folder / "models" / f"{fingerprint([_VERSION, images, matched])}.npz"
    if not path.is_file():
        features = [_load(photo.features) for photo in photos]
        with temporary_folder(folder, "scratch") as scratch:
            model = map_photos(
                lenses,
                [kept["places"] for kept in features],
                [kept["colours"] for kept in features],
                _two_views(batches),
                scratch,
                max_error_px=settings.max_error_px * _shrunk(photos, settings),
                least_inliers=settings.least_inliers,
                seed=settings.seed,
            )
        fields = {key: getattr(model, key) for key in ("rows", "points", "colours")}
        with atomic_write(path) as stream:
            write_npz(
                stream, fields | {key: getattr(model.poses, key) for key in ("rotation", "centres")}
            )
    arrays = _load(path)
    poses = Poses(rotation=arrays["rotation"], centres=arrays["centres"])
    yield Model(arrays["rows"], poses, arrays["points"], arrays["colours"])


def _two_views(batches: Sequence[Batch]) -> Iterator[TwoViews]:
    for batch in batches:
        kept = _load(batch.matches)
        parts = np.split(kept["matches"], np.cumsum(kept["counts"])[:-1])
        for second, config, matches in zip(batch.seconds, kept["configs"], parts, strict=True):
            if len(matches):
                yield TwoViews(batch.first, second, int(config), matches)


def _shrunk(photos: Sequence[Photo], settings: SfmSettings) -> float:
    longest = max(max(photo.width, photo.height) for photo in photos)
    return max(1.0, longest / settings.long_side_px)


def _load(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as file:
        return dict(file)
