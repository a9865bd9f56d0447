"""From a benchmark and predictions in a bucket to a result in a bucket, and a table of it."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import ResultError, StorageError, UsageError
from airzoo_bench.results.files import results_here
from airzoo_bench.results.records import read_records
from tests.storage.conftest import Bucket, Run
from tests.storage.servers import Answer, Asked, Front
from tests.support import write_predictions


@pytest.fixture
def predictions(tmp_path: Path, perfect: dict[str, Any]) -> Path:
    return write_predictions(tmp_path / "mine.npz", "made-retrieval", **perfect)


@pytest.fixture
def in_bucket(bucket: Bucket, data: Path, predictions: Path) -> Bucket:
    bucket.upload(data, "benchmarks")
    bucket.upload(predictions, "predictions")
    return bucket


def call(bucket: Bucket, *, out: str = "runs/mine") -> list[str]:
    return [
        *("eval", "retrieval", bucket.url("predictions/mine.npz")),
        *("--data", bucket.url("benchmarks"), "--out", bucket.url(*out.split("/"))),
    ]


def test_a_run_in_a_bucket_has_the_bytes_of_a_run_here(
    command: Run, in_bucket: Bucket, data: Path, predictions: Path, tmp_path: Path
) -> None:
    here = tmp_path / "mine"
    assert command("eval", "retrieval", predictions, "--data", data, "-o", here).exit_code == 0
    done = command(*call(in_bucket))
    assert done.exit_code == 0, done.output
    assert f"wrote {in_bucket.url('runs/mine/result.json')}" in done.output
    assert f"next: airzoo-bench table {in_bucket.url('runs/mine/result.json')}" in done.output
    names = sorted(path.name for path in here.iterdir())
    in_runs = [key.removeprefix("runs/mine/") for key in in_bucket.listed() if "runs/" in key]
    assert names == sorted(in_runs)
    for name in names:
        got = in_bucket.client.get_object(Bucket=in_bucket.name, Key=f"runs/mine/{name}")
        assert got["Body"].read() == (here / name).read_bytes(), name


def test_a_table_of_runs_in_a_bucket(command: Run, in_bucket: Bucket) -> None:
    for out in ("runs/mine", "runs/yours"):
        assert command(*call(in_bucket, out=out)).exit_code == 0
    one, two = in_bucket.url("runs/mine"), in_bucket.url("runs/yours/result.json")
    listed = command("table", one, two, "--format", "csv")
    assert listed.exit_code == 0, listed.output
    assert "mine" in listed.output
    assert "yours" in listed.output
    assert command("table", in_bucket.url("runs/*"), "-f", "csv").output == listed.output
    compared = command("compare", one, two)  # which reads the records
    assert compared.exit_code == 0, compared.output
    twice = command("table", one, one)
    assert "named twice" in str(twice.exception)


def test_a_run_takes_the_place_of_an_earlier_one(command: Run, in_bucket: Bucket) -> None:
    for key in ("runs/mine/notes.txt", "runs/mine/figures/old.png", "runs/mine/result.json"):
        in_bucket.client.put_object(Bucket=in_bucket.name, Key=key, Body=b"old")
    done = command(*call(in_bucket))
    assert f"{in_bucket.url('runs/mine')} holds a run, which will be replaced" in done.output
    keys = in_bucket.listed()
    assert "runs/mine/notes.txt" in keys  # which is of no run
    assert "runs/mine/result.json" in keys
    written = [
        one.path.split("?")[0].rpartition("/")[2]
        for one in in_bucket.front.asked
        if one.method in ("PUT", "DELETE") and "/runs/mine/" in one.path and one.headers
    ]
    assert written[-1] == "result.json"  # the new one last
    assert written.index("result.json") < written.index("records.csv")  # the old one first


def test_an_upload_that_breaks_leaves_no_result(
    command: Run, in_bucket: Bucket, mirrors: Path
) -> None:
    assert command(*call(in_bucket)).exit_code == 0

    def refuse(asked: Asked, answer: Answer) -> Answer:
        last = asked.method == "PUT" and "records.csv" in asked.path
        return Answer(403, {}) if last else answer

    in_bucket.front.change = refuse
    done = command(*call(in_bucket))
    error = done.exception
    assert isinstance(error, StorageError)
    assert error.where == in_bucket.url("runs/mine/records.csv")
    assert "runs/mine/result.json" not in in_bucket.listed()
    (kept,) = mirrors.glob("unsent-*/mine")
    assert str(kept) in (error.fix or "")
    assert {"result.json", "records.csv"} <= {path.name for path in kept.iterdir()}


def test_everything_by_https_but_what_is_written(
    command: Run, web: tuple[Path, Front], data: Path, predictions: Path
) -> None:
    folder, front = web
    shutil.copytree(data, folder / "data")
    shutil.copy(predictions, folder / "mine.npz")
    asked = ["eval", "retrieval", f"{front.address}/mine.npz", "--data", f"{front.address}/data"]
    done = command(*asked)
    assert done.exit_code == 0, done.output
    refused = command(*asked, "--out", f"{front.address}/runs/mine")
    assert isinstance(refused.exception, UsageError)
    assert refused.exception.what == "can only be read from"
    assert all(one.method in ("GET", "HEAD") for one in front.asked)


def test_records_that_were_uploaded_again_are_fetched_again(
    command: Run, web: tuple[Path, Front], data: Path, predictions: Path
) -> None:
    """The result beside them has not changed, nor has its mirror."""
    folder, front = web
    run = folder / "run"
    done = command("eval", "retrieval", predictions, "--data", data, "--out", run)
    assert done.exit_code == 0, done.output
    right = (run / "records.csv").read_bytes()
    (run / "records.csv").write_bytes(right[:-1] + b" ")
    path = results_here([f"{front.address}/run"])[0]
    with pytest.raises(ResultError, match="the checksum does not fit"):
        read_records(path)
    (run / "records.csv").write_bytes(right)
    assert len(read_records(path)) == right.count(b"\n") - 1
    front.asked.clear()
    read_records(results_here([f"{front.address}/run"])[0])
    assert front.count("/records.csv") == 0


def test_the_python_face_takes_urls(command: Run, in_bucket: Bucket) -> None:
    import airzoo_bench as ab

    data, predictions = in_bucket.url("benchmarks"), in_bucket.url("predictions/mine.npz")
    assert command(*call(in_bucket)).exit_code == 0
    scored = ab.evaluate(predictions, data=data)
    read = ab.load_result(in_bucket.url("runs/mine"))
    assert read.to_frame().equals(scored.to_frame())
    assert ab.check(predictions, data=data).ok
    benchmark = ab.load_benchmark(in_bucket.url("benchmarks/made"))
    assert [scene.id for scene in benchmark.scenes] == ["east", "west"]
    assert ab.load_benchmark("made", data=data).name == "made"
    assert ab.compare([in_bucket.url("runs/mine")]).table.rows
