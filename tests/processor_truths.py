"""Makes truths and prints their fingerprints; run by test_processors as other processors would."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.cli.main import app
from airzoo_bench.core.files import DATA_VARIABLE
from airzoo_bench.datasets.mini import dataset as airzoo_mini
from airzoo_bench.datasets.mini.dataset import mini_photos
from airzoo_bench.datasets.mini.world import REGIONS, Region, write_raster
from airzoo_bench.datasets.truths import build_truths
from airzoo_bench.geometry.poses import depth_to_points
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.retrieval.truth import read_truth as read_retrieval

_TRACKS = MappingProxyType({"matching": read_matching, "reconstruction": read_reconstruction})


def heights(region: Region) -> np.ndarray:
    """Return a surface model of blocks, one metre a pixel, from whole numbers."""
    side = int(region.side_m)
    row, column = np.mgrid[:side, :side] // 37
    return (50 + (row * 7 + column * 13) % 23).astype(np.float32)


def flights(home: Path) -> dict[str, str]:
    """Both flights over a region, on a made-up surface: poses, priors, truth of two tracks."""
    found = {}
    protocols = airzoo_mini.mini_protocols(0)
    for name, region in list(REGIONS.items())[:1]:
        dsm = heights(region)
        files = {key: home / f"{name}-{key}.tif" for key in ("dom", "dsm", "gallery")}
        write_raster(files["dsm"], dsm, region)
        for key in ("dom", "gallery"):
            write_raster(files[key], np.repeat(dsm[..., None], 3, axis=2).astype(np.uint8), region)
        photos = mini_photos(region, dsm, 0)
        inputs = airzoo_mini.scene_inputs(region, photos, files, 0)
        own = protocols.first(RetrievalProtocol)
        assert own is not None
        gallery = own.gallery.model_copy(update={"gsd_m": "any"})
        retrieval = own.model_copy(update={"gallery": gallery})
        every = (retrieval, *(one for one in protocols.every if one.track != "retrieval"))
        truths = build_truths(inputs, replace(protocols, every=every))
        truth, crops = truths.retrieval, truths.matching
        depth = np.tile(np.arange(100.0, 164.0), (48, 1))
        camera, poses = photos.camera, photos.poses
        points = [depth_to_points(depth, depth > 0, camera, poses.take(n)) for n in range(8)]
        found[f"{name} photos"] = digest(inputs.photos.to_csv(index=False).encode())
        found[f"{name} retrieval"] = truth.fingerprint
        found[f"{name} matching"] = crops.fingerprint
        found[f"{name} points"] = digest(np.concatenate(points).tobytes())
    return found


def mini(home: Path) -> dict[str, str]:
    """AirZoo-Mini, worlds and photos and all."""
    os.environ[DATA_VARIABLE] = str(home)
    app(["prepare", "airzoo-mini"], standalone_mode=False)
    return fingerprints(home / "airzoo-mini")


def photos(home: Path) -> dict[str, str]:
    """Photos of a real scene."""
    scene, folder = Path(sys.argv[3]), home / "park"
    sources = {"images": "images", "poses": "poses.json", "cloud": "model.laz"}
    sources |= {kind: f"{kind}_10cm.tif" for kind in ("dom", "dsm")}
    given = [word for key, name in sources.items() for word in (f"--{key}", str(scene / name))]
    tiles = ["--tile-size", "256", "--tile-size", "128"]
    command = ["prepare", "photos", "--name", "park", *given, *tiles, "--out", str(folder)]
    app(command, standalone_mode=False)
    return fingerprints(folder)


def fingerprints(folder: Path) -> dict[str, str]:
    benchmark = Benchmark.open(folder)
    found = {}
    for scene in (entry.id for entry in benchmark.file.scenes):
        tiles = read_retrieval(benchmark.scene_folder(scene), scene)
        found[f"{scene} retrieval"] = tiles.fingerprint
        for track, read in _TRACKS.items():
            found[f"{scene} {track}"] = read(benchmark, scene).fingerprint
    return found


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def main() -> None:
    home = Path(sys.argv[2])
    home.mkdir(parents=True)
    with contextlib.redirect_stdout(sys.stderr):
        found = {"flights": flights, "mini": mini, "photos": photos}[sys.argv[1]](home)
    for name, value in found.items():
        print(name, value)  # noqa: T201


if __name__ == "__main__":
    main()
