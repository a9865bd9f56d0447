"""Rasters at URLs: opened where they lie, and only the windows needed are read."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import rasterio.shutil
from rasterio import Affine

from airzoo_bench.benchmark.folder import Benchmark, write_benchmark_file
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.geometry.raster_files import raster_sha256
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.lifting import lift
from airzoo_bench.storage.mirror import here
from airzoo_bench.storage.urls import in_urls
from tests.matching.world import make_world
from tests.storage.conftest import Bucket, Run
from tests.storage.servers import Apart, serving_apart
from tests.support import NORTH_WEST, PLACE_CRS, write_raster

SIDE, MARGIN = 3072, 1400


@pytest.fixture(scope="module")
def surface(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a cloud-optimised surface model of 26 MB."""
    heights = 100 + 0.01 * np.random.default_rng(0).random((SIDE, SIDE), np.float32)
    path = tmp_path_factory.mktemp("surface") / "dsm.tif"
    corner = Affine(1, 0, NORTH_WEST[0], 0, -1, NORTH_WEST[1])
    return write_optimised(path, heights, corner, PLACE_CRS)


def write_optimised(path: Path, heights: Any, transform: Affine, crs: Any) -> Path:
    """Write a cloud-optimised GeoTIFF."""
    form = {"width": SIDE, "height": SIDE, "count": 1, "dtype": "float32", "crs": crs}
    with rasterio.MemoryFile() as memory:
        with memory.open(driver="GTiff", transform=transform, **form) as one:
            one.write(heights, 1)
        rasterio.shutil.copy(memory.name, path, driver="COG", blocksize=256)
    return path


@pytest.fixture
def web_apart(tmp_path: Path, mirrors: Path) -> Iterator[tuple[Path, Apart]]:
    """Return a folder, and a server that shows it from another process."""
    folder = tmp_path / "www"
    folder.mkdir()
    with serving_apart("files", folder) as front:
        yield folder, front


@pytest.fixture
def apart(
    bucket: Bucket, other_client: None, s3_port: int, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Apart]:
    """Let everything to and from the bucket go through another process."""
    with serving_apart("passed", s3_port) as front:
        monkeypatch.setenv("AWS_ENDPOINT_URL", front.address)
        yield front


def lifted(dsm: Path, jobs: int = 2) -> list[Any]:
    info = open_info(dsm)
    corners = np.array([(1500.0, 1500.0), (1600.0, 400.0), (60.0, 2900.0)])
    patches = corners[:, None] + np.random.default_rng(1).uniform(0, 30, (3, 200, 2))
    return [lift(patch, info, info, jobs=jobs).points for patch in patches]


def test_lifting_reads_windows_of_a_web_server(
    web_apart: tuple[Path, Apart], surface: Path
) -> None:
    folder, front = web_apart
    shutil.copy(surface, folder / "the dsm.tif")
    for one, wanted in zip(
        lifted(here(f"{front.address}/the%20dsm.tif")), lifted(surface), strict=True
    ):
        np.testing.assert_array_equal(one, wanted)
    assert 0 < front.sent("/the dsm.tif") < 0.05 * surface.stat().st_size


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a made benchmark whose surface model goes on for miles, and predictions for it."""
    home = tmp_path_factory.mktemp("world")
    world = make_world(home)
    world.write(home / "mine.npz", world.matches())
    benchmark = Benchmark.open(world.folder)
    (scene,) = benchmark.file.scenes
    (world.folder / "maps").mkdir()
    shutil.copy(scene.dom or "", world.folder / "maps" / "dom.tif")
    dsm = world.folder / "maps" / "dsm.tif"
    with rasterio.open(scene.dsm) as small:
        heights = np.random.default_rng(0).random((SIDE, SIDE), np.float32)
        heights[MARGIN:, MARGIN:][: small.height, : small.width] = small.read(1)
        corner = small.transform @ Affine.translation(-MARGIN, -MARGIN)
        write_optimised(dsm, heights, corner, small.crs)
    changes = {"dom": "maps/dom.tif", "dsm": "maps/dsm.tif", "dsm_sha256": sha256_of(dsm)}
    scenes = (scene.model_copy(update=changes),)
    write_benchmark_file(world.folder, benchmark.file.model_copy(update={"scenes": scenes}))
    return home


def run(command: Run, predictions: object, data: object, out: Path) -> Any:
    return command("eval", "matching", predictions, "--data", data, "--out", out, "--method", "m")


@pytest.mark.slow
def test_matching_from_a_bucket(
    command: Run, bucket: Bucket, apart: Apart, prepared: Path, tmp_path: Path
) -> None:
    bucket.upload(prepared / "data", "data")
    assert run(command, prepared / "mine.npz", prepared / "data", tmp_path / "a").exit_code == 0
    for _ in range(2):
        done = run(command, prepared / "mine.npz", bucket.url("data"), tmp_path / "b")
        assert done.exit_code == 0, done.exception
        for name in ("records.csv", "result.json"):
            assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
        (dsm,) = prepared.glob("data/*/maps/dsm.tif")
        read = apart.sent(f"/{bucket.name}/data/{dsm.relative_to(prepared / 'data')}")
        size = dsm.stat().st_size
        assert size <= read < size * 1.1  # it is read through once, for its checksum


@pytest.mark.slow
def test_another_surface_model_is_refused(
    command: Run, bucket: Bucket, apart: Apart, prepared: Path, tmp_path: Path
) -> None:
    bucket.upload(prepared / "data", "data")
    assert run(command, prepared / "mine.npz", bucket.url("data"), tmp_path / "a").exit_code == 0
    (dsm,) = prepared.glob("data/*/maps/dsm.tif")
    changed = bytearray(dsm.read_bytes())
    changed[-100] ^= 1
    key = f"data/{dsm.relative_to(prepared / 'data')}"
    bucket.client.put_object(Bucket=bucket.name, Key=key, Body=bytes(changed))
    done = run(command, prepared / "mine.npz", bucket.url("data"), tmp_path / "b")
    assert isinstance(done.exception, BenchmarkError)
    assert "not the one that the benchmark was prepared with" in str(done.exception)
    assert in_urls(str(done.exception)).startswith(bucket.url(key))


@pytest.mark.parametrize("where", ["web", "bucket"])
@pytest.mark.slow
def test_a_raster_that_is_replaced_is_read_anew(
    where: str,
    web_apart: tuple[Path, Apart],
    bucket: Bucket,
    apart: Apart,
    tmp_path: Path,
) -> None:
    folder, front = web_apart
    for height in (100, 200, 300):
        heights = np.full((1, 512, 512), height, np.float32)
        path = write_raster(tmp_path / "dsm.tif", heights)
        os.utime(path, (height, height))
        if where == "web":
            shutil.copy2(path, folder / "dsm.tif")
        else:
            bucket.upload(path, "maps")
        location = f"{front.address}/dsm.tif" if where == "web" else bucket.url("maps", "dsm.tif")
        there = here(location)
        assert raster_sha256(there) == sha256_of(path)
        info = open_info(there)
        lifted_to = lift([[100.0, 100.0], [400.0, 400.0]], info, info, jobs=1).points[:, 2]
        assert lifted_to.tolist() == [height, height]


def test_a_checksum_is_that_of_the_file(bucket: Bucket, apart: Apart, surface: Path) -> None:
    bucket.upload(surface, "maps")
    assert raster_sha256(here(bucket.url("maps", "dsm.tif"))) == raster_sha256(surface)
    assert raster_sha256(surface) == sha256(surface.read_bytes()).hexdigest()
