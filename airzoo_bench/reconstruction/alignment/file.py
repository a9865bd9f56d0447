"""``alignment.json``: how each scene was aligned, its scale and its residuals."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.files import atomic_write
from airzoo_bench.reconstruction.alignment.cameras import Alignment, Residuals

__all__ = ["write_alignments"]


def write_alignments(alignments: Mapping[str, Alignment], path: Path) -> None:
    """Write the alignment of each scene, by its id."""
    values = {scene: _alignment(found) for scene, found in alignments.items()}
    with atomic_write(path, "w") as stream:
        stream.write(json.dumps(values, indent=1, allow_nan=False) + "\n")


def _alignment(found: Alignment) -> dict[str, Any]:
    values: dict[str, Any] = {
        "method": found.method,
        "scale": found.transform.scale,
        "matrix": found.transform.matrix.tolist(),
        "cameras": found.cameras,
        "cameras_missing": found.missing,
        "inliers": found.inliers,
        "inlier_names": list(found.inlier_names),
        "inlier_limit_m": found.inlier_limit,
        "used_orientations": found.used_orientations,
        "robust": found.robust,
    }
    for name in ("centres", "inlier_centres", "rotations_deg"):
        residuals: Residuals | None = getattr(found, name)
        values[name] = None if residuals is None else _finite(asdict(residuals))
    values["icp"] = None if found.icp is None else _finite(asdict(found.icp))
    values["icp_failure"] = found.icp_failure
    return values


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """Write infinite numbers as text, as in results, at whatever depth."""
    return {
        key: _finite(one) if isinstance(one, dict) else _text(one) for key, one in values.items()
    }


def _text(value: object) -> object:
    return "Infinity" if isinstance(value, float) and np.isinf(value) else value
