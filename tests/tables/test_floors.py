"""Rows of what scores without a method: set apart, in italics, never the best."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.results.result import Reference, Result, write_result
from airzoo_bench.tables.best_marks import mark_best
from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.layouts import benchmarks_layout, scenes_layout, scenes_table
from airzoo_bench.tables.method_table import method_table
from airzoo_bench.tables.render import FORMATS, render
from airzoo_bench.tables.reported_rows import with_floors
from tests.statistics.support import made_method, write_method
from tests.support import run_main
from tests.tables.two_results import made
from tests.tables.typeset import bold_words, document, typeset

NAME, MEANING = "Chance level", "the mean over all orders of the gallery."


def chance(city: float, rural: float) -> Reference:
    mean = {"recall@1": (city + rural) / 2}
    scenes = {"City": {"recall@1": city}, "Rural": {"recall@1": rural}}
    return Reference(meaning=MEANING, scenes=scenes, overall=mean, pooled=mean)


def scored(method: str, city: float, rural: float, **parts: Any) -> Result:
    scenes = {"City": {"recall@1": city}, "Rural": {"recall@1": rural}}
    return made(method, scenes, **({"references": {NAME: chance(0.75, 0.5)}} | parts))


def with_references(result: Result, references: dict[str, Reference]) -> Result:
    return result.model_copy(update={"references": references}).with_checksum()


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"{name}.json" for name in ("Mine", "Poor")]
    for path, city in zip(paths, (0.5, 0.25), strict=True):
        write_result(path, scored(path.stem, city, 0.25))
    return paths


def test_one_result_says_how_to_get_them(
    files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("table", files[0]) == 0
    assert f"not shown: {NAME}; --floors adds it" in capsys.readouterr().out
    assert run_main("table", files[0], "--floors") == 0
    assert "--floors" not in capsys.readouterr().out


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_shows_them(
    form: str, files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("table", *files, "--format", form) == 0
    out, said = capsys.readouterr()
    assert MEANING.rstrip(".") not in out + said
    assert run_main("table", *files, "--floors", "--format", form) == 0
    out, said = capsys.readouterr()
    assert NAME in out
    assert "62.50" in out or "62.5" in out
    assert f"{NAME}: {MEANING}" in (out + said).replace(r" \\ ", " ")


def test_how_formats_set_them_apart(files: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    def shown(form: str) -> str:
        assert run_main("table", *files, "--floors", "--format", form) == 0
        return capsys.readouterr().out

    assert "| *Chance level* | *62.50* |" in shown("markdown")
    assert '<tr class="floor">' in shown("html")
    assert "<em>62.50</em>" in shown("html")
    assert "Chance level,62.50,what scores without a method" in shown("csv")
    assert json.loads(shown("json"))["floors"] == [False, False, True]
    page = shown("latex")
    assert r"\textit{\color{gray}62.50}" in page
    assert r"\usepackage[table]{xcolor}" in page.splitlines()[0]


def test_they_are_never_the_best_nor_second() -> None:
    results = [scored("Mine", 0.5, 0.25), scored("Poor", 0.25, 0.25)]
    table = mark_best(scenes_layout(with_floors(method_table(results), results)), second=True)
    *own, floor = table.rows
    assert floor.floor
    assert floor.is_apart(own[-1])
    assert not any(cell.best or cell.second for cell in floor.cells)
    assert [[cell.best for cell in row.cells[1:]] for row in own] == [
        [True, True, True],
        [False, True, False],
    ]


def test_gains_are_of_methods(files: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--floors", "--baseline", NAME, "--format", "csv")
    assert run_main("table", *files, *options) == 0
    rows = [line.split(",")[:3] for line in capsys.readouterr().out.splitlines()[1:]]
    assert rows == [["Mine", "37.50", "-25.00"], ["Poor", "25.00", "-37.50"], [NAME, "62.50", ""]]


def test_one_result_by_scene() -> None:
    rows = scenes_table(scored("Mine", 0.5, 0.25), floors=True).rows
    found = [(row.cells[0].value, row.cells[2].value) for row in rows if row.floor]
    assert found == [
        (NAME, 62.5),
        ("in City", 75.0),
        ("in Rural", 50.0),
    ]
    assert not any(row.floor for row in scenes_table(scored("Mine", 0.5, 0.25)).rows)


def test_a_score_without_a_floor_stays_empty() -> None:
    result = scored("Mine", 0.5, 0.25)
    board = with_floors(method_table([result], every_score=True), [result])
    assert [cell.value for cell in scenes_layout(board).rows[-1].cells] == [
        *(NAME, 75.0, None, 50.0, None, 62.5, None)
    ]
    shown = scenes_table(result, floors=True, every_score=True).rows[-1]
    assert [cell.value for cell in shown.cells[2:]] == [50.0, None]


def test_across_benchmarks_they_are_last() -> None:
    results = [scored("Mine", 0.5, 0.25), scored("Yours", 0.25, 0.25)]
    boards = [with_floors(method_table([result]), [result]) for result in results]
    rows = benchmarks_layout(boards).rows
    assert [row.cells[0].value for row in rows] == ["Mine", "Yours", NAME]
    assert [cell.value for cell in rows[-1].cells[1:]] == [62.5, 62.5]


def test_results_that_hold_others_or_none() -> None:
    one, other = scored("Mine", 0.5, 0.25), scored("Poor", 0.25, 0.25)
    none = scored("Old", 0.25, 0.25, references={})
    odd = scored("Odd", 0.25, 0.25, references={NAME: chance(0.75, 0.51)})
    board = with_floors(method_table([one, none, other]), [one, none, other])
    assert [entry.method for entry in board.rows] == ["Mine", "Old", "Poor", NAME]
    assert not any("differs" in note for note in board.notes)
    board = with_floors(method_table([one, odd]), [one, odd])
    assert f"{NAME} of Odd differs from the one that is shown" in board.notes
    board = with_floors(method_table([none]), [none])
    assert board.notes == ("no floors: these results hold none, as those of older versions",)


def test_on_a_page(tmp_path: Path) -> None:
    results = [scored("Mine", 0.5, 0.25), scored("Poor", 0.25, 0.25)]
    table = mark_best(scenes_layout(with_floors(method_table(results), results)))
    text = typeset(document(latex(table)), tmp_path)
    assert text.split().count("62.50") == 1
    assert f"{NAME}: {MEANING}" in " ".join(text.split())
    assert "62.50" not in bold_words(tmp_path)


def test_a_terminal_shows_them_in_grey() -> None:
    result = scored("Mine", 0.5, 0.25)
    table = scenes_layout(with_floors(method_table([result]), [result]))
    line = next(r for r in render(table, "terminal", styled=True).splitlines() if NAME in r)
    assert "\x1b[3;90m" in line


def test_why_they_have_no_interval(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = {scene: {"recall@1": [1.0, 0.0] * 4} for scene in ("City", "Rural")}
    paths = []
    for name in ("one", "two"):
        method = made_method(rows, name=name)
        changed = replace(method, result=with_references(method.result, {NAME: chance(0.5, 0.5)}))
        paths.append(write_method(tmp_path / name, changed))
    said = f"no interval for {NAME}: intervals are of methods"
    for results in (paths, paths[:1]):
        assert run_main("table", *results, "--intervals", "--floors") == 0
        out = capsys.readouterr().out
        assert out.count(said) == 1
        assert ("no interval for Pooled: intervals are of scenes" in out) == (len(results) == 1)
        assert run_main("table", *results, "--intervals") == 0
        assert said not in capsys.readouterr().out


def test_published_numbers_alone_have_none(capsys: pytest.CaptureFixture[str]) -> None:
    command = ("table", "--published", "--protocol", "uav-visloc-retrieval", "--floors")
    assert run_main(*command) == 2
    assert "--floors needs results" in capsys.readouterr().err
