"""Priors of photos by their own metadata."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.dji import PhotoPrior, priors_to_poses, read_prior
from airzoo_bench.geometry.poses import Poses

__all__ = ["stated_priors"]


def stated_priors(
    images: Path, names: Sequence[str], crs: str, progress: Progress
) -> tuple[dict[str, PhotoPrior], Poses | None]:
    """Read what photos say of themselves, and the poses that follow.

    Parameters
    ----------
    images : Path
    names : sequence of N str
        Relative to `images`.
    crs : str
        Projected.
    progress : Progress

    Returns
    -------
    metadata : dict of str to PhotoPrior
    priors : Poses or None
        N, NaN where a photo does not say enough; None where none does.
    """
    shown = progress(names, "metadata", len(names))
    metadata = {name: read_prior(images / name) for name in shown}
    whole = {name: prior for name, prior in metadata.items() if prior.is_complete}
    if not whole:
        return metadata, None
    found = priors_to_poses(whole, crs)
    rows = np.array([prior.is_complete for prior in metadata.values()])
    rotation, centres = np.full((len(rows), 3, 3), np.nan), np.full((len(rows), 3), np.nan)
    rotation[rows], centres[rows] = found.rotation, found.centres
    return metadata, Poses(rotation=rotation, centres=centres)
