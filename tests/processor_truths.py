"""Makes truths and prints their fingerprints; run by test_processors as other processors would."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path
from types import MappingProxyType

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.cli.main import app
from airzoo_bench.core.files import DATA_VARIABLE
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.retrieval.truth import read_truth as read_retrieval

_TRACKS = MappingProxyType({"matching": read_matching, "reconstruction": read_reconstruction})


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


def main() -> None:
    home = Path(sys.argv[2])
    home.mkdir(parents=True)
    with contextlib.redirect_stdout(sys.stderr):
        found = {"mini": mini, "photos": photos}[sys.argv[1]](home)
    for name, value in found.items():
        print(name, value)  # noqa: T201


if __name__ == "__main__":
    main()
