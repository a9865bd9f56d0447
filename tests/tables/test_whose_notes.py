"""Whose a note is: of a method, of several, of a board, of all; and which need not be said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.results.result import write_result
from airzoo_bench.tables.layouts import (
    benchmarks_layout,
    methods_layout,
    methods_table,
    scenes_table,
)
from airzoo_bench.tables.method_table import method_table
from tests.results.made import result
from tests.support import run_main


def test_equal_notes_of_methods_are_one() -> None:
    notes = {"one": ("A.",), "two": ("B.", "B."), "three": ("B.", "A.")}
    results = [result(m).model_copy(update={"notes": n}) for m, n in notes.items()]
    made = methods_table(results).notes
    assert made[:2] == ("one, three: A.", "two, three: B.")
    assert len(made) == 3


def test_equal_notes_of_all_benchmarks_are_one() -> None:
    bare = method_table([result("m").model_copy(update={"notes": ()})])
    boards = [replace(bare, title=title, identity="") for title in "abc"]
    boards[0] = boards[0].noted("said of all", "said of one")
    boards[1] = boards[1].noted("said of all", "reported", legend=True)
    boards[2] = boards[2].noted("said of all", "reported", legend=True)
    boards[0] = boards[0].noted("said of two")
    boards[2] = boards[2].noted("said of two")
    made = benchmarks_layout(boards).notes
    assert made[1:] == ("said of all", "a: said of one", "a, c: said of two", "reported")


def test_of_one_result_the_method_goes_without_saying(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_result(tmp_path / "r.json", result("Mine"))
    assert run_main("table", tmp_path / "r.json") == 0
    out = capsys.readouterr().out
    assert out.count("A note.") == 1
    assert "Mine: A note." not in out
    assert "A note." in scenes_table(result()).notes


@pytest.mark.parametrize(
    ("options", "is_said"),
    [
        (("--layout", "scenes"), True),
        (("--layout", "scenes", "--no-average"), False),
        (("--layout", "methods"), True),
        (("--layout", "methods", "--scene", "City"), False),
    ],
)
def test_another_average_is_told_of_where_one_is_shown(
    options: tuple[str, ...], is_said: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ("table", "--published", "--protocol", "airzoo-real-retrieval", *options)
    assert run_main(*command) == 0
    assert ("prints another average of" in capsys.readouterr().out) is is_said


def test_an_id_goes_before_a_title() -> None:
    one = result("one", **{"recall@1": 0.5})
    values = {"b": one.scenes["s"] | {"recall@1": 0.25}, "a": one.scenes["s"]}
    truth = one.truth.model_copy(update={"scene_titles": {"b": "a", "a": "A"}})
    counts = {scene: {"queries": 3} for scene in values}
    made = one.model_copy(update={"scenes": values, "truth": truth, "counts": counts})
    shown = methods_layout(method_table([made]), "a")
    assert shown.texts() == [["one", "50.00"]]
    assert shown.title == "p v1, A"
    assert methods_layout(method_table([made]), "b").texts() == [["one", "25.00"]]
    with pytest.raises(ResultError, match="no scene 'B' in the results"):
        methods_layout(method_table([made]), "B")
