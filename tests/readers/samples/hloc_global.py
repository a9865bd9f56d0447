"""hloc: `extract_features.main` with `netvlad`, of photos and tiles below one folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.readers.retrieval_support import Place

READER = "hloc-global"


def write(folder: Path, place: Place, dtype: Any = np.float32) -> Path:
    """Write a group for each image; hloc's `as_half` makes float16 of it."""
    path = folder / "global-feats-netvlad.h5"
    for scene in place.scenes:
        for letter, what, rows in zip(
            "qt", ("photos", "tiles"), place.descriptors(scene), strict=True
        ):
            for number, row in enumerate(rows):
                with h5py.File(path, "a", libver="latest") as file:
                    group = file.create_group(f"{scene.id}/{what}/{letter}{number:05d}.png")
                    group.create_dataset("global_descriptor", data=row.astype(dtype))
                    group.create_dataset("image_size", data=np.array([640, 480]))
    return path
