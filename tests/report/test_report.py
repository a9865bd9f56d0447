"""The report as a file: its numbers are those of tables and `compare`, and what bad input gets."""

from __future__ import annotations

import base64
import hashlib
import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError, ResultError
from airzoo_bench.matching.metrics import matching_scores
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.reconstruction.track import reconstruction_scores
from airzoo_bench.report.numbers import (
    find,
    marks_of,
    meaning,
    pair_panes,
    scene_panes,
    summary_panes,
)
from airzoo_bench.report.packing import Blobs, page_json
from airzoo_bench.report.queries import hardest_rows
from airzoo_bench.report.sections import Section, read_sections
from airzoo_bench.results.comparison import compare, score_intervals
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Reference, score_columns
from airzoo_bench.retrieval.scoring import list_scores
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.layouts import methods_table
from tests.report.made import (
    HOSTILE,
    Page,
    made_page,
    of_benchmark,
    reconstruction_method,
    retrieval_method,
    run,
    write_methods,
    write_photo_results,
)
from tests.statistics.support import ERROR, HIT, made_result


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


def test_tables_hold_the_texts_of_results_the_best_first(tmp_path: Path) -> None:
    # 1 of 32 is 3.125 %, which Python and JavaScript round to different sides.
    methods = [method("none", 0, 32), method("one", 1, 32)]
    page = made_page(tmp_path, *write_methods(tmp_path, methods))
    rows = page.table("part1-summary")
    assert [row[0] for row in rows[1:]] == ["one", "none"]
    shown = methods_table([methods[1].result], every_score=True).rows[0].cells[1:]
    assert rows[1][1].lstrip("★").startswith(shown[0].text(2))
    assert shown[0].text(2) == "3.12"
    assert page.tables["part1-summary"][1][0].startswith("All queries pooled")
    assert page.tables["part1-summary"][2][0].startswith("East")


def test_marks_and_pairs_are_those_of_compare() -> None:
    methods = [method("top", 100), method("close", 97), method("far", 40)]
    section = Section(methods)
    found = find(section)
    panes = {pane.key: pane.grids[0] for pane in summary_panes(section, found)}
    marks = [line.cells[1].mark for line in panes["overall"].rows]
    assert marks == ["best", "tied", ""]
    made = compare(methods, [HIT, ERROR], reference="best", resampling=ResamplingConfig()).pairs
    assert [mark == "tied" for mark in marks[1:]] == [pair.p_holm > 0.05 for pair in made[:2]]
    # What is not tested has a star, and nothing that looks like a test.
    assert {line.cells[1].mark for line in panes["pooled"].rows} == {"best", ""}
    assert "not tested" in panes["pooled"].caption
    for scene, place in (("east", 0), ("west", 1)):
        other = compare(
            methods, [HIT], reference="best", scene=scene, resampling=ResamplingConfig()
        )
        row = scene_panes(section, found)[0].grids[0].rows[place].cells[2:]
        assert [c.mark != "" for c in row[1:]] == [p.p_holm > 0.05 for p in other.pairs]
    pairs = pair_panes(section)
    assert [pane.key for pane in pairs] == ["0 1", "0 2", "1 2"]
    texts = [cell.text for cell in pairs[0].grids[0].rows[0].cells]
    assert texts[3] == f"{100 * made[0].difference:+.2f}"
    assert texts[6] == f"{made[0].p_holm:.4f}"
    differing = pairs[0].grids[1].rows
    assert 0 < len(differing) <= 10
    [middle] = compare(methods[1:], [HIT], reference="close", resampling=ResamplingConfig()).pairs
    shown = [cell.text for cell in pairs[2].grids[0].rows[0].cells][5]
    assert shown == ("<0.0001" if middle.test.p_value < 1e-4 else f"{middle.test.p_value:.4f}")


@pytest.mark.parametrize(
    ("values", "marks"),
    [
        ([1.001, 1.002, 3.0], ["best", "best", ""]),
        ([math.inf, 2.0, math.inf], ["", "best", ""]),  # the only finite one
        ([math.inf, math.inf], ["", ""]),
        ([1.0], [""]),  # by itself
        ([math.nan, 2.0, 3.0], ["", "best", ""]),
    ],
)
def test_stars(values: list[float], marks: list[str]) -> None:
    assert marks_of(ERROR, values) == marks


def test_intervals_are_those_of_compare() -> None:
    methods = [retrieval_method("a", 1), retrieval_method("b", 0)]
    section = Section(methods)
    panes = {pane.key: pane.grids[0] for pane in summary_panes(section, find(section))}
    for place, one in enumerate(methods):
        found = score_intervals(one, one.result.columns[:1], ResamplingConfig())
        for scope, interval in (("overall", found.overall[0]), ("west", found.groups["west"][0])):
            text = f"{100 * interval.low:.2f} to {100 * interval.high:.2f}"
            assert panes[scope].rows[place].cells[1].interval == text


def test_what_would_take_too_long_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("airzoo_bench.report.numbers._WORK", 3e7)
    section = Section([method(f"m{n}", 100 - n) for n in range(6)])
    found = find(section)
    assert found.tests == {}
    assert any("no tests" in note for note in found.notes)
    assert [pane.key for pane in pair_panes(section)] == ["0 1"]
    monkeypatch.setattr("airzoo_bench.report.numbers._WORK", 1.0)
    assert pair_panes(section) == []
    assert pair_panes(Section([method("a", 5)])) == []


def test_floors_stand_apart_without_marks() -> None:
    values, made = {"recall@1": 0.25}, method("a", 5)
    floor = Reference(
        meaning="A random order.",
        scenes=dict.fromkeys(made.result.scenes, values),
        overall=values,
        pooled=values,
    )
    result = made.result.model_copy(update={"references": {"Chance level": floor}})
    section = Section([Scored("a", result, made.records), method("b", 9)])
    last = summary_panes(section, find(section))[0].grids[0].rows[-1]
    assert last.floor
    assert [cell.text for cell in last.cells] == ["Chance level", "25.00", "–"]
    assert {cell.mark for cell in last.cells} == {""}


def test_packed_queries_are_those_of_records_and_bytes_are_the_same_again(tmp_path: Path) -> None:
    methods = [retrieval_method("a", 1), retrieval_method("b", 0)]
    paths = write_methods(tmp_path, methods)
    page = made_page(tmp_path, *paths)
    assert made_page(tmp_path, *paths).text == page.text
    queries = page.parts[0]["queries"]
    assert page.unpack(queries["ids"]) == methods[0].records["query"].tolist()
    hits, errors = queries["scores"]
    codes = page.unpack(hits["codes"]).reshape(2, -1)
    texts = page.unpack(errors["texts"])
    shown = page.unpack(errors["codes"]).reshape(2, -1)
    for row, one in enumerate(methods):
        np.testing.assert_array_equal(codes[row] == hits["hit"], one.records["recall@1"] == 1)
        written = [f"{value:.2f}" for value in one.records["error_m"]]
        assert [texts[code] for code in shown[row]] == written
        # Codes are in the order of the values, by which the script sorts.
        assert (np.diff(shown[row][np.argsort(one.records["error_m"])]) >= 0).all()


def test_parts_are_of_one_protocol_benchmark_by_benchmark(tmp_path: Path) -> None:
    methods = [
        reconstruction_method("cloud", 0),
        of_benchmark(retrieval_method("x", 3, truth="x" * 64), "other"),
        retrieval_method("b", 0),
        retrieval_method("a", 1),
    ]
    page = made_page(tmp_path, *write_methods(tmp_path, methods))
    assert [part["methods"] for part in page.parts] == [["a", "b"], ["cloud"], ["x"]]
    names = [row[0] for row in page.table("overview")[1:]]
    assert [name.split(" (")[0] for name in names] == [
        "made, retrieval",
        "made, reconstruction",
        "other, retrieval",
    ]
    assert page.parts[1]["queries"] is None


def test_every_score_of_every_protocol_has_a_meaning() -> None:
    for path in shipped_protocols().values():
        protocol = load_protocol(path)
        if isinstance(protocol, RetrievalProtocol):
            scores = list_scores(protocol.scores)
        elif isinstance(protocol, MatchingProtocol):
            scores = matching_scores(protocol.scores)
        else:
            scores = reconstruction_scores(protocol.scores)
        for score in score_columns(scores):
            assert meaning(protocol.track, score), (protocol.name, score.key)
    assert meaning("retrieval", ERROR) == meaning("", HIT) == ""


def test_methods_of_the_same_name_are_told_apart(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [retrieval_method("a", 1), retrieval_method("a", 0)])
    names = [section.name for section in read_sections(paths)[0].methods]
    assert names == ["a (retrieval0)", "a (retrieval1)"]


def test_records_that_were_changed_are_refused(tmp_path: Path) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("a", 0)])
    records = path.with_name("records.csv")
    records.write_text(records.read_text().replace("sunny", "foggy"))
    done = run("report", path, "-o", tmp_path / "r.html")
    assert isinstance(done.exception, ResultError)


def test_the_hardest_queries_are_worst_on_average_then_by_error_and_no_hits() -> None:
    methods = [retrieval_method("a", 0, 8), retrieval_method("b", 1, 8)]
    hits = [[1, 0, 0, 1, 0, 1, 1, 1], [0, 0, 0, 0, 0, 1, 1, 1]]
    errors = [[1, 5, 9, 1, np.inf, 1, 1, 1], [1, 5, 9, 2, 1, 1, 1, 1]]
    made = [
        Scored(
            one.name,
            one.result,
            one.records.assign(**{"recall@1": np.array(hit, float), "error_m": error}),
        )
        for one, hit, error in zip(methods, hits, errors, strict=True)
    ]
    # Rows 1, 2, 4 are missed by both; by rank of error 2 leads, then 1, then 4; 3 leads 0.
    assert hardest_rows(Section(made), 8).tolist() == [2, 1, 4, 3, 0]
    # By the mean error row 0 would lead, and infinite means would tie; by the mean place row 2.
    by_error = [
        Scored(name, made_result(records, (ERROR,), name), records)
        for name, values in (("a", [900.0, 5, 40, 1]), ("b", [1.0, 2, 30, np.inf]))
        for records in [pd.DataFrame({"scene": "s", "query": list("wxyz"), "error_m": values})]
    ]
    assert hardest_rows(Section(by_error), 4).tolist() == [2, 0, 3, 1]


def test_nothing_hostile_gets_out_of_its_text(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [retrieval_method(HOSTILE, 0)])
    page = made_page(tmp_path, *paths)
    assert page.parts[0]["methods"] == [HOSTILE]
    scripts = re.findall(r"<script[^>]*>", page.text)
    assert len(scripts) == len(re.findall("</script>", page.text)) == len(page.blobs) + 2
    assert "<img src=x" not in page.text
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page.text)
    script = re.search(r"<script>(.*)</script>", page.text, re.DOTALL)
    assert policy
    assert script
    digest = base64.b64encode(hashlib.sha256(script[1].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy[1]
    assert policy[1].startswith("default-src 'none'; img-src data:;")
    addresses = re.findall(r'<[^>]*(?:src|href)="([^"]*)"', page.text.partition("page-data")[0])
    assert all(address.startswith(("data:", "#")) for address in addresses)


def test_many_values_are_packed_by_four_digits() -> None:
    blobs = Blobs()
    values = np.random.default_rng(0).exponential(60, 20_000)
    values[:3] = (np.inf, np.nan, 0.0)
    found: list[np.ndarray] = []
    packed = blobs.numbers(values, lambda different: found.append(different) or [])
    assert packed["codes"]["type"] == "<u2"
    codes = np.frombuffer(Page.unpack_text(blobs.texts[packed["codes"]["blob"]]), "<u2")
    np.testing.assert_allclose(found[0][codes][2:], values[2:], rtol=5.01e-4)
    assert codes[1] == packed["missing"]
    assert found[0][codes[0]] == np.inf


@given(st.text(max_size=30))
def test_page_json_ends_no_element(text: str) -> None:
    made = page_json({"a": [text, float("inf"), float("nan")]})
    assert not {"<", ">", "&", "\u2028", "\u2029"} & set(made)


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    return write_photo_results(tmp_path_factory.mktemp("photos"), ["first", "second"])


def test_a_folder_adds_maps_tiles_and_pictures(
    photos: tuple[Path, list[Path]], tmp_path: Path
) -> None:
    data, results = photos
    page = made_page(tmp_path, *results, "--data", data, "--pictures", 3)
    [part] = page.parts
    [found] = part["maps"]
    assert page.data["pictures"][found["picture"]].startswith("data:image/jpeg;base64,")
    assert found["metresPerPixel"] == pytest.approx(1, rel=1e-2)
    outlines = page.unpack(found["outlines"]).reshape(-1, 4, 2) / found["stepsPerPixel"]
    # A photo sees 100 m x 75 m, and its anchors stand a sixteenth inside.
    sides = outlines.max(axis=1) - outlines.min(axis=1)
    np.testing.assert_allclose(sides, np.tile([87.5, 65.6], (30, 1)), atol=1)
    tiles, codes = page.unpack(found["tiles"]), page.unpack(found["ranked"]).reshape(5, 2, -1)
    bits, answers = page.unpack(found["hits"]).reshape(2, -1), positives(data)
    for row, one in enumerate(read_sections(results)[0].methods):
        for rank in range(5):
            named = one.records[f"tile@{rank + 1}"].tolist()
            assert [tiles[code] for code in codes[rank, row]] == named
            pairs = zip(one.records["query"], named, strict=True)
            assert (bits[row] >> rank & 1).tolist() == [t in answers[q] for q, t in pairs]
    cards = [name for name in page.images if name.startswith("part1-hardest")]
    assert len(cards) == 3 * 7
    assert cards[:2] == ["part1-hardest photo", "part1-hardest the place on the map"]


def positives(data: Path) -> dict[str, set[str]]:
    """Read which tiles answer each query straight from the folder's files."""
    [home] = (data / "park" / "scenes").iterdir()
    tiles = pd.read_parquet(home / "retrieval" / "tiles.parquet")["id"].to_numpy()
    queries = sorted(pd.read_csv(home / "queries.csv")["id"])
    with np.load(home / "retrieval" / "positives.npz") as file:
        ends, indices = file["offsets"][1:-1], file["tiles"]
    parts = np.split(indices, ends)
    return {query: set(tiles[part]) for query, part in zip(queries, parts, strict=True)}


def test_pictures_that_do_not_fit_or_are_gone_are_left_out(
    photos: tuple[Path, list[Path]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, results = photos
    folder = data.parent / "sources" / "photos"
    folder.rename(folder.with_name("moved"))
    try:
        page = made_page(tmp_path, *results, "--data", data, "--pictures", 2)
    finally:
        folder.with_name("moved").rename(folder)
    assert "part1-hardest photo" not in page.images
    assert "part1-hardest the place on the map" in page.images
    monkeypatch.setattr("airzoo_bench.report.queries._PICTURES_BYTES", 10)
    done = run("report", *results, "--data", data, "--pictures", 2, "-o", tmp_path / "r.html")
    assert "no pictures of 2 of the 2 hardest queries of park-retrieval" in done.stderr


def test_without_the_folder_there_are_no_maps_and_a_wrong_one_is_refused(
    photos: tuple[Path, list[Path]], tmp_path: Path
) -> None:
    methods = [retrieval_method("a", 0), reconstruction_method("b", 0)]
    paths = write_methods(tmp_path, methods[:1])
    done = run("report", *paths, "-o", tmp_path / "r.html")
    assert done.exit_code == 0
    assert "no maps and pictures for made" in done.stderr
    # Reconstruction has no maps, and so nothing to look for: its place must not decide.
    other = of_benchmark(methods[1], "another")
    for asked in (methods[:1], [*methods[:1], other]):
        paths = write_methods(tmp_path, asked)
        out = tmp_path / "refused.html"
        done = run("report", *paths, "--data", photos[0], "-o", out)
        assert isinstance(done.exception, BenchmarkError)
        assert not out.exists()
