"""What the reconstruction baseline is, and its settings, as the help shows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from airzoo_bench.core.registry import Option
from airzoo_bench.evaluation.info import DOUBLED, Baseline

__all__ = ["STRUCTURE_FROM_MOTION", "SfmSettings"]


@dataclass(frozen=True)
class SfmSettings:
    """How photos become a sparse model.

    Attributes
    ----------
    long_side_px : int
        Photos are made this small before features are extracted.
    max_features : int
        The largest SIFT features of a photo that are kept.
    peak_threshold : float
        Least contrast of a feature, of grey values from 0 to 1; pycolmap's own.
    doubled : bool
        See `sift.extract`.
    ratio : float
        A match is kept where its distance is below this share of the second nearest's.
    neighbours : int or None
        How many of the nearest photos, by GPS, each is matched with; None, or without GPS: all.
    least_inliers : int
        Matches that a pair needs.
    max_error_px : float
        Largest reprojection error, in pixels of the photo made small.
    seed : int
    """

    long_side_px: Annotated[int, Option("long-side", "Photos are made this small, px.", 64)] = 1600
    max_features: Annotated[int, Option("features", "SIFT features of a photo.", 100)] = 4096
    peak_threshold: float = 0.02 / 3
    doubled: Annotated[bool, DOUBLED] = True
    ratio: float = 0.8
    neighbours: Annotated[
        int | None, Option("neighbours", "Nearest photos, by GPS, to match each photo with.", 2)
    ] = 12
    least_inliers: int = 15
    max_error_px: float = 4.0
    seed: Annotated[int, Option("seed", "Of every random choice.", 0)] = 0


STRUCTURE_FROM_MOTION = Baseline(
    method="Structure from motion",
    summary="Reconstruct scenes by structure from motion (pycolmap): a sparse cloud and cameras.\n"
    "\nA run that was stopped goes on.",
    settings=SfmSettings(),
    demo=SfmSettings(long_side_px=640, max_features=1500, doubled=False, neighbours=8),
    out="sfm",
    out_help="The folder to write.",
    example="airzoo-mini-reconstruction --out sfm",
    predict="airzoo_bench.reconstruction.baseline:predict",
)
