"""Lengths of descriptors: where those of tiles differ, each metric ranks another way."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from airzoo_bench.retrieval.predictions import RetrievalPredictions

__all__ = ["compared", "refuse_tiles_without_unit_length"]

_ROUNDING = 2e-3  # of lengths, next to each other: half precision rounds by half of it
_LOOKED_AT = 256
_METRICS = {"l2": "L2 distance", "cosine": "cosine", "inner_product": "inner product"}


def compared(
    own: str, protocol: Any, predictions: RetrievalPredictions
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Say how descriptors are compared, and whether that is another way than the method's own."""
    from airzoo_bench.retrieval.predictions import RankedIds

    content, metric = predictions.content, protocol.scores.descriptor_metric
    said = (f"descriptors are compared by {_METRICS[metric]}, as the protocol says",)
    if isinstance(content, RankedIds) or metric == own:
        return said, ()
    lengths = _lengths(content.gallery)
    if not lengths.max() - lengths.min() > _ROUNDING * lengths.max():
        return said, ()
    return said, (
        f"the method ranks by {_METRICS[own]}, the protocol by {_METRICS[metric]}, and the "
        f"descriptors of tiles are {lengths.min():.3g} to {lengths.max():.3g} long: the ranking "
        "may be another than the method's own",
    )


def refuse_tiles_without_unit_length(
    path: Path, predictions: RetrievalPredictions, fix: str
) -> None:
    """Refuse queries of unit length with tiles of others, as no method ranks them."""
    from airzoo_bench.retrieval.predictions import RankedIds

    content = predictions.content
    if isinstance(content, RankedIds) or (abs(_lengths(content.queries) - 1) > _ROUNDING).any():
        return
    lengths = _lengths(content.gallery)
    if (abs(lengths - 1) > _ROUNDING).any():
        raise PredictionError(
            "features of queries are of unit length, and those of the gallery are "
            f"{lengths.min():.3g} to {lengths.max():.3g} long",
            where=path,
            expected="both as the method compares them",
            fix=fix,
        )


def _lengths(rows: Any) -> NDArray[np.float64]:
    """Return the lengths of some rows, spread over all of them."""
    import numpy as np

    from airzoo_bench.retrieval.descriptors import Rows, exact_norms

    source = rows if isinstance(rows, Rows) else Rows.join(rows)
    some = np.unique(np.linspace(0, len(source) - 1, _LOOKED_AT).astype(int)).tolist()
    return np.concatenate([exact_norms(source.read(row, row + 1)) for row in some])
