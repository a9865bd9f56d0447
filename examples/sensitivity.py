"""How R@1 moves when the headings, heights or positions that a truth assumes are off.

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
    """Print R@1 of each result, its span, and the largest change of a difference."""
    results, benchmark = [ab.load_result(path) for path in paths], find_benchmark(name, data_root())
    protocol = find_protocol(results[0].result.protocol.name, data_root())
    _, rules = protocol.map_rules()
    if rules.rule not in ("plane", "iou"):
        sys.exit(f"the truth is made by the rule {rules.rule}: only plane and iou need no surface")
    scenes = [benchmark.scene(scene.id) for scene in protocol.scenes]

    def overall(off, seed=0):
        random = np.random.default_rng(seed)
        found = [recalls(benchmark, s, rules, results, off, random) for s in scenes]
        return 100 * np.mean(found, axis=0)

    base = overall((0, 0, 0))
    for what, off in VARIANTS.items():
        ends = [np.multiply(sign, off) for sign in (-1, 1)]
        found = np.array(
            [overall(off, seed) for seed in range(DRAWS)] if off[2] else [*map(overall, ends)]
        )
        for one, here, low, high in zip(results, base, found.min(0), found.max(0), strict=True):
            print(f"{what}: {one.name} {here:.2f}, between {low:.2f} and {high:.2f}")  # noqa: T201
        print(f"{what}: noise floor {np.ptp(found - base, axis=1).max():.2f} points")  # noqa: T201


if __name__ == "__main__":
    main(*sys.argv[1:])
