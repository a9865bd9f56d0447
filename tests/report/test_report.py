"""The report as a file: its numbers are those of tables and `compare`, and what bad input gets."""

from __future__ import annotations

import base64
import hashlib
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import BenchmarkError, ResultError
from airzoo_bench.core.registry import load_track
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.report.numbers import (
    TIED,
    find,
    meaning,
    pair_panes,
    plan_of,
    scene_panes,
    summary_panes,
)
from airzoo_bench.report.packing import page_json
from airzoo_bench.report.queries import hardest_rows
from airzoo_bench.report.sections import Section, read_sections
from airzoo_bench.results.comparison import compare, score_intervals
from airzoo_bench.results.records import Method
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.model import Row, Table
from tests.report.made import (
    HOSTILE,
    made_page,
    of_benchmark,
    reconstruction_method,
    retrieval_method,
    run,
    write_methods,
    write_photo_results,
)
from tests.statistics.support import ERROR, HIT, made_result

PLAN = ResamplingConfig()


def method(name: str, hits: int, of: int = 200) -> Method:
    """Return a method on two scenes that answers so many queries, the first ones."""
    made = retrieval_method(name, 0, queries=of)
    hit = np.arange(of) < hits
    changes = {"recall@1": hit.astype(float), "error_m": np.where(hit, 1.0, np.inf)}
    records = made.records.assign(**changes, first_hit_rank=hit.astype(int))
    settings = made.result.protocol.settings
    return Method(name, made_result(records, (HIT, ERROR), name, settings=settings), records)


def tables_of(section: Section) -> dict[str, Table]:
    return {pane.key: pane.tables[0] for pane in summary_panes(section, find(section))}


def marks(row: Row) -> list[str]:
    return ["★" if cell.best else cell.mark for cell in row.cells[1:]]


def test_tables_hold_the_texts_of_results_the_best_first(tmp_path: Path) -> None:
    # 1 of 32 is 3.125 %, which Python and JavaScript round to different sides.
    methods = [method("none", 0, 32), method("one", 1, 32)]
    page = made_page(tmp_path, *write_methods(tmp_path, methods))
    rows = page.table("part1-summary")
    assert [row[0].strip() for row in rows[1:]] == ["one", "none"]
    assert rows[1][1].startswith("★3.12")
    titles = [title for title, _ in page.tables["part1-summary"]]
    assert titles == ["Average over scenes", "All queries pooled", "East", "West"]


def test_marks_and_pairs_are_those_of_compare() -> None:
    methods = [method("top", 100), method("close", 97), method("far", 40)]
    section = Section(methods)
    tables = tables_of(section)
    made = compare(methods, [HIT, ERROR], reference="best", resampling=PLAN).pairs
    tied = [TIED * (pair.test.p_value > 0.05) for pair in made[:2]]
    assert [marks(row)[0] for row in tables["overall"].rows] == ["★", *tied] == ["★", TIED, ""]
    assert {marks(row)[0] for row in tables["pooled"].rows} == {"★", ""}  # not tested
    [scenes, _] = scene_panes(section, summary_panes(section, find(section)))
    for scene, row in zip(("east", "west"), scenes.tables[0].rows, strict=True):
        of_scene = compare(methods, [HIT], reference="best", scene=scene, resampling=PLAN).pairs
        assert [m != "" for m in marks(row)[1:]] == [pair.test.p_value > 0.05 for pair in of_scene]
    pairs = pair_panes(section)
    assert [pane.key for pane in pairs] == ["0 1", "0 2", "1 2"]
    cells = [pane.tables[0].rows[0].cells for pane in pairs]
    assert cells[0][5].value == pytest.approx(100 * made[0].difference)
    assert [c[7].value for c in cells[:2]] == [pair.test.p_value for pair in made[:2]]
    [middle] = compare(methods[1:], [HIT], reference="close", resampling=PLAN).pairs
    assert cells[2][6].value == middle.test.p_value
    assert [len(pane.tables[1].rows) for pane in pairs] == [3, 10, 10]
    assert pair_panes(Section(methods[:1])) == []


def test_intervals_are_those_of_compare_and_left_out_where_they_take_too_long() -> None:
    methods = [retrieval_method("a", 1), retrieval_method("b", 0)]
    tables = tables_of(Section(methods))
    for place, one in enumerate(methods):
        found = score_intervals(one, one.result.columns[:1], PLAN)
        for scope, interval in (("overall", found.overall[0]), ("west", found.groups["west"][0])):
            shown = tables[scope].rows[place].cells[1].uncertainty
            assert shown == pytest.approx((100 * interval.low, 100 * interval.high))
    many = Section([methods[0]] * 300)
    assert plan_of(many) is None
    assert len(find(many).notes) == 1
    assert pair_panes(many) == []


def test_a_page_has_the_same_bytes_again_and_nothing_gets_out_of_its_text(tmp_path: Path) -> None:
    methods = [retrieval_method(HOSTILE, 1), retrieval_method("b", 0)]
    paths = write_methods(tmp_path, methods)
    page = made_page(tmp_path, *paths)
    assert made_page(tmp_path, *paths).text == page.text
    queries = page.parts[0]["queries"]
    assert page.unpack(queries["ids"]) == methods[0].records["query"].tolist()
    hits, errors = queries["scores"]
    for packed, key, write in (
        (hits, "recall@1", lambda v: "✓ hit" if v else "✗ miss"),
        (errors, "error_m", lambda v: f"{v:.2f}"),
    ):
        texts, codes = page.unpack(packed["texts"]), page.unpack(packed["codes"]).reshape(2, -1)
        for row, one in enumerate(methods):
            assert [texts[code] for code in codes[row]] == [*map(write, one.records[key])]
            # Codes are in the order of the values, by which the script sorts.
            assert (np.diff(codes[row][np.argsort(one.records[key])].astype(int)) >= 0).all()
    assert page.parts[0]["methods"] == [HOSTILE, "b"]
    scripts = re.findall(r"<script[^>]*>", page.text)
    assert len(scripts) == len(re.findall("</script>", page.text)) == len(page.blobs) + 2
    assert "<img src=x" not in page.text
    ends = {"<", ">", "&", "\u2028", "\u2029"}
    assert not ends & set(page_json({"a": [*ends, np.inf, np.nan]}))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page.text)
    script = re.search(r"<script>(.*)</script>", page.text, re.DOTALL)
    assert policy
    assert script
    digest = base64.b64encode(hashlib.sha256(script[1].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy[1]
    assert policy[1].startswith("default-src 'none'; img-src data:;")
    addresses = re.findall(r'<[^>]*(?:src|href)="([^"]*)"', page.text.partition("page-data")[0])
    assert all(address.startswith(("data:", "#")) for address in addresses)


def test_parts_are_of_one_protocol_benchmark_by_benchmark(tmp_path: Path) -> None:
    methods = [
        reconstruction_method("cloud", 0),
        of_benchmark(retrieval_method("x", 3, truth="x" * 64), "other"),
        retrieval_method("a", 0),
        retrieval_method("a", 1),
    ]
    paths = write_methods(tmp_path, methods)
    page = made_page(tmp_path, *paths)
    names = ["a (retrieval3)", "a (retrieval2)"]  # of one name, told apart
    assert [part["methods"] for part in page.parts] == [names, ["cloud"], ["x"]]
    assert [row[0].strip() for row in page.table("overview")[1:]] == ["made v1"] * 3
    assert page.parts[1]["queries"] is None
    records = paths[1].with_name("records.csv")
    records.write_text(records.read_text().replace("sunny", "foggy"))
    done = run("report", paths[1], "-o", tmp_path / "r.html")
    assert isinstance(done.exception, ResultError)


def test_every_score_of_every_protocol_has_a_meaning() -> None:
    for path in shipped_protocols().values():
        protocol = load_protocol(path)
        for score in load_track(protocol.track).scores(protocol):
            assert meaning(protocol.track, score), (protocol.name, score.key)


def test_the_hardest_queries_are_worst_on_average_then_by_error_and_no_hits() -> None:
    methods = [retrieval_method("a", 0, 8), retrieval_method("b", 1, 8)]
    hits = np.array([[1, 0, 0, 1, 0, 1, 1, 1], [0, 0, 0, 0, 0, 1, 1, 1]], float)
    errors = [[1, 5, 9, 1, np.inf, 1, 1, 1], [1, 5, 9, 2, 1, 1, 1, 1]]
    made = [
        Method(one.name, one.result, one.records.assign(**{"recall@1": hit, "error_m": error}))
        for one, hit, error in zip(methods, hits, errors, strict=True)
    ]
    # Rows 1, 2, 4 are missed by both; by rank of error 2 leads, then 1, then 4; 3 leads 0.
    assert hardest_rows(Section(made), 8).tolist() == [2, 1, 4, 3, 0]
    # By the mean error row 0 would lead, and infinite means would tie; by the mean place row 2.
    by_error = [
        Method(name, made_result(records, (ERROR,), name), records)
        for name, values in (("a", [900.0, 5, 40, 1]), ("b", [1.0, 2, 30, np.inf]))
        for records in [pd.DataFrame({"scene": "s", "query": list("wxyz"), "error_m": values})]
    ]
    assert hardest_rows(Section(by_error), 4).tolist() == [2, 0, 3, 1]


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    return write_photo_results(tmp_path_factory.mktemp("photos"), ["first", "second"])


def test_a_folder_adds_maps_and_pictures(photos: tuple[Path, list[Path]], tmp_path: Path) -> None:
    data, results = photos
    page = made_page(tmp_path, *results, "--data", data, "--pictures", 3)
    [found] = page.parts[0]["maps"]
    assert page.data["pictures"][found["picture"]].startswith("data:image/jpeg;base64,")
    assert found["metresPerPixel"] == pytest.approx(1, rel=1e-2)
    outlines = page.unpack(found["outlines"]).reshape(-1, 4, 2) / found["stepsPerPixel"]
    # A photo sees 100 m x 75 m, and its anchors stand a sixteenth inside.
    sides = outlines.max(axis=1) - outlines.min(axis=1)
    np.testing.assert_allclose(sides, np.tile([87.5, 65.6], (30, 1)), atol=1)
    tiles, codes = page.unpack(found["tiles"]), page.unpack(found["ranked"]).reshape(5, 2, -1)
    tiles.append("")  # of the query without an answer
    bits, answers = page.unpack(found["hits"]).reshape(2, -1), positives(data)
    for row, one in enumerate(read_sections(results)[0].methods):
        for rank in range(5):
            named = one.records[f"tile@{rank + 1}"].fillna("").tolist()
            assert [tiles[code] for code in codes[rank, row]] == named
            pairs = zip(one.records["query"], named, strict=True)
            assert (bits[row] >> rank & 1).tolist() == [t in answers[q] for q, t in pairs]
    cards = [name for name in page.images if name.startswith("part1-hardest")]
    assert len(cards) == 2 + 2 * 7
    assert cards[:2] == ["part1-hardest photo", "part1-hardest true place"]


def positives(data: Path) -> dict[str, set[str]]:
    """Read which tiles answer each query straight from the folder's files."""
    [home] = (data / "park" / "scenes").iterdir()
    tiles = pd.read_parquet(home / "retrieval" / "tiles.parquet")["id"].to_numpy()
    queries = sorted(pd.read_csv(home / "queries.csv")["id"])
    with np.load(home / "retrieval" / "positives.npz") as file:
        parts = np.split(file["tiles"], file["offsets"][1:-1])
    return {query: set(tiles[part]) for query, part in zip(queries, parts, strict=True)}


def test_what_is_not_there_is_left_out_and_a_wrong_folder_is_refused(
    photos: tuple[Path, list[Path]], tmp_path: Path
) -> None:
    data, results = photos
    folder = data.parent / "sources" / "photos"
    folder.rename(folder.with_name("moved"))
    try:
        page = made_page(tmp_path, results[0], "--data", data, "--pictures", 2)
    finally:
        folder.with_name("moved").rename(folder)
    assert "part1-hardest photo" not in page.images
    assert "part1-hardest true place" in page.images
    paths, out = write_methods(tmp_path, [retrieval_method("a", 0)]), tmp_path / "refused.html"
    assert made_page(tmp_path, *paths).parts[0]["maps"] == []
    done = run("report", *paths, "--data", data, "-o", out)
    assert isinstance(done.exception, BenchmarkError)
    assert not out.exists()
