"""AnyLoc: `demo/anyloc_vlad_generate.py`, run once for the photos and once for the tiles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.readers.retrieval_support import Place


def write(folder: Path, place: Place) -> Path:
    """Write a folder of descriptors for the photos and one for the tiles of each scene."""
    home = folder / "anyloc"
    for scene in place.scenes:
        for letter, what, rows in zip(
            "qt", ("photos", "tiles"), place.descriptors(scene), strict=True
        ):
            out_dir = home / scene.id / what
            out_dir.mkdir(parents=True)
            for number, row in enumerate(rows):
                np.save(out_dir / f"{letter}{number:05d}.jpg.npy", row[np.newaxis])
    return home
