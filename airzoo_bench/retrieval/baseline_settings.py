"""What the retrieval baseline is, and its settings, as the help shows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from airzoo_bench.core.registry import Option
from airzoo_bench.evaluation.info import DOUBLED, Baseline

__all__ = ["VLAD", "VladSettings"]


@dataclass(frozen=True)
class VladSettings:
    """How images are described.

    Attributes
    ----------
    max_features : int
        The strongest SIFT features of an image that are kept.
    doubled : bool
        See `sift.extract`.
    long_side_px : int
        Photos are made this small.
    """

    max_features: int = 2048
    doubled: Annotated[bool, DOUBLED] = True
    long_side_px: Annotated[int, Option("long-side", "Photos are made this small, px.", 64)] = 1024


VLAD = Baseline(
    method="SIFT and VLAD",
    summary="Describe photos and tiles by SIFT and VLAD, and write a prediction file.",
    settings=VladSettings(),
    demo=VladSettings(doubled=False),
    out="sift-vlad.npz",
    out_help="The .npz to write.",
    example="brighton-retrieval --out sift.npz",
    predict="airzoo_bench.retrieval.baseline:predict",
)
