"""Benchmarks, predictions and results in a bucket or at a web server."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import rasterio

import airzoo_bench as ab
from airzoo_bench.benchmark.folder import Benchmark, write_benchmark_file
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import sha256_of
from tests.matching.world import make_world
from tests.storage.conftest import Bucket, Web
from tests.support import write_predictions

Run = Callable[..., Any]


@pytest.fixture
def predictions(tmp_path: Path, perfect: dict[str, Any]) -> Path:
    return write_predictions(tmp_path / "mine.npz", "made-retrieval", **perfect)


@pytest.fixture
def in_bucket(
    bucket: Bucket, data: Path, predictions: Path, command: Run, tmp_path: Path
) -> Bucket:
    """Return a bucket with a benchmark, predictions, and a run of them that was made here."""
    run = tmp_path / "run"
    assert command("eval", "retrieval", predictions, "--data", data, "--out", run).exit_code == 0
    bucket.upload(data, "benchmarks")
    bucket.upload(predictions, "predictions")
    bucket.upload(run, "run")
    return bucket


def test_a_run_from_a_bucket_has_the_bytes_of_a_run_here(
    command: Run, in_bucket: Bucket, tmp_path: Path
) -> None:
    there, data = in_bucket.url("predictions/mine.npz"), in_bucket.url("benchmarks")
    out = tmp_path / "b" / "run"  # the method has its name
    done = command("eval", "retrieval", there, "--data", data, "--out", out)
    assert done.exit_code == 0, done.output
    for path in (tmp_path / "run").iterdir():
        assert (out / path.name).read_bytes() == path.read_bytes()
    compared = command("compare", in_bucket.url("run"), out)  # which reads the records
    assert compared.exit_code == 0, compared.output


def test_everything_by_https(command: Run, web: Web, data: Path, predictions: Path) -> None:
    shutil.copytree(data, web.folder / "data")
    shutil.copy(predictions, web.folder / "mine.npz")
    done = command("eval", "retrieval", f"{web.address}/mine.npz", "--data", f"{web.address}/data")
    assert done.exit_code == 0, done.output


def test_the_python_face_takes_urls(in_bucket: Bucket) -> None:
    data, predictions = in_bucket.url("benchmarks"), in_bucket.url("predictions/mine.npz")
    scored = ab.evaluate(predictions, data=data)
    read = ab.load_result(in_bucket.url("run"))
    assert read.to_frame().equals(scored.to_frame())
    assert ab.check(predictions, data=data).ok
    benchmark = ab.load_benchmark(in_bucket.url("benchmarks/made"))
    assert [scene.id for scene in benchmark.scenes] == ["east", "west"]


def test_maps_and_surface_models_in_a_bucket(command: Run, bucket: Bucket, tmp_path: Path) -> None:
    world = make_world(tmp_path)
    predictions = tmp_path / "mine.npz"
    world.write(predictions, world.matches())
    benchmark = Benchmark.open(world.folder)
    (scene,) = benchmark.file.scenes
    (world.folder / "maps").mkdir()
    for kind in ("dom", "dsm"):
        shutil.copy(getattr(scene, kind), world.folder / "maps" / f"{kind}.tif")
    dsm = world.folder / "maps" / "dsm.tif"
    changes = {"dom": "maps/dom.tif", "dsm": "maps/dsm.tif", "dsm_sha256": sha256_of(dsm)}
    scenes = (scene.model_copy(update=changes),)
    write_benchmark_file(world.folder, benchmark.file.model_copy(update={"scenes": scenes}))
    bucket.upload(world.folder, "data")

    def run(data: object, name: str) -> Any:
        out = tmp_path / name
        where = ("--data", data, "--out", out, "--method", "m")
        return command("eval", "matching", predictions, *where)

    assert run(world.folder, "a").exit_code == 0
    done = run(bucket.url("data"), "b")
    assert done.exit_code == 0, done.output
    for name in ("records.csv", "result.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    with rasterio.open(dsm, "r+") as raster:
        raster.write(raster.read(1) + 1, 1)
    bucket.upload(dsm, "data/maps")
    assert isinstance(run(bucket.url("data"), "c").exception, BenchmarkError)
