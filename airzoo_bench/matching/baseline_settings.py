"""What the matching baseline is, and its settings, as the help shows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from airzoo_bench.core.registry import Option
from airzoo_bench.evaluation.info import DOUBLED, Baseline

__all__ = ["SIFT", "SiftSettings"]


@dataclass(frozen=True)
class SiftSettings:
    """How photos are matched with the map.

    Attributes
    ----------
    max_features, max_map_features : int
        The largest SIFT features of the photo, and of the crop, that are kept.
    peak_threshold : float
        Least contrast of a feature, of grey values from 0 to 1; pycolmap's own.
    ratio : float
        A match is kept where its distance is below this share of the second nearest's.
    max_side_px : int
        Photo and crop are made smaller, by the same factor, until both fit.
    doubled : bool
        See `sift.extract`.
    """

    max_features: Annotated[int, Option("features", "SIFT features of a photo.", 4)] = 8192
    max_map_features: Annotated[int, Option("map-features", "SIFT features of a crop.", 4)] = 16384
    peak_threshold: float = 0.02 / 3
    ratio: Annotated[
        float, Option("ratio", "Of the nearest to the second distance.", 0.01, 1.0)
    ] = 0.8
    max_side_px: Annotated[int, Option("long-side", "Pictures are made this small, px.", 64)] = 2000
    doubled: Annotated[bool, DOUBLED] = True


SIFT = Baseline(
    method="SIFT",
    summary="Match photos to their crops by SIFT, mutual neighbours and ratio test.",
    settings=SiftSettings(),
    demo=SiftSettings(doubled=False),
    out="sift-matches.npz",
    out_help="The .npz to write.",
    example="brighton-matching --out matches.npz",
    predict="airzoo_bench.matching.baseline:predict",
)
