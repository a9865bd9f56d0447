"""Exact matches of a made world: hills, a coarse map, oblique cameras; 2D-3D matches by seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import rasterio
import tomli_w
from scipy.ndimage import map_coordinates

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.evaluation.evaluate import Evaluation, evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg, world_to_camera
from airzoo_bench.matching.predictions import Correspondences
from airzoo_bench.matching.protocol import MatchingProtocol
from airzoo_bench.matching.solving import PoseEstimate
from airzoo_bench.matching.track import TRACK, SceneAnswers
from airzoo_bench.matching.truth import MatchingTruth, read_truth
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from tests.geometry.support import looking_down
from tests.goldens.recipes import spoil
from tests.goldens.run import unpack

SCENE = "hills"
N_QUERIES = 5
N_MATCHES = 60
SIZE = (640, 480)


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


def make_world(folder: Path) -> World:
    """Unpack the world of the readers' goldens, and match queries to the map without any error."""
    unpack("readers-matching", folder)
    home = folder / "data" / SCENE
    spoil(home, r"benchmark.toml: sed plane_height_m => truth_accuracy_m = 0.4\nplane_height_m")
    truth = read_truth(Benchmark.open(home), SCENE)
    found = [_exact_matches(truth, row, folder / "sources/dsm.tif") for row in range(N_QUERIES)]
    matches = (list(part) for part in zip(*found, strict=True))
    rules = load_protocol(home / "protocols" / f"{SCENE}-matching.toml")
    return World(folder / "data", cast(MatchingProtocol, rules), truth, *matches)


def evaluated(
    world: World, folder: Path, fields: dict[str, Any], **sections: dict[str, Any]
) -> Evaluation:
    """Evaluate predictions by the world's protocol with some keys of sections changed."""
    path, rules = world.write(folder / "method.npz", fields), folder / "rules.toml"
    values = world.protocol.model_dump(mode="json", by_alias=True, exclude_none=True)
    values |= {section: values[section] | keys for section, keys in sections.items()}
    rules.write_text(tomli_w.dumps(values))
    run = Run(keep=True)
    return evaluate(path, track="matching", data=world.root, protocol=str(rules), run=run)


def matched(world: World, folder: Path, fields: dict[str, Any] | Path) -> SceneAnswers:
    """Return predictions assigned to the world's queries and checked; fields, or a file."""
    path = fields if isinstance(fields, Path) else world.write(folder / "preds.npz", fields)
    found = TRACK.assign(TRACK.open(path, 1 << 30), [world.truth], world.protocol)
    for error in found.errors:
        raise error
    [part] = found.parts
    return part


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


def _exact_matches(truth: MatchingTruth, row: int, dsm: Path) -> Any:
    """Return pixels and points of map pixels lifted by SciPy's interpolation, not the suite's."""
    x, y, width, height = truth.crops[row]
    map_xy = (x, y) + np.random.default_rng(row).random((4000, 2)) * (width, height)
    places = truth.maps[0].dom.transform @ tuple(map_xy.T)
    with rasterio.open(dsm) as surface:
        column_row = np.array(~surface.transform @ places) - 0.5
        heights = surface.read(1).astype(np.float64)
    points = np.stack([*places, map_coordinates(heights, column_row[::-1], order=1)], axis=1)
    seen = world_to_camera(truth.poses.take(row), points[None])
    pixels = project(truth.cameras.take(row), seen)[0]
    chosen = np.flatnonzero(((pixels > 0) & (pixels < SIZE)).all(axis=1))[:N_MATCHES]
    return pixels[chosen], map_xy[chosen], points[chosen]


# --- 2D-3D matches with known poses ---

SOLVER = cast(MatchingProtocol, load_protocol(shipped_protocols()["photos-matching"])).solver
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
