"""Whether R@1 of two retrieval results differs by more than an error of the truth moves it.

python examples/sensitivity.py brighton results/sift results/random
"""

import sys

import numpy as np

import airzoo_bench as ab
from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.benchmark.queries import POSE_COLUMNS, SceneInputs, poses_of
from airzoo_bench.core.files import data_root
from airzoo_bench.geometry.poses import matrix_to_quaternion
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.protocol.model import find_protocol
from airzoo_bench.retrieval.prepare import answering_tiles
from airzoo_bench.retrieval.truth import read_truth

VARIANTS = {"heading 5 degrees": (5, 0, 0), "height 5 m": (0, 5, 0), "positions 2 m": (0, 0, 2)}
DRAWS = 20  # of positions; headings and heights go to both ends


def moved(photos, heading, height, position, random):
    """Return photos whose cameras are turned clockwise, lifted, and shifted each by itself."""
    poses, turn = poses_of(photos), np.radians(heading)
    sine, cosine = np.sin(turn), np.cos(turn)
    world = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    shift = random.normal(0, 1, (len(photos), 2)) * position
    centres = poses.centres + np.column_stack([shift, np.full(len(photos), height)])
    photos = photos.copy()
    photos[list(POSE_COLUMNS)] = np.column_stack(
        [matrix_to_quaternion(poses.rotation @ world), centres]
    )
    return photos


def recalls(benchmark, scene, rules, results, off, random):
    """Return R@1 of each result on a scene whose assumed values are off."""
    truth = read_truth(benchmark.scene_folder(scene.id), scene.id)
    photos = moved(truth.queries, *off, random)
    info = open_info(benchmark.resolve(scene.gallery or scene.dom))
    inputs = SceneInputs(scene.id, photos, scene.crs, info, None, scene.plane_height_m)
    positives, ids = answering_tiles(inputs, truth.tiles, rules), truth.tiles["id"].to_numpy(str)
    asked = np.flatnonzero(positives.counts)  # a query that no tile answers is left out
    firsts = [one.records.set_index("query").loc[truth.queries["id"], "tile@1"] for one in results]
    return [
        np.mean([first.iloc[q] in ids[positives.tiles_of(q)] for q in asked]) for first in firsts
    ]


def main(name: str, *paths: str) -> None:
    """Print R@1 of two results, and how far it and their difference move by each variant."""
    results, benchmark = [ab.load_result(path) for path in paths], find_benchmark(name, data_root())
    protocol = find_protocol(results[0].result.protocol.name, data_root())
    rules = protocol.map_rules()[1] if protocol.track == "retrieval" else None
    if len(results) != 2 or rules is None or rules.rule not in ("plane", "iou"):
        sys.exit("give two results of retrieval by the rule plane or iou, which need no surface")
    scenes = [benchmark.scene(scene.id) for scene in protocol.scenes]

    def overall(off, seed=0):
        random = np.random.default_rng(seed)
        found = [recalls(benchmark, s, rules, results, off, random) for s in scenes]
        return 100 * np.mean(found, axis=0)

    base, (first, second) = overall((0, 0, 0)), [one.name for one in results]
    apart = abs(base[0] - base[1])
    print(f"R@1: {first} {base[0]:.2f}, {second} {base[1]:.2f}, difference {apart:.2f}")  # noqa: T201
    for what, off in VARIANTS.items():
        ends = [np.multiply(sign, off) for sign in (-1, 1)]
        cases = [(off, seed) for seed in range(DRAWS)] if off[2] else [(end, 0) for end in ends]
        found = np.array([base, *(overall(*case) for case in cases)])
        one, two = (f"{low:.2f} to {high:.2f}" for low, high in np.sort(found, 0)[[0, -1]].T)
        print(f"{what}: {first} {one}, {second} {two}")  # noqa: T201
        by = np.abs(np.diff(found - base, axis=1)).max()
        verdict = "larger" if apart > by else "not larger"
        print(f"{what}: the difference moves by up to {by:.2f}, and is {verdict}")  # noqa: T201


if __name__ == "__main__":
    main(*sys.argv[1:])
