"""`prepare ortholoc`, from samples as they are downloaded to scores."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.api.evaluation import evaluate
from airzoo_bench.api.prediction_writer import PredictionWriter
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.matching.truth import read_truth
from airzoo_bench.protocol.lookup import find_protocol
from tests.datasets.published.ortholoc_tree import SAMPLES, SIDE, make_sample, make_tree, matches
from tests.support import run_main

NAME = "ortholoc-matching"


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return make_tree(tmp_path / "下载 OrthoLoC")


def samples() -> dict[str, dict[str, Any]]:
    """Return the arrays of all samples, by the id of their query."""
    return {
        f"{name}/{sample}": make_sample(sample, scale, seed)
        for name, of in SAMPLES.items()
        for seed, (sample, scale) in enumerate(of.items())
    }


def write_matches(path: Path, frame: str, off: float = 0.0) -> Path:
    found = {query: matches(arrays) for query, arrays in samples().items()}
    np.savez(
        path,
        protocol=NAME,
        query_ids=list(found),
        offsets=np.cumsum([0, *(len(photo) for photo, _ in found.values())]),
        query_xy=np.concatenate([photo for photo, _ in found.values()]),
        map_xy=np.concatenate([crop + off for _, crop in found.values()]),
        map_frame=frame,
    )
    return path


@pytest.mark.parametrize("frame", ["crop", "map"])
@pytest.mark.parametrize("copy", [(), ("--copy",)])
def test_exact_matches_score_perfect(
    tree: Path, tmp_path: Path, frame: str, copy: tuple[str, ...]
) -> None:
    """Maps have pixels of several sizes: each match is lifted by the map of its own photo."""
    assert run_main("prepare", "ortholoc", "--source", tree, *copy) == 0
    exact = dict(evaluate(write_matches(tmp_path / "m.npz", frame)).overall)
    assert exact["within_0.1m_1deg"] == 1.0
    assert exact["error_m"] < 1e-3


def test_a_pixel_of_the_map_is_worth_its_own_size(tree: Path, tmp_path: Path) -> None:
    assert run_main("prepare", "ortholoc", "--source", tree) == 0
    result = evaluate(write_matches(tmp_path / "m.npz", "crop", off=1.0))
    errors = result.records.set_index("query")["error_m"]
    for query, arrays in samples().items():
        # All points move by a column east and a row south, and hardly in height.
        assert errors[query] == pytest.approx(np.sqrt(2) * arrays["scale"][0], rel=0.6)
    assert errors["test_outPlace/L08_xDOP0001"] > 2 * errors["test_outPlace/L17_xDOPDSM0002"]


def test_poses_are_in_the_frame_of_the_sample(tree: Path, tmp_path: Path) -> None:
    assert run_main("prepare", "ortholoc", "--source", tree) == 0
    path = tmp_path / "poses.npz"
    with PredictionWriter(path, NAME, load_benchmark("ortholoc")) as writer:
        for query, arrays in samples().items():
            rotation, moved = arrays["extrinsics"][:, :3], arrays["extrinsics"][:, 3]
            writer.add(query, rotation=rotation, centre=-rotation.T @ moved + (0.0, 0.0, 0.3))
    overall = evaluate(path).overall
    assert overall["error_m"] == pytest.approx(0.3, abs=1e-3)
    assert (overall["within_0.25m_2deg"], overall["within_0.5m_5deg"]) == (0.0, 1.0)


def test_what_a_scene_holds(tree: Path, tmp_path: Path) -> None:
    assert run_main("prepare", "ortholoc", "--source", tree, "--crops", "files") == 0
    benchmark = Benchmark.open(tmp_path / "data" / "ortholoc")
    truth = read_truth(benchmark, "test_outPlace")
    assert truth.own_maps
    assert truth.crops.tolist() == [[0, 0, SIDE, SIDE]] * 3
    assert truth.queries["location"].tolist() == ["L08", "L08", "L17"]
    assert truth.queries["domain"].tolist() == ["R", "xDOP", "xDOPDSM"]
    (first, *_) = load_benchmark("ortholoc").scenes
    sizes = [abs(crop.transform.a) for crop in first.crops()]
    assert sizes == pytest.approx(list(SAMPLES["test_outPlace"].values()))
    listed = pd.read_csv(benchmark.scene_folder("test_outPlace") / "matching/crops/crops.csv")
    assert listed["a"].tolist() == pytest.approx(sizes)
    # The second sample's first cell, whose centre is at 13, -7.
    assert listed[["c", "f"]].to_numpy()[1] == pytest.approx((13 - 0.2, -7 + 0.2))


def test_the_rest_of_the_suite_takes_it(tree: Path, tmp_path: Path) -> None:
    assert run_main("prepare", "ortholoc", "--source", tree) == 0
    exact = write_matches(tmp_path / "m.npz", "crop")
    assert run_main("check", exact) == 0
    out = tmp_path / "exact"
    assert run_main("eval", "matching", exact, "--out", out, "--figures") == 0
    assert run_main("report", out, "--out", tmp_path / "report.html") == 0
    assert run_main("baseline", "matching", NAME, "--out", tmp_path / "sift.npz") == 0
    assert run_main("template", NAME, "--out", tmp_path / "template.npz") == 0
    assert run_main("eval", "matching", tmp_path / "template.npz") == 0


def test_a_second_run_writes_nothing_again(tree: Path, tmp_path: Path) -> None:
    assert run_main("prepare", "ortholoc", "--source", tree) == 0
    made = tmp_path / "data" / "made"
    paths = [path for path in made.rglob("*") if path.is_file()]
    before = [path.stat().st_mtime_ns for path in paths]
    assert len(before) == 12
    assert run_main("prepare", "ortholoc", "--source", tree, "--force") == 0
    assert [path.stat().st_mtime_ns for path in paths] == before


def test_samples_of_another_download_are_written_again(tree: Path, tmp_path: Path) -> None:
    """Its samples have the same names, and are older than what was written of the first."""
    assert run_main("prepare", "ortholoc", "--source", tree) == 0
    other = make_tree(tmp_path / "other")
    sample = other / "full" / "test_outPlace" / "L08_R0000.npz"
    arrays = make_sample("L08_R0000", 0.25, 77)
    np.savez_compressed(sample, **arrays)  # type: ignore[arg-type]
    os.utime(sample, (0, 0))
    assert run_main("prepare", "ortholoc", "--source", other, "--force") == 0
    scene = Benchmark.open(tmp_path / "data" / "ortholoc").file.scenes[0]
    photo = np.array(Image.open(Path(scene.images) / "L08_R0000.png"))
    np.testing.assert_array_equal(photo, arrays["image_query"])


def test_another_map_than_was_prepared_is_refused(tree: Path, tmp_path: Path) -> None:
    assert run_main("prepare", "ortholoc", "--source", tree) == 0
    (maps,) = (tmp_path / "data" / "made" / "ortholoc").glob("test_outPlace-*/maps")
    surface = maps / "L08_R0000_dsm.tif"
    surface.write_bytes((maps / "L08_xDOP0001_dsm.tif").read_bytes())
    benchmark = Benchmark.open(tmp_path / "data" / "ortholoc")
    with pytest.raises(BenchmarkError, match="surface model is not the one"):
        read_truth(benchmark, "test_outPlace")
    (maps / "L08_R0000_dom.tif").write_bytes((maps / "L08_xDOP0001_dom.tif").read_bytes())
    with pytest.raises(BenchmarkError, match="grid is not the one"):
        read_truth(benchmark, "test_outPlace")


def test_black_photos_are_left_out(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spoil(tree, image_query=np.zeros((30, 40, 3), np.uint8))
    assert run_main("prepare", "ortholoc", "--source", tree) == 0
    said = " ".join("".join(capsys.readouterr()).split())
    assert "black photos, left out: 1 of 3 (L08_R0000)" in said


def test_one_set_is_a_part(tree: Path, tmp_path: Path) -> None:
    assert run_main("prepare", "ortholoc", "--source", tree / "full" / "test_inPlace") == 0
    assert (tmp_path / "data" / "ortholoc-partial" / "benchmark.toml").is_file()


def spoil(tree: Path, **arrays: Any) -> None:
    """Put other arrays into the first sample; None leaves one out."""
    sample = make_sample("L08_R0000", 0.25, 0) | arrays
    left = {name: array for name, array in sample.items() if array is not None}
    np.savez(tree / "full/test_outPlace/L08_R0000.npz", **left)


def cut(tree: Path) -> None:
    path = tree / "full/test_outPlace/L08_R0000.npz"
    path.write_bytes(path.read_bytes()[:500])


def other(tree: Path) -> None:
    (tree / "full/test_outPlace/notes.npz").write_bytes(b"")


def pickled(tree: Path) -> None:
    spoil(tree, vertices=np.array([None], dtype=object))


def no_sets(tree: Path) -> None:
    for name in SAMPLES:
        (tree / "full" / name).rename(tree / "full" / f"{name}.part")


WRONG: dict[str, tuple[Callable[[Path], None], list[str]]] = {
    "no set": (no_sets, ["holds no test set", "test_outPlace and test_inPlace"]),
    "cut off": (cut, ["L08_R0000.npz", "download it again"]),
    "another file": (other, ["notes.npz", "which is no sample"]),
    "a pickle": (pickled, ["L08_R0000.npz", "object"]),
    "no surface": (lambda tree: spoil(tree, dsm=None), ["has no dsm; it has sample_id"]),
    "one scale": (lambda tree: spoil(tree, scale=np.array(0.25)), ["scale has shape ()"]),
    "y upwards": (
        lambda tree: spoil(tree, scale=np.array((0.25, 0.25))),
        ["off the grid of scale"],
    ),
    "sizes": (
        lambda tree: spoil(tree, image_dop=np.ones((9, 9, 3), np.uint8)),
        ["map and surface model differ in size"],
    ),
    "a photo of shares": (
        lambda tree: spoil(tree, image_query=np.ones((30, 40, 3))),
        ["image_query has shape (30, 40, 3), float64"],
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_one_message_and_no_folder(
    what: str, tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong, expected = WRONG[what]
    wrong(tree)
    assert run_main("prepare", "ortholoc", "--source", tree) == 2
    said = capsys.readouterr().err
    assert said.startswith("airzoo-bench: ")
    for text in expected:
        assert text in said
    assert not (tmp_path / "data" / "ortholoc").exists()


def test_a_protocol_states_a_crop_or_a_given_map(tmp_path: Path) -> None:
    shipped = Path("protocols") / f"{NAME}.toml"
    path = tmp_path / "wrong.toml"
    path.write_text(shipped.read_text().replace('source = "given"', 'source = "metadata"'))
    with pytest.raises(UserError, match=r"\[crop\] is needed"):
        find_protocol(str(path), tmp_path)
