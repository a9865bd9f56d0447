"""A made world with exact depth: ground with a box, oblique cameras; clouds and poses at random."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import laspy
import numpy as np
import tomli_w
import trimesh
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.evaluation.evaluate import Evaluation, check, evaluate
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.reconstruction.alignment import PosedCameras, Similarity, shipped_alignment
from airzoo_bench.reconstruction.settings import AlignmentSettings, ReconstructionProtocol
from airzoo_bench.reconstruction.truth import ReconstructionTruth, read_truth
from tests.geometry.support import looking_down
from tests.goldens.run import unpack

Array = np.ndarray[Any, Any]

NAME = "made"
PROTOCOL = f"{NAME}-reconstruction"
ORIGIN = np.array((500_000.0, 5_200_000.0, 100.0))
SIDE = 60.0  # of the square of ground that the true cloud covers
STEP = 0.5
BOX_LOW, BOX_HIGH = np.array((26.0, 24.0, 0.0)), np.array((36.0, 32.0, 6.0))
MAP_SIZE = (48, 36)
FOCAL = 80.0  # of the maps, px


@cache
def _read_world(scene: str) -> tuple[ReconstructionTruth, Array]:
    with TemporaryDirectory() as home:
        truth = read_truth(Benchmark.open(make_world(Path(home)).folder), scene)
        return truth, trimesh.load(truth.cloud).vertices


def made_truth(scene: str) -> ReconstructionTruth:
    """Return the truth of a scene, whose cloud is not there: see `true_points`."""
    return _read_world(scene)[0]


def true_points(scene: str) -> Array:
    """The true cloud: ground and a box, its top and walls, in the yard; ground only in the lot."""
    return np.array(_read_world(scene)[1])


def camera_poses(scene: str) -> Poses:
    """Cameras above the middle that look down and to all sides, none like another."""
    return made_truth(scene).poses


def extrinsics_of(rotation: Array, centres: Array) -> Array:
    return np.concatenate([rotation, -(rotation @ centres[..., None])], axis=2)


def matrix_of_maps() -> Array:
    width, height = MAP_SIZE
    return np.array([[FOCAL, 0, width / 2], [0, FOCAL, height / 2], [0, 0, 1.0]])


def exact_depth(poses: Poses, boxed: bool) -> Array:
    """Depth (N, H, W) of ground and box by ray and plane: no code of the suite."""
    width, height = MAP_SIZE
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([(u - width / 2) / FOCAL, (v - height / 2) / FOCAL, np.ones_like(u)], axis=-1)
    maps = []
    for rotation, centre in zip(poses.rotation, poses.centres - ORIGIN, strict=True):
        d = rays @ rotation  # R^T r, row by row; its z in the camera is 1, so that t is depth
        with np.errstate(divide="ignore"):
            t = np.where(d[..., 2] < 0, -centre[2] / d[..., 2], np.inf)
            near, far = ((side - centre) / d for side in (BOX_LOW, BOX_HIGH))
        first = np.minimum(near, far).max(axis=-1)
        last = np.maximum(near, far).min(axis=-1)
        hit = (first < last) & (first > 0)
        maps.append(np.where(hit & boxed, np.minimum(first, t), t))
    return np.where(np.isfinite(maps), maps, 0.0)


def protocol(**sections: Any) -> ReconstructionProtocol:
    """Return the shipped protocol for own photos with the made scenes, some keys changed."""
    values = load_protocol(shipped_protocols()["photos-reconstruction"]).model_dump(by_alias=True)
    values |= {"name": PROTOCOL, "benchmark": NAME, "title": "Made"}
    values["scenes"] = ({"id": "yard", "title": "Yard"}, {"id": "lot", "title": "Lot"})
    # Distances as they are, unless a test asks for what the shipped protocol does to the clouds.
    plain: dict[str, Any] = {
        "preparation": {"crop": "none", "region": "all", "voxel_m": "none"},
        "scores": {"f1_below_m": (0.2, 0.5, 1.0, 10.0), "max_distance_m": "none"},
    }
    for changes in (plain, sections):
        for section, keys in changes.items():
            values[section] = values[section] | keys
    return ReconstructionProtocol.model_validate(values)


@dataclass(frozen=True)
class World:
    """A benchmark folder `root / NAME`, and perfect predictions of its scenes."""

    root: Path

    @property
    def folder(self) -> Path:
        return self.root / NAME

    def images(self, scene: str) -> list[str]:
        return made_truth(scene).photos["image"].tolist()

    def cameras(self, scene: str) -> dict[str, Any]:
        """Return the fields of a file of true cameras."""
        poses, names = camera_poses(scene), np.array(self.images(scene))
        return {"image_names": names, "extrinsics": extrinsics_of(poses.rotation, poses.centres)}

    def views(self, scene: str) -> dict[str, Any]:
        """Return the fields of a file of exact depth maps."""
        poses = camera_poses(scene)
        return {
            "depth": exact_depth(poses, boxed=scene == "yard"),
            "pixel_centres": np.array("half"),
            "intrinsics": np.tile(matrix_of_maps(), (len(poses), 1, 1)),
            **self.cameras(scene),
        }

    def protocol(self, path: Path, **sections: Any) -> Path:
        """Write a protocol file with some keys changed."""
        values = protocol(**sections).model_dump(mode="json", by_alias=True, exclude_none=True)
        path.write_text(tomli_w.dumps(values))
        return path

    def record(self, scene: str, predictions: Path, **options: Any) -> dict[str, Any]:
        """Return a scene's record of an evaluation."""
        scored = self.score(predictions, **options).scored[scene]
        record: dict[str, Any] = scored.records.iloc[0].to_dict()
        return record

    def score(self, predictions: Path, **options: Any) -> Evaluation:
        given = {"data": self.root, "protocol": PROTOCOL} | options
        return evaluate(predictions, track="reconstruction", **given)


def make_world(root: Path) -> World:
    """Unpack the benchmark folder of the goldens."""
    with TemporaryDirectory() as home:
        unpack("canonical-reconstruction", Path(home))
        shutil.copytree(Path(home) / "data", root, dirs_exist_ok=True)
    return World(root)


def save(path: Path, fields: dict[str, Any]) -> Path:
    """Write an npz, with the folder that it lies in."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **fields)
    return path


def predict_clouds(
    world: World, folder: Path, clouds: dict[str, Array], cameras: bool = True
) -> Path:
    """Write predictions of clouds with true cameras."""
    shutil.rmtree(folder, ignore_errors=True)
    for scene, points in clouds.items():
        write_ply(folder / f"{scene}.ply", Cloud(np.asarray(points, np.float64)))
        if cameras:
            save(folder / f"{scene}.cameras.npz", world.cameras(scene))
    (folder / "protocol.txt").write_text(PROTOCOL + "\n")
    return folder


def notes_of(world: World, path: Path, protocol: str = PROTOCOL) -> list[str]:
    """Return the notes of an evaluation, which are those of a check."""
    notes = list(world.score(path, protocol=protocol).result.notes)
    checked = check(path, data=world.root, protocol=protocol)
    assert not checked.errors
    assert sorted(checked.notes) == sorted(notes)
    return notes


# --- clouds, cameras and similarities, made at random ---

UTM = np.array((576663.25, 5188165.5, 197.0))


def all_pairs(points: Floats, others: Floats) -> Floats:
    """Distances to nearest neighbours by trying all pairs, in float64."""
    found = np.empty(len(points))
    for start in range(0, len(points), 512):
        x, y, z = np.moveaxis(points[start : start + 512, None] - others, -1, 0)
        found[start : start + 512] = np.sqrt(((x * x + y * y) + z * z).min(axis=1, initial=np.inf))
    return found


def surface(count: int, seed: int, *, far: float = 0.0) -> Floats:
    """Hills of 100 m, and a share of points up to ten times as far outside."""
    random = np.random.default_rng(seed)
    points = random.uniform(0.0, 100.0, (count, 3))
    points[:, 2] = 5.0 * np.sin(points[:, 0] / 9.0) + random.normal(0.0, 0.05, count)
    outside = random.random(count) < far
    points[outside] = random.uniform(-1000.0, 1000.0, (np.count_nonzero(outside), 3))
    return points


_SHAPES = (
    lambda random, n: random.normal(size=(n, 3)),
    lambda random, n: random.integers(0, 4, (n, 3)) * 0.1,  # many ties, all but for roundings
    lambda random, n: random.integers(0, 4, (n, 3)) * 0.1 + 0.05,  # middles of their cells
    lambda random, n: np.full((n, 3), 0.1),
    lambda random, n: random.random((n, 1)) * np.array((1.0, 2.0, -3.0)),  # a line
    lambda random, n: random.random((n, 3)) * np.array((1e6, 1.0, 1e-6)),
    lambda random, n: random.random((n, 3)) + np.array((5e5, 4.4e6, 100.0)),
    lambda random, n: random.random((n, 3)) * 10.0 ** random.integers(-9, 10, (n, 1)),
    lambda random, n: sphere(random, n),
)


def sphere(random: np.random.Generator, count: int) -> Floats:
    points = random.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@st.composite
def clouds(draw: st.DrawFn, most: int = 120) -> Floats:
    """Clouds of many shapes, degenerate ones among them, one to `most` points."""
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    parts = [
        draw(st.sampled_from(_SHAPES))(random, draw(st.integers(1, max(1, most // 2))))
        for _ in range(draw(st.integers(1, 2)))
    ]
    return random.permutation(np.concatenate(parts))


def write_laz(path: Path, points: Floats) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-3), np.floor([*points, np.zeros(3)][0])
    cloud = laspy.LasData(header)
    cloud.xyz = points
    cloud.write(path)


def poses(rng: np.random.Generator, count: int, spread: float = 50.0) -> Poses:
    rotation = Rotation.random(count, random_state=rng).as_matrix()
    return Poses(rotation=rotation, centres=rng.normal(size=(count, 3)) * spread)


def shaken(truth: Poses, rng: np.random.Generator, degrees: float, metres: float) -> Poses:
    count = len(truth)
    turn = Rotation.from_rotvec(rng.normal(0, degrees, (count, 3)), degrees=True).as_matrix()
    centres = truth.centres + rng.normal(0, metres, (count, 3))
    return Poses(rotation=turn @ truth.rotation, centres=centres)


def cameras(centres: np.ndarray, rng: np.random.Generator) -> PosedCameras:
    """Cameras that look down, at these places about a point of a projected CRS."""
    names = tuple(f"{row:03}.jpg" for row in range(len(centres)))
    shake = Rotation.from_euler("xyz", rng.normal(0, 10, (len(centres), 3)), degrees=True)
    return PosedCameras(names, centres + UTM, shake.as_matrix() @ looking_down(20.0))


def similarity(rng: np.random.Generator, scale: float = 25.0) -> Similarity:
    rotation = Rotation.random(random_state=rng).as_matrix()
    return Similarity(scale, rotation, UTM + rng.normal(0, 50, 3), rng.normal(size=3))


def seen_from(truth: PosedCameras, made: Similarity) -> PosedCameras:
    """Return the cameras in the frame that `made` takes into the truth's."""
    assert truth.rotation is not None
    centres = made.inverse().apply(truth.centres)
    return PosedCameras(truth.names, centres, truth.rotation @ made.rotation)


def moved(cameras: PosedCameras, rows: list[int], by: Any) -> PosedCameras:
    centres = cameras.centres.copy()
    centres[rows] += by
    return replace(cameras, centres=centres)


def ransac(**changes: Any) -> AlignmentSettings:
    """Return settings of few trials, some of them changed."""
    few = {"min_trials": 50, "max_trials": 5000, "inlier_below_m": 1.0, "line_ratio": 0.02}
    return shipped_alignment(**(few | changes))
