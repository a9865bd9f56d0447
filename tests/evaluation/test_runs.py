"""The whole path from a prediction file to a result; a run never replaces its own input."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.sandbox import Limits
from airzoo_bench.evaluation.evaluate import check_run_folder, evaluate, save
from airzoo_bench.evaluation.track import Run
from airzoo_bench.results.result import read_result, write_result
from tests.goldens.run import unpack
from tests.matching.world import make_world as make_matching
from tests.reconstruction.world import PROTOCOL, make_world, predict_clouds, true_points
from tests.statistics.support import made_method, write_method
from tests.support import (
    MadeScene,
    files_below,
    made_protocol,
    made_truth,
    run_main,
    write_benchmark,
    write_predictions,
)


def test_what_is_missing_scores_its_worst_and_what_is_strange_nothing(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    # All 6 queries of east are answered, none of the 4 of west: 1/2 over scenes, 6/10 pooled.
    strange = {"query_ids": "east/unknown", "ranked_ids": perfect["ranked_ids"][0]}
    half = {key: [*rows[:6], strange[key]] for key, rows in perfect.items()}
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **half)
    evaluation = evaluate(path, data=data)
    result, records = evaluation.result, evaluation.records.set_index("query")
    assert [result.scenes[name]["recall@1"] for name in ("east", "west")] == [1.0, 0.0]
    assert (result.overall["recall@1"], result.pooled["recall@1"]) == (0.5, 0.6)
    assert (result.counts["west"]["missing"], result.extra_queries) == (4, 1)
    assert any("scored at their worst: 4 of 10 (" in note for note in result.notes)
    assert records.loc["east/q00000", "distance_m"] < 1e-6
    assert np.isinf(records.loc["west/q00001", "distance_m"])
    save(evaluation, tmp_path / "out")
    assert np.isinf(read_result(tmp_path / "out" / "result.json").overall["distance_m"])


def test_neither_the_order_of_the_file_nor_the_run_changes_a_byte(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    turned = {key: rows[::-1] for key, rows in perfect.items()}
    for name, arrays in (("a", perfect), ("b", perfect), ("c", turned)):
        path = write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays)
        save(evaluate(path, data=data), tmp_path / name)
    for name, others in (("result.json", "b"), ("records.csv", "bc")):
        for other in others:
            same = (tmp_path / other / name).read_bytes()
            assert (tmp_path / "a" / name).read_bytes() == same


def test_fingerprints_see_what_can_change_a_score(scenes: list[MadeScene]) -> None:
    chosen = made_protocol(scenes)
    values = chosen.model_dump(by_alias=True)
    reworded = type(chosen).model_validate(values | {"title": "other words", "summary": "other"})
    scores = {"scores": values["scores"] | {"recall_at": (1, 2)}}
    assert reworded.fingerprint == chosen.fingerprint
    assert type(chosen).model_validate(values | scores).fingerprint != chosen.fingerprint
    moved = MadeScene("east", [[q, q + 2] for q in range(6)], 12)
    assert made_truth(moved).fingerprint != made_truth(scenes[0]).fingerprint
    truth = made_truth(scenes[0])
    assert truth.fingerprint == made_truth(scenes[0]).fingerprint
    truth.tiles.loc[0, "size_m"] += 1  # PDM divides by it
    assert truth.fingerprint != made_truth(scenes[0]).fingerprint


def test_a_run_replaces_an_earlier_one(
    data: Path, tmp_path: Path, perfect: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mymethod"
    before = read_result(write_method(out, made_method({"east": {"recall@1": [1.0]}})))
    other = before.model_copy(update={"track": "matching"})
    write_result(out / "result.json", other.with_checksum())
    for name in ("alignment.json", "notes.txt"):
        (out / name).touch()
    (out / "figures").mkdir()
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    assert run_main("eval", "retrieval", tmp_path / "none.npz", "--out", out) == 2
    said = capsys.readouterr().err
    assert f"{out}: holds a result of {before.protocol.name}" in said  # of another track
    write_result(out / "result.json", before)
    assert run_main("eval", "retrieval", tmp_path / "none.npz", "--out", out) == 2
    assert "none.npz: no such prediction file" in capsys.readouterr().err
    assert run_main("eval", "retrieval", path, "--data", data, "--out", out) == 0
    said = capsys.readouterr().err
    assert f"replaced {out / 'result.json'}, {out / 'records.csv'} of method mymethod" in said
    assert files_below(out) == {"result.json", "records.csv", "notes.txt"}
    assert read_result(out / "result.json").predictions.method == "mymethod"
    assert run_main("eval", "retrieval", path, "--data", data, "--out", out, "--method", "M") == 0
    assert read_result(out / "result.json").predictions.method == "M"


@pytest.fixture
def out(tmp_path: Path, perfect: dict[str, Any]) -> Path:
    """Return a folder with predictions wherever a run would replace them, and a link to it."""
    folder = tmp_path / "out"
    (folder / "figures" / "deep").mkdir(parents=True)
    path = write_predictions(folder / "figures" / "deep" / "p.npz", "made-retrieval", **perfect)
    for name in ("alignment.json", "result.json", "mine.npz"):
        shutil.copy(path, folder / name)
    (tmp_path / "link").symlink_to(folder, target_is_directory=True)
    (tmp_path / "p.npz").symlink_to(path)
    return folder


def test_predictions_in_what_a_run_replaces_are_refused(out: Path, data: Path) -> None:
    for given in (
        *("out/figures/deep/p.npz", "out/figures", "out/alignment.json", "out/result.json"),
        *("link/figures/deep/p.npz", "p.npz"),
    ):
        for place in ("out", "link"):
            with pytest.raises(UsageError, match="--out"):
                check_run_folder(out.parent / place, out.parent / given)
    run = evaluate(out / "figures" / "deep" / "p.npz", data=data)
    with pytest.raises(UsageError, match="figures"):
        save(run, out)


def test_a_folder_that_no_run_wrote_stays(
    out: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ask = ("eval", "retrieval", out / "mine.npz", "--data", data, "--out", out)
    (out / "result.json").unlink()
    there = files_below(out)
    assert run_main(*ask) == 2
    said = capsys.readouterr().err
    assert "figures" in said
    assert files_below(out) == there
    shutil.rmtree(out / "figures")
    assert run_main(*ask) == 0
    assert files_below(out) == {"result.json", "records.csv", "mine.npz"}


# --- ties: a constant scorer gains nothing, whatever the form of its file ---

N_TIED = 300
SCENE = MadeScene("s", [[q, q + 5] for q in range(4)], N_TIED)


def constant_predictions() -> dict[str, dict[str, Any]]:
    """Every way of saying the same of all tiles, with the tile that answers in the first place."""
    lists = [[SCENE.tile(t) for t in [q, *range(q), *range(q + 1, N_TIED)]] for q in range(4)]
    found: dict[str, dict[str, Any]] = {}
    for listed in (5, 20, 100, 101, N_TIED):
        ranked = [row[:listed] for row in lists]
        found[f"ids {listed}"] = {"ranked_ids": ranked, "scores": np.ones((4, listed))}
    short = [[*row[:3], "", ""] for row in lists]
    found["ids 3"] = {"ranked_ids": short, "scores": np.ones((4, 5))}
    for dtype in (np.float16, np.float32, np.float64):
        found[f"equal {dtype.__name__}"] = {
            "query_descriptors": np.random.default_rng(0).standard_normal((4, 8)).astype(dtype),
            "gallery_ids": SCENE.tile_ids,
            "gallery_descriptors": np.ones((N_TIED, 8), dtype),
        }
    return found


def test_constant_scorers_of_every_form_score_exactly_nothing(tmp_path: Path) -> None:
    chosen = made_protocol([SCENE])
    scores = chosen.scores.model_dump() | {"descriptor_metric": "cosine"}
    values = chosen.model_dump(by_alias=True) | {"scores": scores}
    write_benchmark(tmp_path / "data" / "made", type(chosen).model_validate(values), [SCENE])
    for form, arrays in constant_predictions().items():
        path = tmp_path / f"{form}.npz"
        write_predictions(path, "made-retrieval", query_ids=SCENE.query_ids, **arrays)
        result = evaluate(path, data=tmp_path / "data").result
        assert result.overall.pop("distance_m") == np.inf, form
        assert set(result.overall.values()) == {0.0}, form
        assert result.counts["s"]["tie_dependent"] == 4, form
        assert any("4 queries depend on ties" in note for note in result.notes), form


def test_a_tie_is_broken_before_a_list_is_cut(tmp_path: Path) -> None:
    # One tile is told apart and wrong; 299 tie, and the one that answers stands second.
    scene = MadeScene("s", [[7]], N_TIED)
    write_benchmark(tmp_path / "data" / "made", made_protocol([scene]), [scene])
    others = [scene.tile(t) for t in range(N_TIED) if t not in (7, 40)]
    path = write_predictions(
        tmp_path / "p.npz",
        "made-retrieval",
        query_ids=scene.query_ids,
        ranked_ids=[[scene.tile(40), scene.tile(7), *others]],
        scores=[[1.0, *[0.5] * (N_TIED - 1)]],
    )
    evaluation = evaluate(path, data=tmp_path / "data")
    assert (evaluation.result.overall["map"], evaluation.result.overall["mrr"]) == (0.0, 0.0)
    assert evaluation.records["ranked"].tolist() == [100]
    assert evaluation.records["tie_dependent"].tolist() == [True]


# --- predictions read in a child under limits score as they do without ---

MEMORY = 1 << 28
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")


def alike(path: Path, data: Path, protocol: str | None = None, **more: Any) -> Any:
    found = [
        evaluate(path, data=data, protocol=protocol, run=Run(MEMORY, limits=limits, **more))
        for limits in (None, Limits(MEMORY))
    ]
    plain, limited = (one.result.model_dump(exclude={"created", "checksum"}) for one in found)
    assert limited == plain
    pd.testing.assert_frame_equal(found[1].records, found[0].records, check_exact=True)
    return found[1].opened.predictions


@LINUX
def test_retrieval_of_strangers_maps_what_the_file_stores(
    data: Path, tmp_path: Path, scenes: list[MadeScene]
) -> None:
    random = np.random.default_rng(0)
    arrays = {
        "query_ids": [q for s in scenes for q in s.query_ids],
        "query_descriptors": random.standard_normal((10, 4)),
        "gallery_ids": [t for s in scenes for t in s.tile_ids],
        "gallery_descriptors": random.standard_normal((20, 4)),
    }
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays)
    gallery = alike(path, data).content.gallery
    assert isinstance(gallery, np.memmap)
    assert gallery.filename == path
    np.testing.assert_array_equal(gallery, arrays["gallery_descriptors"])


@LINUX
def test_matches_and_clouds_of_strangers(tmp_path: Path) -> None:
    hills = make_matching(tmp_path / "hills")
    alike(hills.write(tmp_path / "p.npz", hills.named(**hills.matches())), hills.root)
    world = make_world(tmp_path / "data")
    clouds = predict_clouds(world, tmp_path / "p", {"lot": true_points("lot")}, cameras=False)
    alike(clouds, world.root, keep=True)


@LINUX
@pytest.mark.slow
def test_maps_of_strangers_read_one_by_one(tmp_path: Path) -> None:
    unpack("readers-reconstruction", tmp_path)
    alike(tmp_path / "cut3r", tmp_path / "data", PROTOCOL)


def test_a_system_without_limits_is_refused_with_the_reason(
    data: Path,
    tmp_path: Path,
    perfect: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    monkeypatch.setattr("airzoo_bench.core.sandbox.sys.platform", "darwin")
    assert run_main("eval", "retrieval", path, "--data", data, "--untrusted") == 2
    assert "--untrusted: reading under limits needs Linux" in capsys.readouterr().err
