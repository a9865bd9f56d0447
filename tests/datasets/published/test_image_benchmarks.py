"""Benchmarks that give images, from their own trees to scores."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from airzoo_bench import evaluate, load_benchmark
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.published.denseuav import class_positions
from airzoo_bench.datasets.published.sues_200 import TRAINING
from airzoo_bench.protocol.lookup import load_protocol
from airzoo_bench.retrieval.truth import read_pairs
from tests.datasets.published import image_trees
from tests.datasets.published.image_answers import exact, prepared, scored, truth_of
from tests.datasets.published.image_trees import CHINESE, TREES
from tests.support import run_main

PROTOCOLS = [(name, protocol) for name in TREES for protocol in DATASETS.get(name).protocols]


@pytest.fixture(autouse=True)
def _data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))


@pytest.mark.parametrize(("name", "protocol"), PROTOCOLS)
def test_exact_answers_score_100(name: str, protocol: str, tmp_path: Path) -> None:
    made, _ = prepared(name, TREES[name](tmp_path / CHINESE), tmp_path)
    result = scored(made, protocol, exact(made, protocol), tmp_path / "exact.npz")
    shares = ("recall@1", "recall@5", "recall@10", "recall@1%", "map", "ap/trapezoid", "mrr")
    assert [result.overall[column] for column in shares] == pytest.approx([1.0] * len(shares))
    assert not any(np.isnan(list(result.overall.values())))
    if name == "denseuav":  # the first images are of the very place
        assert result.overall["sdm@1"] == result.overall["ma@5m"] == 1.0
        assert result.overall["dis@1"] == 0.0
    if name == "university-1652":
        assert not [column for column in result.overall if column.startswith(("sdm", "dis", "ma@"))]


@pytest.mark.parametrize(("name", "protocol"), [PROTOCOLS[0], PROTOCOLS[-1]])
def test_random_answers_score_chance(name: str, protocol: str, tmp_path: Path) -> None:
    made, _ = prepared(name, TREES[name](tmp_path / name), tmp_path)
    random = np.random.default_rng(0)
    arrays = exact(made, protocol)
    columns = ("recall@1", "recall@5", "map", "ap/trapezoid")
    found: dict[str, list[float]] = {column: [] for column in columns}
    chance = {}
    for _ in range(8):
        lengths = (arrays["ranked_ids"] != "").sum(axis=1)
        for row, length in zip(arrays["ranked_ids"], lengths, strict=True):
            row[:length] = random.permutation(row[:length])
        result = scored(made, protocol, arrays, tmp_path / "random.npz")
        chance = result.references["Chance level"].overall
        for column in columns:
            found[column].append(result.overall[column])
    for column in columns:
        spread = np.std(found[column], ddof=1) / np.sqrt(len(found[column]))
        assert abs(np.mean(found[column]) - chance[column]) < 4.5 * spread + 1e-9, column


def test_the_wrong_class_first_scores_half(tmp_path: Path) -> None:
    made, _ = prepared("university-1652", TREES["university-1652"](tmp_path / "u"), tmp_path)
    protocol = "university-1652-drone-to-satellite"
    arrays = exact(made, protocol)
    arrays["ranked_ids"][:, [0, 1]] = arrays["ranked_ids"][:, [1, 0]]
    result = scored(made, protocol, arrays, tmp_path / "p.npz")
    assert result.overall["recall@1"] == 0.0
    assert result.overall["recall@5"] == 1.0
    assert result.overall["map"] == 0.5
    assert result.overall["ap/trapezoid"] == 0.25


def test_university_1652_is_read_whole(tmp_path: Path) -> None:
    source = image_trees.university_1652(tmp_path / "up" / "University-Release")
    made, notes = prepared("university-1652", source.parent, tmp_path)
    there = truth_of(made, "drone-to-satellite")
    back = truth_of(made, "satellite-to-drone")
    assert (len(there.queries), len(there.tiles)) == (24, 12)
    assert (len(back.queries), len(back.tiles)) == (8, 36)
    assert there.positives.counts.tolist() == [1] * 24
    assert back.positives.counts.tolist() == [3] * 8
    assert there.queries["id"].iloc[0] == "drone-to-satellite/0701/image-01"
    assert there.queries["image"].iloc[:3].tolist() == [
        "0701/image-01.jpeg",
        "0701/image-02.JPG",
        "0701/image-03.png",
    ]
    assert f"taken from {source / 'test'}" in notes
    warnings = made.summaries["drone-to-satellite"].warnings
    assert [said.partition(" published")[0] for said in warnings] == [
        "scene drone-to-satellite has 24 queries, where 37,855 are",
        "scene drone-to-satellite has 12 images of the gallery, where 951 are",
    ]
    assert set(made.protocols) == set(DATASETS.get("university-1652").protocols)


def test_sues_200_as_downloaded_and_as_split_have_the_same_ids(tmp_path: Path) -> None:
    raw, _ = prepared("sues-200", image_trees.sues_200(tmp_path / "raw"), tmp_path)
    split = image_trees.sues_200_split(tmp_path / "split")
    other, _ = prepared("sues-200", split, tmp_path / "other")
    for scene in ("150-drone-to-satellite", "300-satellite-to-drone"):
        one, two = truth_of(raw, scene), truth_of(other, scene)
        assert len(one.queries) == 80
        assert len(one.tiles) == 200
        ids = (
            set(two.queries["id"])
            if "to-drone" in scene
            else {name for name in two.queries["id"] if name.endswith("/0")}
        )
        assert ids <= set(one.queries["id"])
    assert len(TRAINING) == 120
    images = truth_of(raw, "250-drone-to-satellite").queries["image"]
    assert images.iloc[0] == "0008/250/0.jpg"


def test_some_heights_of_sues_200_are_named_partial(tmp_path: Path) -> None:
    source = image_trees.sues_200_split(tmp_path / "s", ("150", "300"))
    with pytest.raises(UserError, match="no such folder"):
        prepared("sues-200", source, tmp_path)
    assert not (tmp_path / "data").exists() or not list((tmp_path / "data").iterdir())
    made, _ = prepared("sues-200", source, tmp_path, keep_going=True)
    assert made.folder.name == "sues-200-partial"
    assert set(made.protocols) == {
        "sues-200-drone-to-satellite-partial",
        "sues-200-satellite-to-drone-partial",
    }
    assert len(made.failed) == 4
    protocol = load_protocol(made.folder / "protocols" / f"{next(iter(made.protocols))}.toml")
    assert [scene.id for scene in protocol.scenes] == [
        "150-drone-to-satellite",
        "300-drone-to-satellite",
    ]


def test_denseuav_takes_the_last_line_of_a_class(tmp_path: Path) -> None:
    source = image_trees.denseuav(tmp_path / "d")
    path = source / "Dense_GPS_ALL.txt"
    text = path.read_text(encoding="utf-8")
    path.write_text(f"\ufeff{text}x/002255/H80.JPG E120.5 N30.5 1\n\n", encoding="utf-8")
    found, moved = class_positions(path)
    assert found["2255"] == (120.5, 30.5)
    assert moved == ["2255"]
    made, _ = prepared("denseuav", source, tmp_path)
    [note] = made.summaries["drone-to-satellite"].notes
    assert "of which the last is taken: 1 (2255)" in note
    truth = truth_of(made, "drone-to-satellite")
    assert (len(truth.queries), len(truth.tiles)) == (9, 30)
    assert truth.positions is not None
    of_class = truth.tiles["id"].str.contains("002255").to_numpy()
    assert np.unique(truth.positions[1][of_class], axis=0).tolist() == [[120.5, 30.5]]


def test_gta_uav_has_pairs_weights_and_places(tmp_path: Path) -> None:
    made, _ = prepared("gta-uav", image_trees.gta_uav(tmp_path / "g"), tmp_path)
    scene = "cross-area-drone-to-satellite"
    truth = truth_of(made, scene)
    assert truth.queries["id"].tolist() == [
        f"{scene}/200_0002_0000000001",
        f"{scene}/500_0001_0000025682",
        f"{scene}/500_0001_0000025683",
    ]
    assert truth.tiles["id"].tolist()[1] == f"{scene}/4_0_6_13"
    assert truth.positives.counts.tolist() == [1, 1, 2]
    assert truth.positives.overlap is not None
    assert truth.positives.overlap.tolist() == [0.6, 0.6, 0.6, 0.5]
    every = read_pairs(made.folder / "scenes" / scene / "retrieval" / "overlaps.npz", 3, 16)
    assert every.counts.tolist() == [2, 3, 2]  # the semi-positive ones too
    assert truth.positions is not None
    queries, tiles = truth.positions
    assert tiles[1].tolist() == pytest.approx([4492.8, 9331.2])
    assert np.hypot(*(queries[1] - tiles[1])) == pytest.approx(30 * np.sqrt(2))
    assert truth.queries["height_m"].tolist() == [494.708] * 3
    back = truth_of(made, "cross-area-satellite-to-drone")
    assert (len(back.queries), len(back.tiles)) == (3, 3)
    assert back.positives.counts.tolist() == [1, 2, 1]


def test_the_fingerprint_covers_classes_pairs_and_places(tmp_path: Path) -> None:
    def fingerprint(name: str, source: Path, scene: str) -> str:
        made, _ = prepared(name, source, tmp_path, replace=True)
        return truth_of(made, scene).fingerprint

    source = image_trees.denseuav(tmp_path / "d")
    scene = "drone-to-satellite"
    first = fingerprint("denseuav", source, scene)
    assert fingerprint("denseuav", source, scene) == first
    path = source / "Dense_GPS_ALL.txt"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("E120.3870000", "E120.3870100"), encoding="utf-8")
    moved = fingerprint("denseuav", source, scene)
    source = image_trees.gta_uav(tmp_path / "g")
    scene = "same-area-drone-to-satellite"
    before = fingerprint("gta-uav", source, scene)
    path = source / "same-area-drone2sate-test.json"
    entries = json.loads(path.read_text(encoding="utf-8"))
    entries[2] = image_trees.entry(
        entries[2]["drone_img_name"], ["5_0_7_15.png", "5_0_7_14.png"], []
    )
    path.write_text(json.dumps(entries), encoding="utf-8")
    assert len({first, moved, before, fingerprint("gta-uav", source, scene)}) == 4


@pytest.mark.parametrize("name", TREES)
def test_the_face_gives_images_and_no_truth(name: str, tmp_path: Path) -> None:
    made, _ = prepared(name, TREES[name](tmp_path / "s"), tmp_path)
    for scene in load_benchmark(made.folder).scenes:
        tiles, queries = scene.tiles(), scene.queries()
        assert tiles[0].image.shape == queries[-1].image.shape == (6, 8, 3)
        assert tiles[0].box is None
        assert tiles[0].id.startswith(f"{scene.id}/")
        assert tiles[0].map.name in repr(tiles[0])
        assert queries[0].prior is None


def test_copied_images_are_enough(tmp_path: Path) -> None:
    source = image_trees.gta_uav(tmp_path / "g")
    made, notes = prepared("gta-uav", source, tmp_path, copy=True, tiles_on_disk=True)
    shutil.rmtree(source)
    scene = load_benchmark(made.folder).scenes[0]
    assert len([tile.image for tile in scene.tiles()]) == 16
    assert len([photo.image for photo in scene.queries()]) == 3
    assert "the images of the gallery are files already: none was written" in notes


COMMANDS = {
    "university-1652": ("university-1652-drone-to-satellite", "24 queries, 12 tiles, 1 to 1 pos"),
    "denseuav": ("denseuav-satellite-to-drone", "18 queries, 15 tiles, 3 to 3 positives per query"),
    "gta-uav": ("gta-uav-same-area-drone-to-satellite", "3 queries, 16 tiles, 1 to 2 positives"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_from_the_command_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    protocol, counts = COMMANDS[name]
    source = TREES[name](tmp_path / CHINESE)
    assert run_main("prepare", name, "--source", source) == 0
    said = capsys.readouterr().out
    assert counts in said
    assert f"licence: {DATASETS.get(name).about.licence}" in said
    assert run_main("prepare", name, "--source", source) == 0
    assert "nothing to do" in capsys.readouterr().err
    template, out = tmp_path / "t.npz", tmp_path / "results"
    assert run_main("template", protocol, "--out", template) == 0
    assert run_main("check", template) == 0
    capsys.readouterr()
    assert run_main("eval", "retrieval", template, "--out", out) == 0
    said = capsys.readouterr().out
    assert "R@1%" in said
    assert ("SDM@1" in said) == (name != "university-1652")
    assert run_main("eval", "retrieval", template, "--all", "--format", "markdown") == 0
    assert "nan" not in (said + capsys.readouterr().out).lower()
    assert run_main("table", out) == 0
    assert run_main("report", out, "--out", tmp_path / "report.html") == 0
    assert ": it has many small ones, or images only" in capsys.readouterr().err
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/jpeg") > 3  # photos, and the tiles that were ranked first


def test_the_baseline_describes_images(tmp_path: Path) -> None:
    source = image_trees.gta_uav(tmp_path / "g")
    random = np.random.default_rng(0)
    for path in [*source.rglob("satellite/*.png"), *source.rglob("images/*.png")]:
        pixels = random.integers(0, 256, (6, 8), np.uint8).repeat(10, axis=0).repeat(10, axis=1)
        Image.fromarray(pixels).save(path)
    shutil.copy(source / "satellite/5_0_7_15.png", source / "drone/images/200_0002_0000000001.png")
    made, _ = prepared("gta-uav", source, tmp_path)
    protocol, out = "gta-uav-same-area-drone-to-satellite", tmp_path / "b.npz"
    assert run_main("baseline", "retrieval", protocol, "--out", out) == 0
    found = evaluate(out, data=made.folder)
    assert found.records["recall@1"].iloc[0] == 1.0  # the photo that is a copy of its tile
