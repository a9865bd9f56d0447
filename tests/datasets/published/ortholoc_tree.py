"""OrthoLoC's tree as it is downloaded: samples over hills, each of its own frame and pixel size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]

SIDE = 48
PHOTO = (40, 30)
SAMPLES = {
    "test_outPlace": {"L08_R0000": 0.25, "L08_xDOP0001": 0.4, "L17_xDOPDSM0002": 0.1},
    "test_inPlace": {"L01_R0012": 0.2},
}


def make_tree(root: Path) -> Path:
    """Write both test sets below ``full``, and return the root."""
    for name, samples in SAMPLES.items():
        folder = root / "full" / name
        folder.mkdir(parents=True)
        for seed, (sample, scale) in enumerate(samples.items()):
            np.savez_compressed(folder / f"{sample}.npz", **make_sample(sample, scale, seed))  # type: ignore[arg-type]
    return root


def make_sample(name: str, scale: float, seed: int) -> Arrays:
    """Return the arrays of a sample; its camera looks at the midst of its map, from the south."""
    rng = np.random.default_rng(seed)
    rows, columns = np.indices((SIDE, SIDE))
    west, north = 13.0 * seed, -7.0 * seed
    x, y = west + columns * scale, north - rows * scale
    z = 100.0 + 4 * scale * np.sin(columns / 5.0) + 3 * scale * np.cos(rows / 7.0)
    wide = SIDE * scale
    middle = np.array([west + wide / 2, north - wide / 2, 100.0])
    centre = middle + wide * np.array((0.1, -0.5, 1.5)) + (0.0123457, 0.0765432, 0.0543217)
    forward = (middle - centre) / np.linalg.norm(middle - centre)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    rotation = np.stack((right, np.cross(forward, right), forward))
    pose = np.column_stack((rotation, -rotation @ centre))
    focal = 0.9 * PHOTO[0]
    return {
        "sample_id": np.array(name),
        "image_query": rng.integers(1, 255, (PHOTO[1], PHOTO[0], 3), np.uint8),
        "point_map": np.zeros((PHOTO[1], PHOTO[0], 3), np.float32),
        "image_dop": rng.integers(1, 255, (SIDE, SIDE, 3), np.uint8),
        "dsm": np.stack((x, y, z), axis=-1),
        "scale": np.array((scale, -scale)),
        "extrinsics": pose,
        # Centres of pixels are whole numbers: the midst of the photo is half a pixel less.
        "intrinsics": np.array(
            ((focal, 0, PHOTO[0] / 2 - 0.5), (0, focal, PHOTO[1] / 2 - 0.5), (0, 0, 1.0))
        ),
        "keypoints": np.zeros((0, 3)),
        "vertices": np.zeros((4, 3)),
        "faces": np.zeros((2, 3), np.int64),
        "extrinsics_refined": pose + 0.01,
    }


def matches(arrays: Arrays) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where cells of a sample's map are in its photo and in the map, corners being (0, 0).

    By OrthoLoC's own convention, to which half a pixel is added last.
    """
    rows, columns = (side.ravel() for side in np.mgrid[2:SIDE:3, 2:SIDE:3])
    points = arrays["dsm"][rows, columns]
    camera = points @ arrays["extrinsics"][:, :3].T + arrays["extrinsics"][:, 3]
    pixels = camera @ arrays["intrinsics"].T
    seen = pixels[:, :2] / pixels[:, 2:] + 0.5
    inside = ((seen >= 0) & (seen <= PHOTO)).all(axis=1)
    return seen[inside], (np.stack((columns, rows), axis=-1) + 0.5)[inside]
