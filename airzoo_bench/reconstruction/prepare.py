"""Making the truth of one scene for reconstruction: which photos, and the cloud."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from airzoo_bench.benchmark.queries import SceneInputs, with_unposed
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.reconstruction.truth import ReconstructionTruth

__all__ = ["build_truth"]

NOT_CHOSEN = "not among the photos of the reconstruction"


def build_truth(
    inputs: SceneInputs, cloud: Path, chosen: pd.Series[bool] | None = None
) -> ReconstructionTruth:
    """Put photos and cloud together.

    Parameters
    ----------
    inputs : SceneInputs
    cloud : Path
        The true cloud, in the scene's CRS.
    chosen : (N,) bool, optional
        Which rows of the photos may be used; by default all.

    Raises
    ------
    UsageError
        The cloud is not there.
    """
    if not cloud.is_file():
        raise UsageError("no such cloud", where=cloud, expected="a .las, .laz, .ply or .pcd file")
    photos = inputs.photos
    kept = pd.Series(True, index=photos.index) if chosen is None else chosen
    excluded = photos[~kept][["id", "image"]].reset_index(drop=True).assign(reason=NOT_CHOSEN)
    return ReconstructionTruth(
        inputs.scene,
        photos[kept].reset_index(drop=True),
        cloud,
        sha256_of(cloud),
        with_unposed(excluded, inputs),
    )
