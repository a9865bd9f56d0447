"""A made world with exact matches: hills, a coarse map, oblique cameras; 2D-3D matches by seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import rasterio
import tomli_w
from PIL import Image
from rasterio import Affine
from scipy.ndimage import map_coordinates

from airzoo_bench.benchmark.folder import BenchmarkFile, SceneFile, write_benchmark_file
from airzoo_bench.benchmark.queries import SceneInputs, photo_table, write_queries
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.evaluation.evaluate import Evaluation, evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg, world_to_camera
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.predictions import Correspondences
from airzoo_bench.matching.protocol import MatchingProtocol, Solver
from airzoo_bench.matching.solving import PoseEstimate
from airzoo_bench.matching.track import TRACK, SceneAnswers
from airzoo_bench.matching.truth import MatchingTruth, build_truth, write_truth
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from tests.geometry.support import looking_down
from tests.support import PLACE_CRS, write_raster

SCENE = "hills"
N_QUERIES = 5
SIZE = (640, 480)
FOCAL = 520.0
LENS = (-0.05, 0.02, 1e-3, -5e-4, 0.0)
EAST, NORTH = 500_000.0, 5_200_000.0
MAP_PX, MAP_GSD = 300, 2.0
DSM_PX, DSM_GSD = 140, 5.0
# The surface model begins outside the map, by a distance that is no multiple of its pixels.
DSM_OFFSET = -33.0
N_MATCHES = 60


@dataclass(frozen=True)
class World:
    """A benchmark folder `root / SCENE` and exact matches of its queries."""

    root: Path
    protocol: MatchingProtocol
    truth: MatchingTruth
    query_xy: list[np.ndarray[Any, Any]]
    map_xy: list[np.ndarray[Any, Any]]
    points: list[np.ndarray[Any, Any]]

    @property
    def folder(self) -> Path:
        return self.root / SCENE

    @property
    def ids(self) -> list[str]:
        return self.truth.queries["id"].tolist()

    def matches(self) -> dict[str, Any]:
        """Return the fields of a prediction file of exact matches."""
        return self.correspondences(self.query_xy, map_xy=self.map_xy)

    def in_crops(self) -> dict[str, Any]:
        """Return the same matches in pixels of the queries' crops."""
        corners = self.truth.crops[:, :2]
        local = [xy - corner for xy, corner in zip(self.map_xy, corners, strict=True)]
        return self.correspondences(self.query_xy, map_xy=local) | {"map_frame": np.array("crop")}

    def pairs(self) -> dict[str, Any]:
        """Return the same matches with points instead of map pixels."""
        return self.correspondences(self.query_xy, points3d=self.points)

    def poses(self) -> dict[str, Any]:
        """Return the true poses as R and t."""
        poses = self.truth.poses
        return self.named(poses=np.dstack([poses.rotation, poses.translation]))

    def correspondences(self, query_xy: list[Any], **lists: list[Any]) -> dict[str, Any]:
        offsets = np.cumsum([0, *map(len, query_xy)])
        parts = {key: np.concatenate(rows) for key, rows in {"query_xy": query_xy, **lists}.items()}
        return self.named(offsets=offsets, **parts)

    def named(self, **fields: Any) -> dict[str, Any]:
        name, ids = np.array(self.protocol.name), np.array(self.ids)
        return {"protocol": name, "query_ids": ids, **fields}

    def write(self, path: Path, fields: dict[str, Any]) -> Path:
        np.savez(path, **fields)
        return path


def made_matching_protocol(base: str = "photos-matching", **sections: Any) -> MatchingProtocol:
    """Return a shipped protocol for the made scene, with some keys of sections changed."""
    values = load_protocol(shipped_protocols()[base]).model_dump(by_alias=True)
    scenes = ({"id": SCENE, "title": "Hills"},)
    values |= {"name": f"{SCENE}-matching", "benchmark": SCENE, "scenes": scenes}
    values |= {section: values[section] | keys for section, keys in sections.items()}
    return MatchingProtocol.model_validate(values)


def made_inputs(folder: Path) -> SceneInputs:
    """Write rasters and photos, and return what the truth is made from."""
    (folder / "photos").mkdir(parents=True)
    ground = np.random.default_rng(0).integers(0, 256, (3, MAP_PX, MAP_PX), np.uint8)
    grid = Affine(MAP_GSD, 0, EAST, 0, -MAP_GSD, NORTH)
    dom = write_raster(folder / "dom.tif", ground, transform=grid)
    row, column = np.mgrid[:DSM_PX, :DSM_PX]
    hills = 100 + 12 * np.sin(column / 9) * np.cos(row / 7) + 0.05 * column
    grid = Affine(DSM_GSD, 0, EAST + DSM_OFFSET, 0, -DSM_GSD, NORTH - DSM_OFFSET)
    heights = hills[None].astype(np.float32)
    dsm = write_raster(folder / "dsm.tif", heights, transform=grid, nodata=-9999.0)
    images = tuple(f"q{q}.png" for q in range(N_QUERIES))
    for number, name in enumerate(images):
        picture = Image.new("RGB", SIZE, (40 * number, 80, 120))
        picture.save(folder / "photos" / name, compress_level=1)
    K = ((FOCAL, 0, SIZE[0] / 2 + 3), (0, FOCAL, SIZE[1] / 2 - 2), (0, 0, 1))
    cameras = Cameras.from_matrices([K] * N_QUERIES, *SIZE, [LENS] * N_QUERIES)
    start = np.array((EAST + 300, NORTH - 310, 260.0))
    steps = np.outer(np.arange(N_QUERIES), (15.0, 11.0, 9.0))
    poses = _looking_down(20, 0, start + steps)
    # GPS and gimbal are a few metres and degrees off.
    priors = _looking_down(22, 3, poses.centres + np.array((3.0, -2.0, 4.0)))
    photos = photo_table(SCENE, images, cameras, poses, priors, 100.0)
    return SceneInputs(SCENE, photos, PLACE_CRS, open_info(dom), dsm, 100.0)


def _looking_down(tilt: float, turn: float, centres: np.ndarray[Any, Any]) -> Poses:
    rotation = [looking_down(tilt + 2 * q, 63 * q + turn) for q in range(N_QUERIES)]
    return Poses(rotation=np.concatenate(rotation), centres=centres)


def make_world(folder: Path, protocol: MatchingProtocol | None = None) -> World:
    """Prepare the benchmark folder, and match queries to the map without any error."""
    chosen, root = protocol or made_matching_protocol(), folder / "data"
    inputs = made_inputs(folder / "sources")
    truth = build_truth(inputs, chosen.crop, chosen.prior)
    write_queries(root / SCENE / "scenes" / SCENE, inputs.photos)
    write_truth(root / SCENE / "scenes" / SCENE, truth)
    (root / SCENE / "protocols").mkdir()
    values = chosen.model_dump(mode="json", by_alias=True, exclude_none=True)
    (root / SCENE / "protocols" / f"{chosen.name}.toml").write_text(tomli_w.dumps(values))
    files = {"images": str(inputs.dsm.parent / "photos"), "dom": str(inputs.dom.path)}
    files |= {"dsm": str(inputs.dsm), "dsm_sha256": sha256_of(inputs.dsm), "crs": inputs.crs}
    numbers = {"plane_height_m": inputs.plane_height_m, "truth_accuracy_m": 0.4}
    entry = SceneFile(id=SCENE, title="Hills", **numbers, **files)
    named: dict[str, Any] = {"schema": 1, "name": SCENE, "version": 1, "title": "Hills"}
    tracks = {"matching": chosen.truth_settings()}
    file = BenchmarkFile(**named, tracks=tracks, scenes=(entry,), checksums={})
    write_benchmark_file(root / SCENE, file)
    with rasterio.open(inputs.dsm) as dataset:
        heights = dataset.read(1)
    matched = [_exact_matches(truth, row, heights) for row in range(len(truth.queries))]
    query_xy, map_xy, points = (list(part) for part in zip(*matched, strict=True))
    return World(root, chosen, truth, query_xy, map_xy, points)


def lifted(map_xy: np.ndarray[Any, Any], heights: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Lift map pixels by SciPy's interpolation instead of the suite's."""
    east, north = EAST + MAP_GSD * map_xy[:, 0], NORTH - MAP_GSD * map_xy[:, 1]
    column = (east - EAST - DSM_OFFSET) / DSM_GSD - 0.5
    row = (NORTH - DSM_OFFSET - north) / DSM_GSD - 0.5
    height = map_coordinates(heights.astype(np.float64), [row, column], order=1)
    return np.stack([east, north, height], axis=1)


def evaluated(world: World, folder: Path, fields: dict[str, Any]) -> Evaluation:
    path = world.write(folder / "method.npz", fields)
    return evaluate(path, track="matching", data=world.root, run=Run(keep=True))


def matched(world: World, folder: Path, fields: dict[str, Any] | Path) -> SceneAnswers:
    """Return predictions assigned to the world's queries and checked; fields, or a file."""
    path = fields if isinstance(fields, Path) else world.write(folder / "preds.npz", fields)
    found = TRACK.assign(TRACK.open(path, 1 << 30), [world.truth], world.protocol)
    for error in found.errors:
        raise error
    [part] = found.parts
    return part


def refused(world: World, folder: Path, fields: dict[str, Any] | Path) -> str:
    with pytest.raises(PredictionError) as caught:
        matched(world, folder, fields)
    return str(caught.value)


def noisy(world: World, order: list[int]) -> dict[str, Any]:
    """Return matches with noise and outliers, the queries in some order."""
    query_xy = []
    for query in order:
        random, xy = np.random.default_rng(query), world.query_xy[query]
        moved = xy + random.normal(0, 1.0, xy.shape)
        moved[:20] = random.random((20, 2)) * SIZE
        query_xy.append(np.clip(moved, 0, SIZE))
    fields = world.correspondences(query_xy, map_xy=[world.map_xy[q] for q in order])
    return fields | {"query_ids": np.array(world.ids)[order]}


def _exact_matches(truth: MatchingTruth, row: int, heights: np.ndarray[Any, Any]) -> Any:
    x, y, width, height = truth.crops[row]
    random = np.random.default_rng(row)
    map_xy = (x, y) + random.random((4000, 2)) * (width, height)
    points = lifted(map_xy, heights)
    seen = world_to_camera(truth.poses.take(row), points[None])
    pixels = project(truth.cameras.take(row), seen)[0]
    chosen = np.flatnonzero(((pixels > 0) & (pixels < SIZE)).all(axis=1))[:N_MATCHES]
    return pixels[chosen], map_xy[chosen], points[chosen]


# --- 2D-3D matches with known poses ---

SOLVER = Solver(
    name="colmap",
    max_error_px=5.0,
    min_inlier_ratio=0.01,
    min_trials=1000,
    max_trials=100_000,
    confidence=0.9999,
    seed=0,
    least_matches=4,
    max_matches=20_000,
    max_trials_times_matches=500_000_000,
)
PROJECTED = (400_000.0, 3_130_000.0, 60.0)


class Problem(NamedTuple):
    """One query: its camera (Cameras of one), query_xy (M, 2) and points (M, 3)."""

    camera: Cameras
    query_xy: np.ndarray
    points: np.ndarray


class Scene(NamedTuple):
    problem: Problem
    rotation: np.ndarray
    centre: np.ndarray
    wrong: np.ndarray


def make_scene(
    seed: int,
    *,
    count: int = 400,
    lens: tuple[float, ...] = (0.0,) * 5,
    noise_px: float = 0.0,
    outliers: float = 0.0,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Scene:
    """An oblique photo of 25 m hills from 140 m above; outliers are anywhere in the image."""
    rng = np.random.default_rng([seed, count])
    K = np.array([[[2900.0, 0.0, 2010.0], [0.0, 2930.0, 1480.0], [0.0, 0.0, 1.0]]])
    camera = Cameras.from_matrices(K, 4000, 3000, [lens])
    rotation = looking_down(rng.uniform(5.0, 35.0), rng.uniform(0.0, 360.0))
    poses = Poses.from_centres(rotation, rng.normal((0.0, 0.0, 140.0), 5.0)[None])
    points = rng.uniform((-300.0, -300.0, 0.0), (300.0, 300.0, 25.0), (60 * count, 3))
    xy = project(camera, world_to_camera(poses, points[None]))[0]
    seen = np.flatnonzero(((xy > 0.0) & (xy < (4000.0, 3000.0))).all(axis=1))[:count]
    query_xy, points = xy[seen] + rng.normal(0.0, noise_px, (len(seen), 2)), points[seen]
    wrong = rng.permutation(count) < round(outliers * count)
    query_xy[wrong] = rng.random((wrong.sum(), 2)) * (4000.0, 3000.0)
    problem = Problem(camera, query_xy, points + origin)
    return Scene(problem, rotation[0], poses.centres[0] + origin, wrong)


def errors(estimate: PoseEstimate, scene: Scene) -> tuple[float, float]:
    """Metres and degrees between an estimate and the truth."""
    metres = float(np.linalg.norm(estimate.centre - scene.centre))
    return metres, float(rotation_angle_deg(estimate.rotation, scene.rotation))


def joined(problems: Sequence[Problem]) -> tuple[Cameras, Correspondences]:
    """Put queries one after the other."""
    cameras = [
        np.concatenate(values)
        for values in zip(*(vars(p.camera).values() for p in problems), strict=True)
    ]
    offsets = np.cumsum([0, *(len(problem.points) for problem in problems)])
    query_xy, points = (np.concatenate([p[part] for p in problems]) for part in (1, 2))
    return Cameras(*cameras), Correspondences(offsets, query_xy, points3d=points)
