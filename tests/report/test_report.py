"""The report as a file: what stands in it, what is left out, what bad input gets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.matching.metrics import matching_scores
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.reconstruction.scoring import reconstruction_scores
from airzoo_bench.report.hardest import hardest_rows, order_said
from airzoo_bench.report.labels import meaning
from airzoo_bench.report.packing import json_value
from airzoo_bench.report.sections import Section, read_sections
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import score_columns
from airzoo_bench.retrieval.scoring import retrieval_scores
from airzoo_bench.retrieval.settings import RetrievalProtocol
from tests.report.made import (
    made_page,
    of_benchmark,
    reconstruction_method,
    retrieval_method,
    run,
    write_methods,
)
from tests.statistics.support import ERROR, HIT, made_result


def test_numbers_are_those_of_results_and_records(tmp_path: Path) -> None:
    methods = [retrieval_method("a", 1), retrieval_method("b", 0)]
    page = made_page(tmp_path, *write_methods(tmp_path, methods))
    [part] = page.sections
    assert [method["name"] for method in part["methods"]] == ["a", "b"]
    keys = [score["key"] for score in part["scores"]]
    for place, method in enumerate(methods):
        assert part["standings"]["overall"]["values"][place] == json_value(
            [method.result.overall[key] for key in keys]
        )
    assert page.unpack(part["queries"]["ids"]) == methods[0].records["query"].tolist()
    hits = page.values(part["queries"]["scores"]["recall@1"]).reshape(2, -1)
    errors = page.values(part["queries"]["scores"]["error_m"]).reshape(2, -1)
    for row, method in enumerate(methods):
        np.testing.assert_array_equal(hits[row], method.records["recall@1"])
        np.testing.assert_allclose(errors[row], method.records["error_m"], rtol=1e-12)


def test_breakdowns_are_of_all_scenes_and_of_each(tmp_path: Path) -> None:
    method = retrieval_method("a", 0)
    page = made_page(tmp_path, *write_methods(tmp_path, [method]))
    weather = next(found for found in page.sections[0]["breakdowns"] if found["by"] == "weather")
    views = page.unpack(weather["views"])
    for scope, scene in enumerate((None, "east", "west")):
        rows = method.records if scene is None else method.records.query("scene == @scene")
        group = rows[rows["weather"] == weather["labels"][0]]
        assert weather["counts"][scope][0] == len(group)
        assert views[scope][0]["values"][0][0] == pytest.approx(group["recall@1"].mean())


def test_intervals_are_those_of_compare(tmp_path: Path) -> None:
    from airzoo_bench.results.comparison import score_intervals
    from airzoo_bench.statistics.samples import ResamplingConfig

    methods = [retrieval_method("a", 1), retrieval_method("b", 0)]
    [part] = made_page(tmp_path, *write_methods(tmp_path, methods)).sections
    for place, method in enumerate(methods):
        found = score_intervals(method, method.result.columns[:1], ResamplingConfig())
        shown = part["intervals"]
        assert shown["overall"]["recall@1"][place] == limits_of(found.overall[0])
        assert shown["scenes"]["west"]["recall@1"][place] == limits_of(found.groups["west"][0])


def limits_of(interval: Any) -> str:
    return f"{100 * interval.low:.2f} to {100 * interval.high:.2f}"


def test_other_protocols_are_parts_of_their_own_benchmark_by_benchmark(tmp_path: Path) -> None:
    methods = [
        reconstruction_method("cloud", 0),
        of_benchmark(retrieval_method("x", 3, truth="x" * 64), "other"),
        retrieval_method("b", 0),
        retrieval_method("a", 1),
        retrieval_method("c", 2, truth="u" * 64),
        of_track(retrieval_method("pose", 4, truth="m" * 64), "matching"),
    ]
    parts = made_page(tmp_path, *write_methods(tmp_path, methods)).sections
    assert [(part["truth"]["name"], part["track"]) for part in parts] == [
        *[("made", "retrieval")] * 2,
        ("made", "matching"),
        ("made", "reconstruction"),
        ("other", "retrieval"),
    ]
    assert [[m["name"] for m in part["methods"]] for part in parts] == [
        ["a", "b"],
        ["c"],
        ["pose"],
        ["cloud"],
        ["x"],
    ]
    assert [part["id"] for part in parts] == [f"part{number}" for number in range(1, 6)]
    assert parts[3]["queries"] is None
    assert parts[3]["hardest"] == []


def of_track(method: Scored, track: str) -> Scored:
    result = method.result.model_copy(update={"track": track}).with_checksum()
    return Scored(method.name, result, method.records)


def test_what_is_a_hit_is_told_by_the_score_not_by_its_values(tmp_path: Path) -> None:
    made = retrieval_method("a", 0)
    records = made.records.assign(**{"ap@5": 1.0})  # of values that a hit could have
    ap = HIT.model_copy(update={"key": "ap@5", "title": "AP@5"})
    settings = {"scores": {"ranks_kept": 5}}
    method = Scored("a", made_result(records, (HIT, ap, ERROR), settings=settings), records)
    [part] = made_page(tmp_path, *write_methods(tmp_path, [method])).sections
    told = {score["key"]: score["isHit"] for score in part["scores"]}
    assert told == {"recall@1": True, "ap@5": False, "error_m": False}


def test_every_score_of_every_protocol_has_a_meaning() -> None:
    for path in shipped_protocols().values():
        protocol = load_protocol(path)
        if isinstance(protocol, RetrievalProtocol):
            scores = retrieval_scores(protocol.scores)
        elif isinstance(protocol, MatchingProtocol):
            scores = matching_scores(protocol.scores)
        else:
            scores = reconstruction_scores(protocol.scores)
        for score in score_columns(scores):
            assert meaning(protocol.track, score), (protocol.name, score.key)
    assert meaning("retrieval", ERROR) == meaning("", HIT) == ""
    within = HIT.model_copy(update={"key": "within_5m_1deg"})
    assert meaning("matching", within) == "share of queries posed within 5 m and 1°"


def test_intervals_are_called_what_they_are(tmp_path: Path) -> None:
    methods = [retrieval_method("a", 0)]
    note = made_page(tmp_path, *write_methods(tmp_path, methods)).sections[0]["intervals"]["note"]
    assert note.startswith(
        "95 % intervals of R@1, Median, Wilson or MOVER over queries within scenes; BCa, 10000 "
    )
    # Of a median that one query more makes infinite there is no BCa.
    errors = np.where(np.arange(40) % 4 < 2, np.inf, np.arange(40.0))
    records = methods[0].records.assign(error_m=errors)
    made = Scored("a", made_result(records, (ERROR,)), records)
    note = made_page(tmp_path, *write_methods(tmp_path, [made])).sections[0]["intervals"]["note"]
    assert note.startswith("95 % intervals of Median, percentile, 10000 resamples")


def test_one_scene_has_no_intervals_and_no_average_over_scenes(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [reconstruction_method("cloud", 0, scenes=1)])
    [part] = made_page(tmp_path, *paths).sections
    assert part["intervals"]["note"] == "no intervals: only 1 scene: an interval needs 5"
    assert part["figures"][0]["title"] == "f1@1m [%], scene Scene0"


def test_methods_of_the_same_name_are_told_apart(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [retrieval_method("a", 1), retrieval_method("a", 0)])
    names = [section.name for section in read_sections(paths)[0].methods]
    assert names == ["a (retrieval0)", "a (retrieval1)"]


def test_notes_stand_once_with_the_methods_that_have_them(tmp_path: Path) -> None:
    methods = []
    for name, notes in (("a", ("same", "only a")), ("b", ("same",))):
        made = retrieval_method(name, 0)
        result = made.result.model_copy(update={"notes": notes}).with_checksum()
        methods.append(Scored(name, result, made.records))
    [part] = made_page(tmp_path, *write_methods(tmp_path, methods)).sections
    assert part["notes"] == [
        {"text": "same", "methods": ["a", "b"]},
        {"text": "only a", "methods": ["a"]},
    ]


def test_the_same_results_give_the_same_bytes(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [retrieval_method("a", 0), reconstruction_method("b", 1)])
    assert made_page(tmp_path, *paths).text == made_page(tmp_path, *paths, "-j", 1).text


def test_records_that_were_changed_are_refused(tmp_path: Path) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("a", 0)])
    records = path.with_name("records.csv")
    records.write_text(records.read_text().replace("sunny", "foggy"))
    done = run("report", path, "-o", tmp_path / "r.html")
    assert isinstance(done.exception, ResultError)


def test_a_file_named_twice_is_refused(tmp_path: Path) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("a", 0)])
    assert isinstance(run("report", path, path).exception, UsageError)


def test_the_hardest_queries_are_worst_on_average_then_by_error() -> None:
    methods = [retrieval_method("a", 0, 8), retrieval_method("b", 1, 8)]
    hits = [[1, 0, 0, 1, 0, 1, 1, 1], [0, 0, 0, 0, 0, 1, 1, 1]]
    errors = [[1, 5, 9, 1, np.inf, 1, 1, 1], [1, 5, 9, 2, 1, 1, 1, 1]]
    made = [
        method.__class__(
            method.name,
            method.result,
            method.records.assign(**{"recall@1": np.array(hit, float), "error_m": error}),
        )
        for method, hit, error in zip(methods, hits, errors, strict=True)
    ]
    # Rows 1, 2, 4 are missed by both; by rank of error 2 leads, then 1, then 4; 3 leads 0.
    assert hardest_rows(Section(made), 5).tolist() == [2, 1, 4, 3, 0]
    assert order_said(Section(made)) == (
        "Worst first, by the mean over methods of R@1, "
        "then by the mean over methods of its place among the queries by translation error [m]."
    )
    assert order_said(Section(made[:1])) == "Worst first, by R@1, then by translation error [m]."


def test_what_is_said_of_the_order_of_errors_is_what_is_done() -> None:
    # By the mean error row 0 would lead, and infinite means would tie; by the mean place row 2.
    made = [
        Scored(name, made_result(records, (ERROR,), name), records)
        for name, errors in (("a", [900.0, 5, 40, 1]), ("b", [1.0, 2, 30, np.inf]))
        for records in [pd.DataFrame({"scene": "s", "query": list("wxyz"), "error_m": errors})]
    ]
    section = Section(made)
    assert hardest_rows(section, 4).tolist() == [2, 0, 3, 1]
    assert order_said(section) == (
        "Worst first, by the mean over methods of its place among the queries by "
        "translation error [m]."
    )
