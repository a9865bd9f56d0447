"""AirZoo-Mini as a benchmark: its worlds, maps and truth, and that exact input is perfect."""

from __future__ import annotations

import hashlib
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.metadata import noisy_priors
from airzoo_bench.datasets.mini.build import build_world
from airzoo_bench.datasets.mini.dataset import mini_photos, mini_protocols, seed_or_key
from airzoo_bench.datasets.mini.renderer import Raycaster, Renderer
from airzoo_bench.datasets.mini.shading import TIMES, WEATHERS
from airzoo_bench.datasets.mini.world import REGIONS, SURVEY_SUN, World
from airzoo_bench.datasets.settings import MiniOptions
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses, angles_to_rotations, depth_to_points
from airzoo_bench.geometry.rasters import world_to_pixel
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.retrieval.truth import read_truth as read_retrieval
from tests.datasets.mini.conftest import CAMERA, Prepared
from tests.datasets.support import hold_crops, hold_tiles
from tests.processor_truths import fingerprints
from tests.support import run_main

slow = pytest.mark.slow
EACH = pytest.mark.parametrize("region", sorted(REGIONS))
PHOTOS = Path(__file__).with_name("photos.png")
BYTES = {"city": "973ef2cb90fbe227", "rural": "16fdc6a42e2e5260"}
TRUTHS = {
    **{"city retrieval": "41580b87fce5", "rural retrieval": "02346c8a0363"},
    **{"city matching": "22bd551d6457", "rural matching": "54776295dbf3"},
    **{"city reconstruction": "dc6f7d5c2bb7", "rural reconstruction": "88b277010868"},
}


@cache
def built(region: str) -> World:
    return build_world(region, 0)


@EACH
def test_a_world_is_the_same_on_every_machine(region: str) -> None:
    found = hashlib.sha256()
    for _, array in sorted(built(region).arrays.items()):
        found.update(np.ascontiguousarray(array).tobytes())
    assert found.hexdigest()[:16] == BYTES[region]


def photos_of_city() -> Floats:
    """Return photos of two places in all conditions, side by side, a fourth as wide and high."""
    renderer, city = Renderer(built("city")), REGIONS["city"]
    turns = angles_to_rotations([20.0, 100.0], [-25.0, -30.0], 0.0, convergence_deg=0.0)
    places = np.array([[300.0, 240.0, 90.0], [150.0, 420.0, 95.0]])
    views = Poses.from_centres(turns, places + np.array([city.west, city.south, 0.0]))
    shots = [
        renderer.render(CAMERA, views.take(view), weather, time, 1)[0]
        for view, weather, time in product(range(2), WEATHERS, TIMES)
    ]
    small = np.reshape(shots, (6, 5, 30, 4, 40, 4, 3)).mean(axis=(3, 5))
    return np.asarray(small.transpose(0, 2, 1, 3, 4).reshape(180, 200, 3))


def test_photos_look_the_same_in_every_condition() -> None:
    with Image.open(PHOTOS) as known:
        away = np.abs(photos_of_city() - np.asarray(known, np.float64))
    assert away.mean() < 0.3  # 0.25 by rounding to whole levels
    assert (away > 1.0).mean() < 1e-4


@slow
def test_truth_is_the_same_on_every_machine(mini: Prepared) -> None:
    for name, fingerprint in fingerprints(mini.root / "airzoo-mini").items():
        assert fingerprint.startswith(TRUTHS[name]), name


@slow
@EACH
def test_dsm_is_the_highest_surface_that_a_vertical_ray_meets(mini: Prepared, region: str) -> None:
    world = mini.world(region)
    caster = Raycaster(world.mesh)
    rows, columns = np.divmod(np.arange(0, 1200 * 1200, 37), 1200)
    x, y = (columns + 0.5) * 0.5, 600.0 - (rows + 0.5) * 0.5

    def height(off: float) -> Floats:
        origins = np.stack([x + off, y + off, np.full(len(x), 200.0)])
        return 200.0 - caster.trace(origins, np.array([[0.0], [0.0], [-1.0]]) + 0.0 * origins)[1]

    # Where a ray beside it meets quite another height, the pixel is at a vertical edge.
    met = height(0.0)
    level = (np.abs([height(-0.01) - met, height(0.01) - met]) <= 0.15).all(axis=0)
    assert level.mean() > 0.97
    assert np.abs(world.dsm[rows, columns] - met)[level].max() < 1e-4


@slow
@EACH
def test_maps_show_the_same_place_in_their_light(mini: Prepared, region: str) -> None:
    world = mini.world(region)
    # No channel is brighter than the albedo in the whole sun, none darker than in the sky alone.
    albedo, sky = world.top[..., :3].astype(float), np.array(SURVEY_SUN.sky)
    assert (world.dom <= np.minimum(albedo * (sky + SURVEY_SUN.sun) + 0.51, 255)).all()
    assert (world.dom >= np.floor(np.minimum(albedo * sky, 255))).all()
    grey = world.dom.mean(axis=2).reshape(200, 12, 200, 12).mean(axis=(1, 3))
    older = world.satellite.mean(axis=2).reshape(200, 10, 200, 10).mean(axis=(1, 3))
    assert 0.35 < np.corrcoef(grey.ravel(), older.ravel())[0, 1] < 0.95
    assert np.corrcoef(np.roll(grey, 30, axis=1).ravel(), older.ravel())[0, 1] < 0.3


@slow
@EACH
def test_every_track_has_truth_and_every_condition_is_there(mini: Prepared, region: str) -> None:
    home = mini.root / "airzoo-mini" / "scenes" / region
    (scene,) = (one for one in load_benchmark(mini.root / "airzoo-mini").scenes if one.id == region)
    hold_tiles(home, scene)
    hold_crops(home, scene)
    photos = pd.read_csv(home / "queries.csv")
    roll = photos[photos["sequence"] == "roll"]
    assert roll.groupby(["weather", "time_of_day"]).size().tolist() == [2] * 15
    assert (roll["pitch_deg"].min(), roll["pitch_deg"].max()) == pytest.approx((10, 90), abs=10)
    surveyed = photos.loc[photos["sequence"] == "survey", "id"].tolist()
    assert read_reconstruction(mini.benchmark, region).photos["id"].tolist() == surveyed
    truth = read_matching(mini.benchmark, region)
    assert min(len(read_retrieval(home, region).queries), len(truth.queries)) >= 50
    away = np.linalg.norm(truth.priors.centres - truth.poses.centres, axis=1)
    assert 2 < np.median(away) < 6


@slow
def test_exact_matches_are_perfect(mini: Prepared, tmp_path: Path) -> None:
    """Depth, poses, cameras, maps and surface models of the benchmark agree."""
    ids, pairs = [], []
    for scene in REGIONS:
        truth = read_matching(mini.benchmark, scene)
        surface, dom = HeightField.read(truth.maps[0].dsm), truth.maps[0].dom
        for row, query in truth.queries.iterrows():
            depth = mini.depth(scene, query["image"])
            grid = np.zeros(depth.shape, dtype=bool)
            grid[11::24, 11::24] = True
            grid &= (depth > 0) & (depth < 350)
            points = depth_to_points(depth, grid, truth.cameras.take(row), truth.poses.take(row))
            there = world_to_pixel(dom.transform, points[:, :2])
            # What lies under a roof's edge or a tree is not what the surface model shows there.
            fit = np.abs(surface.sample(points[:, :2]) - points[:, 2]) < 0.05
            fit &= ((there >= 0) & (there <= dom.width)).all(axis=1)
            ids.append(query["id"])
            pairs.append(np.column_stack([np.argwhere(grid)[:, ::-1] + 0.5, there])[fit])
    offsets, every = np.cumsum([0, *map(len, pairs)]), np.concatenate(pairs)
    split = {"query_xy": every[:, :2], "map_xy": every[:, 2:]}
    path = tmp_path / "matches.npz"
    np.savez(path, protocol="airzoo-mini-matching", query_ids=ids, offsets=offsets, **split)
    overall = evaluate(path, data=mini.root, run=Run(jobs=2)).result.overall
    assert overall["within_1m"] == overall["within_1m_1deg"] == 1.0
    assert overall["error_m"] < 0.05


@slow
def test_commands(mini: Prepared, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(mini.root))
    name = "airzoo_bench.datasets.geometry_checks.key_frames"
    monkeypatch.setattr(name, lambda flown, *rest: np.arange(0, len(flown), len(flown) // 2)[:2])
    words = ("mini", "render", "--region", "rural", "--flight", "survey", "--weather", "foggy")
    assert run_main(*words, "--out", str(tmp_path)) == 0
    frames = pd.read_csv(tmp_path / "frames.csv")
    assert frames["weather"].tolist() == ["foggy"] * 2
    found = {path.stem for path in (tmp_path / "images").iterdir()}
    assert found == {f"{frame:06d}" for frame in frames["name"]}
    assert run_main(*words[:-1], "hail", "--out", str(tmp_path)) == 2
    monkeypatch.chdir(Path(__file__).parents[3])
    assert run_main("submission", "check", "submissions/airzoo-mini/matching/sift") == 0


def test_priors_are_off_as_a_drones_metadata() -> None:
    spread, names = np.linspace(0, 1, 4000), [f"photo_{row}" for row in range(4000)]
    rotations = angles_to_rotations(360 * spread, -45 - 30 * spread, 0.0, convergence_deg=0.0)
    poses = Poses.from_centres(rotations, np.outer(spread, np.ones(3)))
    offsets = noisy_priors(names, poses, 0).centres - poses.centres
    np.testing.assert_allclose(offsets.std(axis=0), [2.0, 2.0, 3.0], rtol=0.05)
    np.testing.assert_allclose(offsets.mean(axis=0), 0, atol=0.2)
    # Normal enough: as many beyond two deviations as there should be.
    assert (np.abs(offsets / [2.0, 2.0, 3.0]) > 2).mean() == pytest.approx(0.0455, abs=0.01)
    # They belong to the name and the seed, and are the same numbers everywhere.
    one = Poses.from_centres(np.eye(3)[None], np.zeros((1, 3)))
    expected = [1.53424072265625, -0.400146484375, 6.124420166015625]
    assert noisy_priors(["city/0001"], one, 0).centres[0].tolist() == expected


KEY = (1 << 128) + 0x9F86D081884C7D659A2FEAA0C55AD015


@slow
def test_a_sealed_edition_hides_all_that_its_key_does_not_tell() -> None:
    dsm = np.full((1200, 1200), 20.0, np.float32)
    public, sealed, other = (mini_photos(REGIONS["city"], dsm, seed) for seed in (0, KEY, KEY ^ 1))
    assert set(sealed.names).isdisjoint(other.names)
    assert not any("survey" in name or "roll" in name for name in sealed.names)
    # Whoever flies the survey again knows no more than from a prior: each photo has its gust.
    for shown in (public, other):
        off = np.linalg.norm(shown.poses.centres[:20] - sealed.poses.centres[:20], axis=1)
        assert 2.0 < np.median(off) < 8.0


def test_a_key_of_32_digits_is_the_source_and_is_in_no_protocol(tmp_path: Path) -> None:
    path = tmp_path / "mini.key"
    path.write_text(f"{KEY:x}"[1:] + "\n")
    assert seed_or_key(MiniOptions(key_file=path)) == KEY
    for protocol in mini_protocols(KEY).every:
        assert protocol.benchmark == "airzoo-mini-sealed"
        assert f"{KEY:x}"[1:] not in protocol.model_dump_json()
    for seed, text in ((3, "0" * 32), (0, ""), (0, "0" * 31), (0, "g" * 32), (0, "0" * 64)):
        path.write_text(text)
        with pytest.raises(UsageError):
            seed_or_key(MiniOptions(seed, path))
