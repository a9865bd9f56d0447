"""Who is best and who cannot be told from the best: decided once, as tables and `compare` do."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.report.standings import marks_of
from airzoo_bench.results.comparison import compare
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Reference
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.comparison import verdict
from airzoo_bench.tables.layouts import methods_table
from airzoo_bench.tables.model import show_number
from tests.report.made import made_page, reconstruction_method, retrieval_method, write_methods
from tests.statistics.support import ERROR, HIT, made_result

SCRIPTS = Path(__file__).parents[2] / "airzoo_bench" / "report" / "html"


def method(name: str, hits: int, of: int = 200) -> Scored:
    """Return a method on two scenes that answers so many queries, the first ones."""
    made = retrieval_method(name, 0, queries=of)
    hit = np.arange(of) < hits
    records = made.records.assign(
        **{"recall@1": hit.astype(float), "error_m": np.where(hit, 1.0, np.inf)},
        first_hit_rank=hit.astype(int),
    )
    settings = made.result.protocol.settings
    return Scored(name, made_result(records, (HIT, ERROR), name, settings=settings), records)


def test_the_best_stands_first(tmp_path: Path) -> None:
    methods = [method("poor", 20), method("top", 150), method("middle", 80)]
    [part] = made_page(tmp_path, *write_methods(tmp_path, methods)).sections
    assert [found["name"] for found in part["methods"]] == ["top", "middle", "poor"]
    assert part["standings"]["overall"]["texts"][0][0] == "75.00"


def test_marks_are_those_of_tables_and_of_compare(tmp_path: Path) -> None:
    methods = [method("top", 100), method("close", 97), method("far", 40)]
    [part] = made_page(tmp_path, *write_methods(tmp_path, methods)).sections
    overall = part["standings"]["overall"]
    assert [row[0] for row in overall["marks"]] == ["best", "tied", ""]
    bold = [row.cells[1].best for row in methods_table([m.result for m in methods]).rows]
    assert [row[0] == "best" for row in overall["marks"]] == bold
    made = compare(methods, [HIT], reference="best", resampling=ResamplingConfig())
    tied = [pair.p_holm > 0.05 for pair in made.pairs]
    assert [row[0] == "tied" for row in overall["marks"][1:]] == tied
    # What is not tested has a star, and nothing that looks like a test.
    assert not part["standings"]["pooled"]["tested"]
    assert {row[0] for row in part["standings"]["pooled"]["marks"]} == {"best", ""}


def test_every_text_is_that_of_the_table(tmp_path: Path) -> None:
    # 1 of 32 is 3.125 %, which Python and JavaScript round to different sides.
    methods = [method("one", 1, 32), method("none", 0, 32)]
    [part] = made_page(tmp_path, *write_methods(tmp_path, methods)).sections
    [first, _] = methods_table([m.result for m in methods], every_score=True).rows
    shown = [cell.text(2) for cell in first.cells[1:]]
    assert part["standings"]["overall"]["texts"][0] == shown
    assert shown[0] == "3.12"


@pytest.mark.parametrize(
    ("values", "marks"),
    [
        ([1.0, 2.0], ["best", ""]),
        ([1.001, 1.002, 3.0], ["best", "best", ""]),
        ([math.inf, 2.0, math.inf], ["", "best", ""]),  # the only finite one
        ([math.inf, math.inf], ["", ""]),
        ([1.0], [""]),  # by itself
        ([math.nan, 2.0, 3.0], ["", "best", ""]),
    ],
)
def test_stars(values: list[float], marks: list[str]) -> None:
    assert marks_of(ERROR, values) == marks


def test_scenes_and_groups_are_marked_too(tmp_path: Path) -> None:
    methods = [method("top", 100), method("close", 97), method("far", 40)]
    page = made_page(tmp_path, *write_methods(tmp_path, methods))
    [part] = page.sections
    for place, scene in enumerate(("east", "west")):
        made = compare(methods, [HIT], reference="best", scene=scene, resampling=ResamplingConfig())
        marks = [row[0] for row in part["standings"]["perScene"][place]["marks"]]
        assert marks[0] == "best"
        assert [mark != "" for mark in marks[1:]] == [p.p_holm > 0.05 for p in made.pairs]
    weather = next(found for found in part["breakdowns"] if found["by"] == "weather")
    view = page.unpack(weather["views"])[0][0]
    for group, name in enumerate(weather["labels"]):
        column = [view["values"][place][group] for place in range(3)]
        assert (view["marks"][0][group] == "best") is (column[0] == max(column)), name


def test_the_script_decides_nothing() -> None:
    script = "".join(path.read_text(encoding="utf-8") for path in SCRIPTS.glob("*.js"))
    for word in ("bestOf", "Math.max(...finite)", "Math.log10(value)", ".toFixed(", "#0072b2"):
        assert word not in script, word
    assert script.count("standings") >= 5


def p_text(value: float) -> str:
    return "<0.0001" if value < 1e-4 else f"{value:.4f}"


def test_pairs_are_those_of_compare(tmp_path: Path) -> None:
    methods = [method("top", 100), method("close", 97), method("far", 40)]
    page = made_page(tmp_path, *write_methods(tmp_path, methods))
    found = page.sections[0]["pairs"]
    pairs = page.unpack(found["pairs"])
    assert found["count"] == 3
    assert [len(later) for later in pairs] == [2, 1]
    with_best = compare(
        methods, [HIT, ERROR], reference="best", resampling=ResamplingConfig()
    ).pairs
    for place, pair in enumerate(with_best[:2]):
        shown = pairs[0][place][0]
        assert shown["difference"] == show_number(100 * pair.difference, 2, "+")
        assert shown["pHolm"] == p_text(pair.p_holm)
        assert shown["verdict"] == verdict(pair)
        assert (shown["verdict"] == "worse") == (pair.p_holm <= 0.05)
    # The mark and the pair say the same.
    marks = [row[0] for row in page.sections[0]["standings"]["overall"]["marks"]]
    assert [m == "tied" for m in marks[1:]] == [
        pairs[0][place][0]["verdict"] != "worse" for place in range(2)
    ]
    [middle] = compare(methods[1:], [HIT], reference="close", resampling=ResamplingConfig()).pairs
    assert pairs[1][0][0]["p"] == p_text(middle.test.p_value)


def test_one_method_has_no_pair_and_no_test(tmp_path: Path) -> None:
    [part] = made_page(tmp_path, *write_methods(tmp_path, [method("a", 5)])).sections
    assert part["pairs"] is None
    assert part["standings"]["note"] == ""
    assert part["standings"]["overall"]["marks"] == [["", ""]]


def test_what_would_take_too_long_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("airzoo_bench.report.standings._WORK", 3e7)
    methods = [method(f"m{n}", 100 - n) for n in range(6)]
    [part] = made_page(tmp_path, *write_methods(tmp_path, methods)).sections
    assert "no tests against the best: there are too many" in part["standings"]["note"]
    assert part["pairs"]["count"] == 2
    monkeypatch.setattr("airzoo_bench.report.standings._WORK", 1.0)
    [part] = made_page(tmp_path, *write_methods(tmp_path, methods)).sections
    assert part["pairs"] is None


def test_clouds_are_paired_by_scene(tmp_path: Path) -> None:
    methods = [reconstruction_method("a", 0, scenes=5), reconstruction_method("b", 1, scenes=5)]
    [part] = made_page(tmp_path, *write_methods(tmp_path, methods)).sections
    assert part["standings"]["overall"]["tested"]
    assert not any(scope["tested"] for scope in part["standings"]["perScene"])
    assert "nor are single scenes" in part["standings"]["note"]


def test_floors_stand_apart(tmp_path: Path) -> None:
    values = {"recall@1": 0.25}
    made = method("a", 5)
    floor = Reference(
        meaning="A random order.",
        scenes=dict.fromkeys(made.result.scenes, values),
        overall=values,
        pooled=values,
    )
    result = made.result.model_copy(update={"references": {"Chance level": floor}}).with_checksum()
    [part] = made_page(
        tmp_path, *write_methods(tmp_path, [Scored("a", result, made.records), method("b", 9)])
    ).sections
    [found] = part["references"]
    assert (found["name"], found["meaning"]) == ("Chance level", "A random order.")
    assert found["overall"] == {"values": [0.25, None], "texts": ["25.00", "–"]}
    assert len(part["methods"]) == 2
