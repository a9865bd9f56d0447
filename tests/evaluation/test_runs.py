"""The whole path from a prediction file to a result, in process."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.evaluation.evaluate import Evaluation, evaluate
from airzoo_bench.evaluation.generate import write_template
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.results.result import Result, read_result, write_result
from tests.statistics.support import made_method, write_method
from tests.support import (
    MadeScene,
    files_below,
    made_protocol,
    run_main,
    write_benchmark,
    write_predictions,
)

MEMORY = 1 << 30


def score(path: Path, data: Path, **options: Any) -> Evaluation:
    return evaluate(path, track="retrieval", data=data, **options)


def test_perfect_predictions_score_one(data: Path, tmp_path: Path, perfect: dict[str, Any]) -> None:
    result = score(write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect), data).result
    for key in ("recall@1", "recall@5", "ap@5/min", "ap@5/trec", "ap@5/hits", "map", "mrr"):
        assert result.overall[key] == 1.0, key
    assert result.overall["ap@5"] == pytest.approx(2 / 5)
    assert result.counts["east"]["queries"] == 6
    assert result.notes == ()


def test_overall_is_the_unweighted_mean_of_scenes(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    # All 6 queries of east are answered, none of the 4 of west: 1/2 over scenes, 6/10 pooled.
    half = {key: rows[:6] for key, rows in perfect.items()}
    result = score(write_predictions(tmp_path / "p.npz", "made-retrieval", **half), data).result
    assert result.scenes["east"]["recall@1"] == 1.0
    assert result.scenes["west"]["recall@1"] == 0.0
    assert result.overall["recall@1"] == 0.5
    assert result.pooled["recall@1"] == 0.6
    assert result.counts["west"]["missing"] == 4
    assert any("scored at their worst: 4 of 10 (" in note for note in result.notes)


def test_a_missing_query_is_infinitely_far(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    one = {key: rows[:1] for key, rows in perfect.items()}
    evaluation = score(write_predictions(tmp_path / "p.npz", "made-retrieval", **one), data)
    records = evaluation.records.set_index("query")
    assert records.loc["east/q00000", "distance_m"] < 1e-6
    assert np.isinf(records.loc["east/q00001", "distance_m"])
    assert np.isinf(evaluation.result.overall["distance_m"])
    save(evaluation, tmp_path / "out")
    assert np.isinf(read_result(tmp_path / "out" / "result.json").overall["distance_m"])


def test_extra_queries_are_counted_and_left_aside(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    more = {
        "query_ids": [*perfect["query_ids"], "east/unknown"],
        "ranked_ids": [*perfect["ranked_ids"], perfect["ranked_ids"][0]],
    }
    result = score(write_predictions(tmp_path / "p.npz", "made-retrieval", **more), data).result
    assert result.extra_queries == 1
    assert result.overall["recall@1"] == 1.0


def test_the_order_of_the_file_does_not_matter(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    there = score(write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect), data)
    turned = {key: rows[::-1] for key, rows in perfect.items()}
    back = score(write_predictions(tmp_path / "q.npz", "made-retrieval", **turned), data)
    pd.testing.assert_frame_equal(there.records, back.records)
    assert there.result.overall == back.result.overall


def test_a_constant_scorer_scores_nothing(data: Path, tmp_path: Path, scenes: Any) -> None:
    # Without the tie rule, gallery order would give q00000 its tile 0 at rank 1.
    arrays = {
        "query_ids": [q for s in scenes for q in s.query_ids],
        "query_descriptors": np.ones((10, 3), np.float32),
        "gallery_ids": [t for s in scenes for t in s.tile_ids],
        "gallery_descriptors": np.ones((20, 3), np.float32),
    }
    result = score(write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays), data).result
    assert result.overall["recall@5"] == 0.0
    assert result.counts["east"]["tie_dependent"] == 6


N_TIED = 300


def constant_predictions(scene: MadeScene) -> dict[str, dict[str, Any]]:
    """Every way of saying the same of all tiles, with the tile that answers in the first place."""
    random = np.random.default_rng(0)
    n = len(scene.positives)
    lists = [[scene.tile(t) for t in [q, *range(q), *range(q + 1, N_TIED)]] for q in range(n)]
    ids = {"query_ids": scene.query_ids}
    predictions = {}
    for listed in (5, 20, 100, 101, N_TIED):
        ranked = [row[:listed] for row in lists]
        predictions[f"ids {listed}"] = ids | {"ranked_ids": ranked, "scores": np.ones((n, listed))}
    short = [[*row[:3], "", ""] for row in lists]
    predictions["ids 3"] = ids | {"ranked_ids": short, "scores": np.ones((n, 5))}
    described = ids | {"gallery_ids": scene.tile_ids}
    for name, rows in {
        "equal": np.ones((N_TIED, 8)),
        "multiples": np.outer(random.uniform(0.1, 9, N_TIED), random.standard_normal(8)),
    }.items():
        for dtype in (np.float16, np.float32, np.float64):
            queries = random.standard_normal((n, 8)).astype(dtype)
            predictions[f"{name} {dtype.__name__}"] = described | {
                "query_descriptors": queries,
                "gallery_descriptors": rows.astype(dtype),
            }
    return predictions


@pytest.mark.parametrize("form", constant_predictions(MadeScene("s", [[0]], N_TIED)))
def test_constant_scorers_of_every_form_score_exactly_nothing(form: str, tmp_path: Path) -> None:
    scene = MadeScene("s", [[q, q + 5] for q in range(4)], N_TIED)
    chosen = made_protocol([scene])
    chosen = type(chosen).model_validate(
        chosen.model_dump(by_alias=True)
        | {"scores": chosen.scores.model_dump() | {"descriptor_metric": "cosine"}}
    )
    write_benchmark(tmp_path / "data" / "made", chosen, [scene])
    path = write_predictions(
        tmp_path / "p.npz", "made-retrieval", **constant_predictions(scene)[form]
    )
    result = score(path, tmp_path / "data").result
    assert result.overall.pop("distance_m") == np.inf
    assert set(result.overall.values()) == {0.0}
    assert result.counts["s"]["tie_dependent"] == 4


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
    evaluation = score(path, tmp_path / "data")
    assert evaluation.result.overall["map"] == 0.0
    assert evaluation.result.overall["mrr"] == 0.0
    assert evaluation.records["ranked"].tolist() == [100]
    assert evaluation.records["tie_dependent"].tolist() == [True]


def test_descriptors_and_their_ranked_ids_agree(
    data: Path, tmp_path: Path, scenes: list[MadeScene]
) -> None:
    random = np.random.default_rng(1)
    queries = random.standard_normal((10, 16)).astype(np.float32)
    gallery = random.standard_normal((20, 16)).astype(np.float32)
    ranked, start, first = [], 0, 0
    for scene in scenes:
        n = len(scene.positives)
        for query in queries[start : start + n].astype(np.float64):
            there = gallery[first : first + scene.n_tiles].astype(np.float64)
            order = np.argsort(((there - query) ** 2).sum(axis=1))[:8]
            ranked.append([scene.tile(t) for t in order])
        start, first = start + n, first + scene.n_tiles
    ids = [q for s in scenes for q in s.query_ids]
    by_ids = write_predictions(
        tmp_path / "ids.npz", "made-retrieval", query_ids=ids, ranked_ids=ranked
    )
    by_descriptors = write_predictions(
        tmp_path / "descriptors.npz",
        "made-retrieval",
        query_ids=ids,
        query_descriptors=queries,
        gallery_ids=[t for s in scenes for t in s.tile_ids],
        gallery_descriptors=gallery,
    )
    one, other = (
        score(by_ids, data).result,
        score(by_descriptors, data, resources=Resources(jobs=2)).result,
    )
    for key in ("recall@1", "recall@3", "recall@5", "ap@5", "distance_m", "sdm@5", "pdm@5"):
        assert one.scenes["east"][key] == other.scenes["east"][key], key
        assert one.scenes["west"][key] == other.scenes["west"][key], key


def test_gallery_rows_may_stand_in_any_order(
    data: Path, tmp_path: Path, scenes: list[MadeScene]
) -> None:
    random = np.random.default_rng(2)
    tiles = np.array([t for s in scenes for t in s.tile_ids])
    arrays = {
        "query_ids": [q for s in scenes for q in s.query_ids],
        "query_descriptors": random.standard_normal((10, 4)).astype(np.float32),
    }
    described = random.standard_normal((20, 4)).astype(np.float32)
    order = random.permutation(20)
    there = write_predictions(
        tmp_path / "a.npz",
        "made-retrieval",
        gallery_ids=tiles,
        gallery_descriptors=described,
        **arrays,
    )
    mixed = write_predictions(
        tmp_path / "b.npz",
        "made-retrieval",
        gallery_ids=tiles[order],
        gallery_descriptors=described[order],
        **arrays,
    )
    pd.testing.assert_frame_equal(score(there, data).records, score(mixed, data).records)


def test_the_same_input_gives_the_same_bytes(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    for name in ("a", "b"):
        save(score(path, data), tmp_path / name)
    for name in ("result.json", "records.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_fingerprints_see_what_can_change_a_score(
    data: Path, tmp_path: Path, perfect: dict[str, Any], scenes: list[MadeScene]
) -> None:
    from tests.support import made_protocol, made_truth

    chosen = made_protocol(scenes)
    values = chosen.model_dump(by_alias=True)
    reworded = type(chosen).model_validate(values | {"title": "other words", "summary": "other"})
    stricter = type(chosen).model_validate(
        values | {"scores": values["scores"] | {"recall_at": (1, 2)}}
    )
    assert reworded.fingerprint == chosen.fingerprint
    assert stricter.fingerprint != chosen.fingerprint
    moved = MadeScene("east", [[q, q + 2] for q in range(6)], 12)
    assert made_truth(moved).fingerprint != made_truth(scenes[0]).fingerprint
    assert made_truth(scenes[0]).fingerprint == made_truth(scenes[0]).fingerprint


def test_a_changed_protocol_does_not_pass_for_its_namesake(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    known = next(data.rglob("made-retrieval.toml")).read_text()
    for old, new, notes in (
        ('ap = "precision"', 'ap = "hits"', ("scores.ap is precision against hits",)),
        ('title = "', 'title = "My own ', ()),
    ):
        assert old in known
        mine = tmp_path / "mine.toml"
        mine.write_text(known.replace(old, new))
        found = score(path, data, protocol=str(mine)).result.notes
        assert len(found) == len(notes)
        for note, part in zip(found, notes, strict=True):
            assert part in note
            assert "not the made-retrieval that all have" in note


@pytest.mark.parametrize("kind", [None, "ranked-ids", "descriptors"])
def test_a_template_scores(data: Path, tmp_path: Path, kind: str | None) -> None:
    out = tmp_path / "t.npz"
    write_template("made-retrieval", data=data, out=out, kind=kind, seed=3)
    result = score(out, data).result
    assert result.counts["west"]["missing"] == 0
    assert 0 <= result.overall["recall@5"] <= 1


def test_a_run_replaces_an_earlier_one_and_says_so(
    data: Path, tmp_path: Path, perfect: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mymethod"
    before = write_method(out, made_method({"east": {"recall@1": [1.0]}}))
    left = json.loads(before.read_text()) | {"track": "matching"}
    write_result(before, Result.model_validate(left).with_checksum())
    for name in ("timings.csv", "notes.txt"):
        (out / name).touch()
    (out / "figures").mkdir()
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    assert run_main("eval", "retrieval", path, "--data", data, "--out", out) == 0
    said = capsys.readouterr().err
    assert "holds a run of the matching track: Method by " in said
    assert "result.json, records.csv, timings.csv, figures will be replaced" in said
    assert f"wrote {out / 'result.json'} and {out / 'records.csv'}" in said
    assert files_below(out) == {"result.json", "records.csv", "notes.txt"}
    assert "the method is called mymethod, after --out; --method gives it another name" in said
    assert read_result(out / "result.json").predictions.method == "mymethod"
    assert run_main("eval", "retrieval", path, "--data", data, "--out", out, "--method", "M") == 0
    said = capsys.readouterr().err
    assert "holds a run of the retrieval track: mymethod by made-retrieval v" in said
    assert f"written {date.today():%Y-%m-%d}" in said
    assert "; result.json, records.csv will be replaced" in said
    assert read_result(out / "result.json").predictions.method == "M"
