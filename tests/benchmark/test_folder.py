"""Benchmark folders: found by name, by checksums and protocol; photos read small."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.benchmark.images import photo_size, read_grey
from airzoo_bench.benchmark.queries import conditions_of, write_queries
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.retrieval.truth import read_truth, write_truth
from tests.support import MadeScene, made_protocol, made_truth


def test_found_by_name_or_as_itself(data: Path) -> None:
    for place in (data, data / "made"):
        benchmark = find_benchmark("made", place)
        assert benchmark.folder == data / "made"
        assert benchmark.scene("west").crs == "EPSG:4547"
        assert benchmark.scene_folder("west") == data / "made" / "scenes" / "west"
    with pytest.raises(BenchmarkError, match=r"benchmark other is not there[\s\S]*found: made"):
        find_benchmark("other", data)
    with pytest.raises(BenchmarkError, match="holds benchmark made, not other"):
        find_benchmark("other", data / "made")


def test_results_of_the_demo_do_not_hide_the_shipped_benchmark(tmp_path: Path) -> None:
    (tmp_path / "airzoo-demo" / "retrieval").mkdir(parents=True)
    assert find_benchmark("airzoo-demo", tmp_path).name == "airzoo-demo"


def test_what_the_computer_leaves_in_folders_is_not_truth(data: Path) -> None:
    (data / "made" / "scenes" / "west" / ".DS_Store").touch()
    (data / "made" / "scenes" / "notes.txt").touch()
    Benchmark.open(data / "made")
    (data / "made" / "scenes" / "west" / "more.csv").touch()
    with pytest.raises(BenchmarkError, match=r"more\.csv: has no checksum in benchmark\.toml"):
        Benchmark.open(data / "made")


def test_another_protocol_s_settings_are_all_named(data: Path, scenes: list[MadeScene]) -> None:
    benchmark, chosen = Benchmark.open(data / "made"), made_protocol(scenes)
    benchmark.check_fits(chosen)
    values = chosen.model_dump(by_alias=True)
    values["gallery"]["overlap"] = 0.25
    values["ground_truth"] |= {"rule": "iou", "iou_above": 0.39}
    with pytest.raises(BenchmarkError) as caught:
        benchmark.check_fits(RetrievalProtocol.model_validate(values))
    message = str(caught.value)
    assert "gallery.overlap: 0.5 in the folder, 0.25 in the protocol" in message
    assert "ground_truth.rule: plane in the folder, iou in the protocol" in message
    assert "ground_truth.iou_above: None in the folder, 0.39 in the protocol" in message
    # Scores are computed anew and may differ from those that the folder was made with.
    values = chosen.model_dump(by_alias=True)
    values["scores"]["recall_at"] = (1, 10)
    benchmark.check_fits(RetrievalProtocol.model_validate(values))


def test_ids_stay_text(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("id,image,weather\n01/007,nan,\n01/null,NA,rain\n")
    table = read_table(tmp_path / "a.csv", ("id", "image"))
    assert table["id"].tolist() == ["01/007", "01/null"]
    assert table["image"].iloc[1] == "NA"


def test_truth_both_ways(tmp_path: Path) -> None:
    scene = MadeScene("s", [[0, 2], [], [1]], 4, {"weather": ["rain", "sun", "fog"]})
    truth = made_truth(scene)
    write_queries(tmp_path, truth.queries)
    write_truth(tmp_path, truth)
    read = read_truth(tmp_path, "s")
    assert read.fingerprint == truth.fingerprint
    assert [read.positives.tiles_of(q).tolist() for q in range(3)] == [[0, 2], [], [1]]
    pd.testing.assert_frame_equal(conditions_of(read.queries), conditions_of(truth.queries))


def test_photos_are_read_small_and_turned_ones_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    Image.new("RGB", (640, 320), (255, 0, 0)).save(path)
    assert photo_size(path) == (640, 320)
    grey = read_grey(path, 64)
    assert grey.shape == (32, 64)
    assert abs(int(grey[5, 5]) - 76) <= 1  # 0.299 of red
    assert read_grey(path, 1000).shape == (320, 640)
    for orientation, refused in ((0, False), (1, False), (3, True), (6, True), (9, False)):
        exif = Image.Exif()
        exif[0x0112] = orientation
        Image.new("RGB", (640, 320)).save(path, exif=exif)
        if refused:
            with pytest.raises(BenchmarkError, match=rf"EXIF orientation {orientation}\)"):
                photo_size(path)
        else:
            assert photo_size(path) == (640, 320)


def test_photos_that_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    with pytest.raises(
        BenchmarkError, match=r"a\.jpg: not a readable photo: No such file[\s\S]*back"
    ):
        read_grey(path, 64)
    noise = np.random.default_rng(0).integers(0, 256, (320, 640, 3), np.uint8)
    Image.fromarray(noise).save(path)
    path.write_bytes(path.read_bytes()[:5000])
    assert photo_size(path) == (640, 320)
    with pytest.raises(BenchmarkError, match=r"not a readable photo: .*truncated"):
        read_grey(path, 64)
