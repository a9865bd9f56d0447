"""Pose solving beside bare pycolmap calls: overhead, gain of a second worker, the hardest query.

Every query has 5,000 matches, half of them outliers, and a pixel of noise. Bare calls get cameras,
options and shifted points ready-made, and nothing is done with their answers. Rounds of the ways
alternate; "overhead" is that of processor seconds, "gain" that of the clock, both of the fastest
rounds. "Hardest" is a query of 20,000 random matches, beside an honest scene of 18 queries.

Usage: python benchmarks/bench_pose.py [--small]
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pycolmap
import rasterio
from rasterio import Affine

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from airzoo_bench.benchmark.queries import query_table
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses, world_to_camera
from airzoo_bench.geometry.rasters import open_info, world_to_pixel
from airzoo_bench.matching.lifting import lift
from airzoo_bench.matching.predictions import Correspondences, ScenePredictions
from airzoo_bench.matching.scoring import score_scene
from airzoo_bench.matching.solving import solve_queries
from airzoo_bench.matching.truth import MatchingTruth, ReferenceMap
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from tests.matching.pose_support import SOLVER, Problem, joined

N_MATCHES, ROUNDS = 5000, 5
OFFSET = np.array((400_000.0, 3_130_000.0, 60.0))
LENSES = {"pinhole": np.zeros(5), "distorted": np.array((-0.28, 0.12, 0.0008, -0.0003, -0.02))}
SIDE, GSD = 1600, 0.5
WEST, NORTH = OFFSET[0] - SIDE * GSD / 2, OFFSET[1] + SIDE * GSD / 2
HILLS = 60 + 12 * np.sin(np.arange(SIDE, dtype=np.float32) / 80)


def make_problem(seed: int, lens: np.ndarray) -> Problem:
    """Make an oblique photo of the hills from 140 m above."""
    rng = np.random.default_rng(seed)
    K = np.array([[[2900.0, 0.0, 2000.0], [0.0, 2900.0, 1500.0], [0.0, 0.0, 1.0]]])
    camera = Cameras.from_matrices(K, 4000, 3000, lens[None])
    tilt, turn = np.radians((rng.uniform(5.0, 35.0), rng.uniform(0.0, 360.0)))
    down = np.array(
        ((1, 0, 0), (0, -np.cos(tilt), -np.sin(tilt)), (0, np.sin(tilt), -np.cos(tilt)))
    )
    about = np.array(((np.cos(turn), -np.sin(turn), 0), (np.sin(turn), np.cos(turn), 0), (0, 0, 1)))
    poses = Poses.from_centres((down @ about)[None], OFFSET[None] + np.array((0.0, 0.0, 140.0)))
    points = rng.uniform((-300.0, -300.0, 0.0), (300.0, 300.0, 0.0), (150_000, 3)) + OFFSET
    points[:, 2] = np.interp(points[:, 0], WEST + GSD * (np.arange(SIDE) + 0.5), HILLS)
    xy = project(camera, world_to_camera(poses, points[None]))[0]
    seen = np.flatnonzero(((xy > 0.0) & (xy < (4000.0, 3000.0))).all(axis=1))[:N_MATCHES]
    xy, points = xy[seen] + rng.normal(size=(len(seen), 2)), points[seen]
    wrong = rng.random(len(seen)) < 0.5
    xy[wrong] = rng.random((wrong.sum(), 2)) * (4000.0, 3000.0)
    return Problem(camera, xy, points)


def bare_calls(problems: Sequence[Problem]) -> Callable[[], object]:
    """Prepare everything that pycolmap needs, and return what calls it."""
    ransac = {
        "max_error": SOLVER.max_error_px,
        "min_inlier_ratio": SOLVER.min_inlier_ratio,
        "min_num_trials": SOLVER.min_trials,
        "max_num_trials": SOLVER.max_trials,
        "confidence": SOLVER.confidence,
        "random_seed": SOLVER.seed,
    }
    options = pycolmap.AbsolutePoseEstimationOptions(ransac=ransac)
    ready = [
        (query_xy, points - np.median(points, axis=0), colmap_camera(camera), options)
        for camera, query_xy, points in problems
    ]
    return lambda: [pycolmap.estimate_absolute_pose(*arguments) for arguments in ready]


def colmap_camera(camera: Cameras) -> pycolmap.Camera:
    """Make COLMAP's camera."""
    parameters, lens = [*camera.focal[0], *camera.principal_point[0]], camera.distortion[0]
    return pycolmap.Camera(
        model="FULL_OPENCV" if lens.any() else "PINHOLE",
        width=int(camera.width[0]),
        height=int(camera.height[0]),
        params=[*parameters, *lens, 0.0, 0.0, 0.0] if lens.any() else parameters,
    )


def seconds(work: Callable[[], object]) -> tuple[float, float]:
    """Return the processor's and the clock's seconds of one run."""
    clock, processor = time.perf_counter(), time.process_time()
    work()
    return time.process_time() - processor, time.perf_counter() - clock


def compare(name: str, bare: Callable[[], object], ours: Callable[[int], object]) -> None:
    """Print a row: bare calls, one worker, two workers."""
    ways = [bare, lambda: ours(1), lambda: ours(2)]
    times = np.array([[seconds(way) for way in ways] for _ in range(ROUNDS)]).min(axis=0)
    row = "".join(f"{value:10.2f}" for value in times[:, 0])
    overhead, gain = 100 * (times[1, 0] / times[0, 0] - 1), times[1, 1] / times[2, 1]
    print(f"{name:14}{row}{overhead:9.1f} %{gain:8.2f}", flush=True)


def whole_track(n_queries: int) -> None:
    """Print a row: lifting, solving and records beside bare calls on the lifted points."""
    with tempfile.TemporaryDirectory() as folder:
        truth, matches = made_scene(Path(folder), n_queries)
        points = lift(matches.map_xy, truth.maps[0].dom, truth.maps[0].dsm, jobs=1).points
        problems = [
            Problem(truth.cameras.take(row), matches.query_xy[part], points[part])
            for row, part in enumerate(matches.parts())
        ]
        shipped = load_protocol(shipped_protocols()["photos-matching"])
        protocol = shipped.model_copy(update={"solver": SOLVER})
        predicted = ScenePredictions(np.ones(n_queries, np.bool_), matches)
        compare(
            "whole track",
            bare_calls(problems),
            lambda jobs: score_scene(truth, predicted, protocol, Run(jobs=jobs)),
        )


def made_scene(folder: Path, n_queries: int) -> tuple[MatchingTruth, Correspondences]:
    """Make pinhole photos, matched to a map of 0.5 m."""
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": "EPSG:4547"}
    profile |= {"width": SIDE, "height": SIDE, "transform": Affine(GSD, 0, WEST, 0, -GSD, NORTH)}
    with rasterio.open(folder / "dsm.tif", "w", **profile) as raster:
        raster.write(np.broadcast_to(HILLS, (1, SIDE, SIDE)).astype(np.float32))
    info = open_info(folder / "dsm.tif")
    queries = joined([make_problem(seed, LENSES["pinhole"]) for seed in range(n_queries)])
    down = np.tile(np.diag((1.0, -1.0, -1.0)), (n_queries, 1, 1))
    centres = np.tile(OFFSET + np.array((0.0, 0.0, 140.0)), (n_queries, 1))
    poses = Poses(rotation=down, centres=centres)
    names = [f"scene/q{number}" for number in range(n_queries)]
    photos = query_table(names, names, queries.cameras, poses, poses)
    maps = (ReferenceMap(info, folder / "dsm.tif", ""),)
    crops = np.tile([0, 0, SIDE, SIDE], (n_queries, 1))
    truth = MatchingTruth("scene", photos, crops, maps, photos.iloc[:0])
    map_xy = world_to_pixel(info.transform, queries.points[:, :2])
    matches = (queries.offsets, queries.query_xy, map_xy)
    return truth, Correspondences(*matches, "map", None, None)


def hardest() -> None:
    """Print the processor time of a query at the limits, and of an honest scene."""
    random, count = np.random.default_rng(0), SOLVER.max_matches
    query_xy = random.random((count, 2)) * (4000.0, 3000.0)
    points = random.uniform((-300.0, -300.0, 0.0), (300.0, 300.0, 25.0), (count, 3)) + OFFSET
    honest = [make_problem(seed, LENSES["pinhole"]) for seed in range(18)]
    hard = joined([Problem(honest[0].camera, query_xy, points)])
    scene = joined(honest)
    times = np.array(
        [
            [seconds(lambda q=q: solve_queries(q, SOLVER, Run()))[0] for q in (hard, scene)]
            for _ in range(2)
        ]
    ).min(axis=0)
    print(
        f"{count} random matches in a query: {times[0]:.2f} s, an honest scene of 18 queries: "
        f"{times[1]:.2f} s, {times[0] / times[1]:.1f} times"
    )


def main() -> None:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="a quarter of the queries")
    count = 10 if parser.parse_args().small else 40
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.2f}, {count} queries")
    print(f"{'':14}{'bare':>10}{'1 worker':>10}{'2 workers':>10}{'overhead':>11}{'gain':>8}")
    for name, lens in LENSES.items():
        problems = [make_problem(seed, lens) for seed in range(count)]
        queries = joined(problems)
        compare(
            name,
            bare_calls(problems),
            lambda jobs, q=queries: solve_queries(q, SOLVER, Run(jobs=jobs)),
        )
    whole_track(count)
    hardest()


if __name__ == "__main__":
    main()
