"""Pose solving beside bare pycolmap calls: overhead, gain of a second worker, a whole benchmark.

Every query has 5,000 matches, half of them outliers, and a pixel of noise. Bare calls get cameras,
options and shifted points ready-made, and nothing is done with their answers; rounds of the three
ways alternate, and the ratios are those of the fastest rounds. The share of the machine that was
idle just before is printed, for with less than all of it the second worker has nothing to run on.

Usage: python benchmarks/bench_pose.py [--small | --hardest]
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pycolmap
import rasterio
from rasterio import Affine

from airzoo_bench.benchmark.queries import query_table
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses, world_to_camera
from airzoo_bench.geometry.rasters import open_info, world_to_pixel
from airzoo_bench.matching.lifting import lift
from airzoo_bench.matching.maps import ReferenceMap
from airzoo_bench.matching.scene_predictions import ScenePredictions
from airzoo_bench.matching.scoring import score_scene
from airzoo_bench.matching.solving import PoseProblem, PoseSettings, Status, solve_poses
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols

N_QUERIES = 351
N_MATCHES = 5000
ROUNDS = 5
OFFSET = np.array((400_000.0, 3_130_000.0, 60.0))
LENSES = {"pinhole": np.zeros(5), "distorted": np.array((-0.28, 0.12, 0.0008, -0.0003, -0.02))}
SETTINGS: PoseSettings = {
    "solver": "colmap",
    "max_error_px": 5.0,
    "min_inlier_ratio": 0.01,
    "min_trials": 1000,
    "max_trials": 100_000,
    "confidence": 0.9999,
    "seed": 0,
    "max_matches": 20_000,
    "max_trials_times_matches": 500_000_000,
}


def make_problem(
    seed: int, lens: np.ndarray, hills: np.ndarray | None = None, west: float = 0.0
) -> PoseProblem:
    """Make an oblique photo of low hills from 140 m above: any, or those of a surface model."""
    rng = np.random.default_rng(seed)
    K = np.array([[[2900.0, 0.0, 2000.0], [0.0, 2900.0, 1500.0], [0.0, 0.0, 1.0]]])
    camera = Cameras.from_matrices(K, 4000, 3000, lens[None])
    tilt, turn = np.radians((rng.uniform(5.0, 35.0), rng.uniform(0.0, 360.0)))
    down = np.array(
        ((1, 0, 0), (0, -np.cos(tilt), -np.sin(tilt)), (0, np.sin(tilt), -np.cos(tilt)))
    )
    about = np.array(((np.cos(turn), -np.sin(turn), 0), (np.sin(turn), np.cos(turn), 0), (0, 0, 1)))
    poses = Poses.from_centres((down @ about)[None], OFFSET[None] + np.array((0.0, 0.0, 140.0)))
    points = rng.uniform((-300.0, -300.0, 0.0), (300.0, 300.0, 25.0), (150_000, 3)) + OFFSET
    if hills is not None:
        points[:, 2] = np.interp(points[:, 0], west + 0.5 * (np.arange(len(hills)) + 0.5), hills)
    xy = project(camera, world_to_camera(poses, points[None]))[0]
    seen = np.flatnonzero(((xy > 0.0) & (xy < (4000.0, 3000.0))).all(axis=1))[:N_MATCHES]
    xy, points = xy[seen] + rng.normal(size=(len(seen), 2)), points[seen]
    wrong = rng.random(len(seen)) < 0.5
    xy[wrong] = rng.random((wrong.sum(), 2)) * (4000.0, 3000.0)
    return PoseProblem(camera, xy, points)


def bare_calls(problems: list[PoseProblem]) -> Callable[[], object]:
    """Prepare everything that pycolmap needs, and return what calls it."""
    options = pycolmap.AbsolutePoseEstimationOptions(
        ransac={
            "max_error": SETTINGS["max_error_px"],
            "min_inlier_ratio": SETTINGS["min_inlier_ratio"],
            "min_num_trials": SETTINGS["min_trials"],
            "max_num_trials": SETTINGS["max_trials"],
            "confidence": SETTINGS["confidence"],
            "random_seed": SETTINGS["seed"],
        }
    )
    ready = [
        (query_xy, points - np.median(points, axis=0), colmap_camera(camera), options)
        for camera, query_xy, points in problems
    ]
    return lambda: [pycolmap.estimate_absolute_pose(*arguments) for arguments in ready]


def colmap_camera(camera: Cameras) -> pycolmap.Camera:
    """Make COLMAP's camera."""
    parameters = [*camera.focal[0], *camera.principal_point[0]]
    lens = camera.distortion[0]
    return pycolmap.Camera(
        model="FULL_OPENCV" if lens.any() else "PINHOLE",
        width=int(camera.width[0]),
        height=int(camera.height[0]),
        params=[*parameters, *lens, 0.0, 0.0, 0.0] if lens.any() else parameters,
    )


def seconds(work: Callable[[], object]) -> float:
    """Time one run."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def idle_share(wait_s: float = 1.0) -> float:
    """Share of all processors' time that nobody uses, or NaN where that is not told."""
    try:
        import psutil
    except ImportError:
        return float("nan")
    return float(psutil.cpu_times_percent(wait_s).idle) / 100.0


def compare(name: str, n_queries: int) -> None:
    """Print a row: bare calls, one worker, two workers."""
    problems = [make_problem(seed, LENSES[name]) for seed in range(n_queries)]
    ways: list[Callable[[], object]] = [
        bare_calls(problems),
        lambda: solve_poses(problems, jobs=1, **SETTINGS),
        lambda: solve_poses(problems, jobs=2, **SETTINGS),
    ]
    idle = idle_share()
    times = np.array([[seconds(way) for way in ways] for _ in range(ROUNDS)])
    bare, one, two = times.min(axis=0)
    overhead = f"{100 * (one / bare - 1):.1f} %"
    print(
        f"{name:12}{n_queries:9}{bare:10.2f}{one:10.2f}{two:10.2f}{overhead:>10}{one / two:8.2f}"
        f"{100 * idle:8.0f}",
        flush=True,
    )


def whole(name: str, n_queries: int) -> None:
    """Print a row: a benchmark's queries by two workers, once."""
    problems = [make_problem(seed, LENSES[name]) for seed in range(n_queries)]
    idle = idle_share()
    start = time.perf_counter()
    estimates = solve_poses(problems, jobs=2, **SETTINGS)
    took = time.perf_counter() - start
    solved = sum(estimate.status is Status.SOLVED for estimate in estimates)
    print(
        f"{name:12}{n_queries:9}{'':20}{took:10.2f}{f'{solved} solved':>18}{100 * idle:8.0f}",
        flush=True,
    )


def track(n_queries: int) -> None:
    """Print a row: the whole track (lifting, solving, records) beside bare calls on its points."""
    with tempfile.TemporaryDirectory() as folder:
        truth, predicted = made_scene(Path(folder), n_queries)
        lifted = lift(predicted.map_xy, truth.maps[0].dom, truth.maps[0].dsm, jobs=1)
        cameras, parts = truth.cameras, predicted.parts()
        problems = [
            PoseProblem(cameras.take(row), predicted.query_xy[part], lifted.points[part])
            for row, part in enumerate(parts)
        ]
        shipped = load_protocol(shipped_protocols()["photos-matching"])
        settings = {key: value for key, value in SETTINGS.items() if key != "solver"}
        solver = shipped.solver.model_copy(update={"name": "colmap", **settings})
        protocol = shipped.model_copy(update={"solver": solver})
        bare = bare_calls(problems)
        ways: list[Callable[[], object]] = [
            bare,
            lambda: score_scene(truth, predicted, protocol, Run(jobs=1)),
            lambda: score_scene(truth, predicted, protocol, Run(jobs=2)),
        ]
        idle = idle_share()
        times = np.array([[seconds(way) for way in ways] for _ in range(ROUNDS)]).min(axis=0)
    overhead = f"{100 * (times[1] / times[0] - 1):.1f} %"
    row = "".join(f"{time:10.2f}" for time in times)
    gain = times[1] / times[2]
    print(f"{'whole track':12}{n_queries:9}{row}{overhead:>10}{gain:8.2f}{100 * idle:8.0f}")


def made_scene(folder: Path, n_queries: int) -> tuple[MatchingTruth, ScenePredictions]:
    """Make pinhole photos of flat ground, matched to a map of 0.5 m as `make_problem` does."""
    side, gsd = 1600, 0.5
    west, north = OFFSET[0] - side * gsd / 2, OFFSET[1] + side * gsd / 2
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": "EPSG:4547"}
    profile |= {"width": side, "height": side, "transform": Affine(gsd, 0, west, 0, -gsd, north)}
    hills = 60 + 12 * np.sin(np.arange(side, dtype=np.float32) / 80)
    with rasterio.open(folder / "dsm.tif", "w", **profile) as raster:
        raster.write(np.broadcast_to(hills, (1, side, side)).astype(np.float32))
    info = open_info(folder / "dsm.tif")
    problems = [make_problem(seed, LENSES["pinhole"], hills, west) for seed in range(n_queries)]
    counts = [len(problem.points) for problem in problems]
    points = np.concatenate([problem.points for problem in problems])
    map_xy = world_to_pixel(info.transform, points[:, :2])
    cameras = Cameras.from_matrices(
        np.concatenate([problem.camera.matrices for problem in problems]), 4000, 3000
    )
    poses = Poses(
        rotation=np.tile(np.diag((1.0, -1.0, -1.0)), (n_queries, 1, 1)),
        centres=np.tile(OFFSET + np.array((0.0, 0.0, 140.0)), (n_queries, 1)),
    )
    names = [f"scene/q{number}" for number in range(n_queries)]
    photos = query_table(names, names, cameras, poses, poses)
    crops = np.tile([0, 0, side, side], (n_queries, 1))
    maps = (ReferenceMap(info, folder / "dsm.tif", ""),)
    truth = MatchingTruth("scene", photos, crops, maps, photos.iloc[:0])
    offsets = np.concatenate([[0], np.cumsum(counts)])
    query_xy = np.concatenate([problem.query_xy for problem in problems])
    answered = np.ones(n_queries, np.bool_)
    return truth, ScenePredictions(answered, offsets, query_xy, map_xy, np.zeros((0, 3)), None)


def hardest(name: str) -> None:
    """Print the processor time of a query at the limits, whose matches are all random."""
    random, count = np.random.default_rng(0), SETTINGS["max_matches"]
    query_xy = random.random((count, 2)) * (4000.0, 3000.0)
    points = random.uniform((-300.0, -300.0, 0.0), (300.0, 300.0, 25.0), (count, 3)) + OFFSET
    problem = PoseProblem(make_problem(0, LENSES[name]).camera, query_xy, points)
    start = time.process_time()
    solve_poses([problem], jobs=1, **SETTINGS)
    print(f"{name}, {count} random matches: {time.process_time() - start:.1f} s CPU", flush=True)


def main() -> None:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="a tenth of the queries")
    parser.add_argument("--hardest", action="store_true", help="only queries at the limits")
    given = parser.parse_args()
    if given.hardest:
        for name in LENSES:
            hardest(name)
        return
    shrink = 10 if given.small else 1
    print(
        f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.2f}, {N_MATCHES} matches a query"
    )
    head = ("queries", "bare s", "1 worker", "2 workers", "overhead", "gain", "idle %")
    print(f"{'':12}{head[0]:>9}" + "".join(f"{title:>10}" for title in head[1:5]), end="")
    print("".join(f"{title:>8}" for title in head[5:]))
    for name in LENSES:
        compare(name, 40 // shrink)
    track(40 // shrink)
    for name in LENSES:
        whole(name, N_QUERIES // shrink)


if __name__ == "__main__":
    main()
