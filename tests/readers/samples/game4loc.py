"""Game4Loc: what the lines of `airzoo_bench.readers.game4loc` save."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.readers.retrieval_support import Place


def write(folder: Path, place: Place) -> Path:
    """Write features and names, as lists of the method's dataset class have them."""
    pairs = [place.descriptors(scene) for scene in place.scenes]
    photos = [
        f"{scene.id}/q{n:05d}.jpg" for scene in place.scenes for n in range(len(scene.positives))
    ]
    tiles = [f"{scene.id}/t{n:05d}.png" for scene in place.scenes for n in range(scene.n_tiles)]
    np.savez(
        folder / "features.npz",
        query_features=np.concatenate([one for one, _ in pairs]),
        query_names=np.array(photos),
        gallery_features=np.concatenate([one for _, one in pairs]),
        gallery_names=np.array(tiles),
    )
    return folder / "features.npz"
