"""Matching by SIFT: features of photo and crop that are each other's nearest.

python examples/matching_sift.py airzoo-mini airzoo-mini-matching sift.npz
airzoo-bench eval matching sift.npz
"""

import sys

import numpy as np
import pycolmap

import airzoo_bench as ab

SIDE_PX = 1024
FEATURES = 2048
RATIO = 0.85
pycolmap.logging.minloglevel = pycolmap.logging.Level.WARNING.value


def features(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pixels (N, 2) and unit RootSIFT descriptors (N, 128) of a picture."""
    options = pycolmap.FeatureExtractionOptions(use_gpu=False)
    options.sift.max_num_features = FEATURES
    options.sift.first_octave = 0  # not of the picture made twice as large: four times as fast
    extractor = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
    grey = np.ascontiguousarray(image.mean(axis=2).round().astype(np.uint8))
    keypoints, found = extractor.extract(pycolmap.Bitmap.from_array(grey))
    places = np.array([(k.x, k.y, k.compute_scale()) for k in keypoints]).reshape(-1, 3)
    edge = np.minimum(places[:, :2], grey.shape[::-1] - places[:, :2]).min(axis=1, initial=np.inf)
    inside = edge > places[:, 2] + 1  # pycolmap leaves some descriptors at the border unwritten
    descriptors = found.data.reshape(-1, 128)[inside].astype(float)
    return places[inside, :2], descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True)


def nearest(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of descriptors that are each other's nearest, by far in `other`."""
    if min(len(one), len(other)) < 2:
        return np.zeros(0, int), np.zeros(0, int)
    distance = np.sqrt(np.maximum(2 - 2 * one @ other.T, 0))
    first, second = np.partition(distance, 1, axis=1)[:, :2].T
    found = distance.argmin(axis=1)
    mutual = distance.argmin(axis=0)[found] == np.arange(len(one))
    rows = np.flatnonzero(mutual & (first < RATIO * second))
    return rows, found[rows]


def main(benchmark: str, protocol: str, out: str) -> None:
    """Match every query with its crop."""
    opened = ab.load_benchmark(benchmark)
    with ab.PredictionWriter(out, protocol, opened) as writer:
        for scene in opened.scenes:
            for crop in scene.crops():
                photo = crop.query.read(SIDE_PX)
                query_xy, described = features(photo)
                crop_xy, of_crop = features(crop.image)
                rows, found = nearest(described, of_crop)
                full = np.array((crop.query.camera.width, crop.query.camera.height))
                query_xy = query_xy[rows] * (full / photo.shape[1::-1])
                writer.add(crop.query.id, query_xy=query_xy, map_xy=crop.to_map(crop_xy[found]))
                print(f"{crop.query.id}: {len(rows)} matches")  # noqa: T201
    print(f"wrote {out}")  # noqa: T201


if __name__ == "__main__":
    main(*sys.argv[1:])
