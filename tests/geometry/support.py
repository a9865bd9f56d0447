from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from hypothesis import settings
from hypothesis import strategies as st
from rasterio import Affine
from scipy.spatial.transform import Rotation

# The coefficients of real lenses: a drone's, a strong barrel, a strong pincushion, a wide angle.
LENSES = (
    (0.0091, 0.0136, -0.00153, 0.00226, 0.0),
    (-0.28, 0.12, 0.0008, -0.0003, -0.02),
    (0.15, 0.05, 0.001, 0.002, 0.03),
    (-0.11, 0.0, 0.0, 0.0, 0.0),
    (0.0, 0.0, 0.0, 0.0, 0.0),
)

quick = settings(max_examples=25, deadline=None, derandomize=True)
seeds = st.integers(0, 2**32 - 1)


def write_tif(path: Path, bands: np.ndarray, **profile: Any) -> Path:
    """Write (B, H, W) or (H, W) as GeoTIFF: 0.5 m pixels of UTM 15N unless told otherwise."""
    stack = bands[None] if bands.ndim == 2 else bands
    settings_ = {
        "driver": "GTiff",
        "count": stack.shape[0],
        "height": stack.shape[1],
        "width": stack.shape[2],
        "dtype": stack.dtype,
        "crs": "EPSG:32615",
        "transform": Affine(0.5, 0.0, 576000.0, 0.0, -0.5, 5188000.0),
    }
    with rasterio.open(path, "w", **(settings_ | profile)) as dataset:
        dataset.write(stack)
    return path


def looking_down(tilt_deg: float, azimuth_deg: float = 0.0) -> np.ndarray:
    """World-to-camera rotation (1, 3, 3); tilt 0 is nadir, north up, 90 due north."""
    nadir = np.diag((1.0, -1.0, -1.0))
    tilt = Rotation.from_euler("x", -tilt_deg, degrees=True).as_matrix()
    turn = Rotation.from_euler("z", azimuth_deg, degrees=True).as_matrix()
    return (tilt @ nadir @ turn)[None]
