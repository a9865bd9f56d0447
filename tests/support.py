"""Benchmark folders and prediction files made on the spot, for tests of everything above."""

from __future__ import annotations

import atexit
import functools
import json
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
import tomllib
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
import pytest
import tomli_w

from airzoo_bench.benchmark.folder import BenchmarkFile, SceneFile, write_benchmark_file
from airzoo_bench.benchmark.queries import write_queries
from airzoo_bench.core.files import only_writer
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.retrieval.truth import Positives, RetrievalTruth, offsets_of, write_truth

ROOT = Path(__file__).resolve().parents[1]
BRIGHTON = ROOT / ".." / "shared" / "real" / "brighton"
HANGS_S = 300.0
"""Seconds after which a process hangs: what is merely slow ends before, on a busy machine too."""

PAPER = ROOT / ".." / "shared" / "paper"
# Every number of the paper's result tables, as it travels with the package.
PUBLISHED = ROOT / "protocols" / "published" / "airzoo-paper.csv"

TILE_SIZE_DEG = 0.001


@dataclass(frozen=True)
class MadeScene:
    """A scene by its positives: `positives[q]` are the tile numbers that answer query q."""

    id: str
    positives: list[list[int]]
    n_tiles: int
    conditions: dict[str, list[Any]] = field(default_factory=dict)

    def query(self, number: int) -> str:
        return f"{self.id}/q{number:05d}"

    def tile(self, number: int) -> str:
        return f"{self.id}/t{number:05d}"

    @property
    def query_ids(self) -> list[str]:
        return [self.query(q) for q in range(len(self.positives))]

    @property
    def tile_ids(self) -> list[str]:
        return [self.tile(t) for t in range(self.n_tiles)]


def protocol(**changes: Any) -> RetrievalProtocol:
    """Return the shipped protocol of UAV-VisLoc with some top-level values changed."""
    base = load_protocol(shipped_protocols()["uav-visloc-retrieval"])
    return RetrievalProtocol.model_validate(base.model_dump(by_alias=True) | changes)


def made_protocol(scenes: list[MadeScene], name: str = "made") -> RetrievalProtocol:
    """Return a protocol for made scenes."""
    return protocol(
        name=f"{name}-retrieval",
        benchmark=name,
        scenes=tuple({"id": scene.id, "title": f"Scene {scene.id}"} for scene in scenes),
    )


def write_benchmark(folder: Path, chosen: RetrievalProtocol, scenes: list[MadeScene]) -> Path:
    """Write a benchmark folder whose tiles lie in a row along a parallel."""
    values = chosen.model_dump(mode="json", by_alias=True, exclude_none=True)
    made = _made_benchmark(tomli_w.dumps(values), pickle.dumps((chosen, scenes)))
    shutil.copytree(made, folder, dirs_exist_ok=True)
    return folder


@functools.lru_cache(maxsize=32)
def _made_benchmark(protocol_text: str, inputs: bytes) -> Path:
    """Write a benchmark folder once a process, which is copied where a test wants one."""
    chosen, scenes = pickle.loads(inputs)  # noqa: S301 - of this process
    folder = Path(tempfile.mkdtemp(dir=_home_of_made()))
    for scene in scenes:
        truth = made_truth(scene)
        write_queries(folder / "scenes" / scene.id, truth.queries)
        write_truth(folder / "scenes" / scene.id, truth)
    (folder / "protocols").mkdir()
    (folder / "protocols" / f"{chosen.name}.toml").write_text(protocol_text, encoding="utf-8")
    places = {"crs": "EPSG:4547", "plane_height_m": 50.0, "images": "images", "dom": "dom.tif"}
    file = BenchmarkFile(
        schema=1,
        name=chosen.benchmark,
        version=1,
        title=chosen.title,
        tracks={chosen.track: chosen.truth_settings()},
        scenes=tuple(SceneFile(id=one.id, title=one.id, **places) for one in scenes),
        checksums={},
    )
    write_benchmark_file(folder, file)
    return folder


def environment(**more: str) -> dict[str, str]:
    """Return the environment of a command in a process of its own."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    return kept | {"PYTHONPATH": str(Path(__file__).parents[1])} | more


@functools.cache
def _home_of_made() -> str:
    home = tempfile.mkdtemp(prefix="made-benchmarks-")
    atexit.register(shutil.rmtree, home, ignore_errors=True)
    return home


def made_truth(scene: MadeScene) -> RetrievalTruth:
    """Return the truth of a made scene; every footprint's centre is that of tile 0."""
    lon = 113 + np.arange(scene.n_tiles) * TILE_SIZE_DEG
    tiles = pd.DataFrame(
        {
            "id": scene.tile_ids,
            "size_px": 512,
            "x": np.arange(scene.n_tiles) * 256,
            "y": 0,
            "width": 512,
            "height": 512,
            "size_m": 100.0,
            "lon_min": lon,
            "lat_min": 28.0,
            "lon_max": lon + TILE_SIZE_DEG,
            "lat_max": 28.0 + TILE_SIZE_DEG,
            "valid_share": 1.0,
        }
    )
    queries = pd.DataFrame(
        {
            "id": scene.query_ids,
            "image": [one.split("/", 1)[1] + ".jpg" for one in scene.query_ids],
            **scene.conditions,
        }
    )
    footprints = queries[["id"]].assign(
        footprint_lon=113 + TILE_SIZE_DEG / 2, footprint_lat=28 + TILE_SIZE_DEG / 2
    )
    counts = np.array([len(found) for found in scene.positives], dtype=np.int64)
    flat = np.array([t for found in scene.positives for t in sorted(found)], dtype=np.int32)
    excluded = pd.DataFrame({"id": [], "image": [], "reason": []}, dtype=str)
    positives = Positives(offsets_of(counts), flat)
    none = tiles.iloc[:0]
    return RetrievalTruth(
        scene.id, queries, footprints, tiles, positives, excluded, none, overlaps=positives
    )


def write_predictions(path: Path, name: str, **arrays: Any) -> Path:
    """Write a prediction file of the retrieval track."""
    np.savez(path, protocol=np.array(name), **{key: np.array(v) for key, v in arrays.items()})
    return path


@dataclass(frozen=True)
class Place:
    """Sources of `prepare photos`: photos that look straight down on a level plane.

    The map is `MAP_SIZE_M` wide with a pixel a metre, at a height of 100 m; photo i is taken
    100 m above it, sees 100 m x 75 m, and has its centre `centres[i]` metres from the map's
    north-west corner.
    """

    images: Path
    poses: Path
    dom: Path
    dsm: Path
    centres: dict[str, tuple[float, float]]

    @classmethod
    def below(cls, folder: Path, centres: dict[str, tuple[float, float]] | None = None) -> Place:
        """Return the sources that `make_place` wrote into a folder."""
        files = (folder / name for name in ("photos", "poses.json", "dom.tif", "dsm.tif"))
        return cls(*files, dict(PLACE_PHOTOS if centres is None else centres))

    def arguments(self, **changes: object) -> list[str]:
        """Return the arguments of the command, with some changed, or left out where None."""
        options: dict[str, object] = {
            "name": "park",
            "images": self.images,
            "poses": self.poses,
            "dom": self.dom,
            "dsm": self.dsm,
            "tile-size": 64,
        }
        options |= {key.replace("_", "-"): value for key, value in changes.items()}
        given = [(f"--{key}", str(v)) for key, v in options.items() if v is not None]
        return ["prepare", "photos", *(text for pair in given for text in pair)]

    def read_poses(self) -> dict[str, Any]:
        """Return the content of the pose file."""
        return json.loads(self.poses.read_text())

    def change_image(self, name: str, **changes: Any) -> None:
        """Change keys of one image of the pose file."""
        file = self.read_poses()
        file["images"][name] |= changes
        self.poses.write_text(json.dumps(file))


PLACE_CRS = "EPSG:32633"
MAP_SIZE_M = 256
NORTH_WEST = (500_000.0, 5_200_000.0)
PLACE_PHOTOS = {
    "a.jpg": (64.0, 64.0),
    "b.jpg": (192.0, 64.0),
    "c.jpg": (64.0, 192.0),
    "sub/d.jpg": (192.0, 192.0),
}
DOWN = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]


def make_place(folder: Path, photos: dict[str, tuple[float, float]] | None = None) -> Place:
    """Write photos, poses, map and surface model of a made-up place."""
    from PIL import Image

    centres = PLACE_PHOTOS if photos is None else photos
    for number, name in enumerate(centres):
        (folder / "photos" / name).parent.mkdir(parents=True, exist_ok=True)
        pixels = np.random.default_rng(number).integers(0, 256, (48, 64, 3), np.uint8)
        Image.fromarray(pixels).save(folder / "photos" / name)
    poses = {
        "crs": PLACE_CRS,
        "K": [[64.0, 0, 32], [0, 64.0, 24], [0, 0, 1]],
        "images": {
            name: {"R_w2c": DOWN, "center": [NORTH_WEST[0] + x, NORTH_WEST[1] - y, 200.0]}
            for name, (x, y) in centres.items()
        },
    }
    (folder / "poses.json").write_text(json.dumps(poses))
    ground = np.random.default_rng(0).integers(0, 256, (3, MAP_SIZE_M, MAP_SIZE_M), np.uint8)
    write_raster(folder / "dom.tif", ground)
    write_raster(folder / "dsm.tif", np.full((1, MAP_SIZE_M, MAP_SIZE_M), 100, np.float32))
    return Place.below(folder, centres)


def write_raster(
    path: Path,
    bands: np.ndarray[Any, Any],
    *,
    crs: str | None = PLACE_CRS,
    transform: Any = None,
    **more: Any,
) -> Path:
    """Write bands (B, H, W) as GeoTIFF, by default with a pixel a metre from `NORTH_WEST`."""
    import rasterio
    from rasterio import Affine

    count, height, width = bands.shape
    if transform is None:
        transform = Affine(1, 0, NORTH_WEST[0], 0, -1, NORTH_WEST[1])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with rasterio.open(
            path,
            "w",
            driver="GTiff",
            width=width,
            height=height,
            count=count,
            dtype=bands.dtype,
            crs=crs,
            transform=transform,
            **more,
        ) as dataset:
            dataset.write(bands)
    return path


def files_below(folder: Path) -> set[str]:
    """Return the paths of all files and folders, hidden ones too."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def run_main(*arguments: object) -> int:
    """Run the command line as its entry point does, and return the exit code."""
    from airzoo_bench.cli.main import main

    with mock.patch.object(sys, "argv", ["airzoo-bench", *map(str, arguments)]):
        try:
            main()
        except SystemExit as done:
            return int(done.code or 0)
    return 0


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """Return a folder that is made once a session, whichever worker asks first; it is only read.

    The others wait, and the next one makes it where that fails.
    """
    base = factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / f"shared-{name}"
    made = folder.with_name(f"{folder.name}.made")
    with only_writer(folder.with_name(f".{folder.name}.lock"), wait=True):
        if not made.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            make(folder)
            made.touch()
    return folder


# --- packages that add datasets and readers ---


def add_package(example: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a package's source and entry points, as an installed one has them, on the path."""
    project = tomllib.loads((example / "pyproject.toml").read_text())["project"]
    shutil.copytree(example / "src", folder)
    info = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    stated = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (info / "METADATA").write_text(stated)
    lines = []
    for group, points in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {place}" for name, place in points.items())]
    (info / "entry_points.txt").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(folder)


def listed_when_installed(example: Path, home: Path, *command: str) -> str:
    """Install a package, and return what a command prints in a process that sees it."""
    source, target = home / "package", home / "target"
    shutil.copytree(example, source, ignore=shutil.ignore_patterns("*.egg-info", "build", "dist"))
    _run("-m", "pip", "install", "--no-deps", "--quiet", "--target", target, source)
    return _run("-m", "airzoo_bench", *command, path=target)


def _run(*arguments: object, path: Path = ROOT) -> str:
    environment = os.environ | {"PYTHONPATH": f"{path}{os.pathsep}{ROOT}", "COLUMNS": "200"}
    words = [sys.executable, *map(str, arguments)]
    done = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=HANGS_S)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
