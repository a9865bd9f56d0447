"""Reconstruction of level ground: where each photo's rays meet a plane, by the photo's own prior.

python examples/reconstruction_flat.py airzoo-mini airzoo-mini-reconstruction flat
airzoo-bench eval reconstruction flat
"""

import sys

import numpy as np

import airzoo_bench as ab

SIDE_PX = 128


def depth_of_plane(
    matrix: np.ndarray, rotation: np.ndarray, height_m: float, size: tuple[int, int]
) -> np.ndarray:
    """Return the depth (H, W) of a level plane so far below a camera; 0 above the horizon."""
    row, column = np.indices(size) + 0.5
    rays = np.stack((column, row, np.ones(size)), axis=-1) @ np.linalg.inv(matrix).T
    down = -(rays @ rotation)[..., 2]
    return np.where(down > 0.1, height_m / np.maximum(down, 0.1), 0.0)


def main(benchmark: str, protocol: str, out: str) -> None:
    """Write a depth map of every photo that has a prior."""
    opened = ab.load_benchmark(benchmark)
    with ab.PredictionWriter(out, protocol, opened) as writer:
        for scene in opened.scenes:
            for photo in scene.photos():
                if photo.prior is None:
                    continue
                height, width = photo.read(SIDE_PX).shape[:2]
                matrix = photo.camera.scaled(width, height).K
                rotation, centre = photo.prior.rotation, photo.prior.centre
                above = centre[2] - scene.plane_height_m
                writer.add(
                    photo.id,
                    depth=depth_of_plane(matrix, rotation, above, (height, width)),
                    intrinsics=matrix,
                    rotation=rotation,
                    centre=centre,
                )
    print(f"wrote {out}")  # noqa: T201


if __name__ == "__main__":
    main(*sys.argv[1:])
