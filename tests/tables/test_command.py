"""``airzoo-bench table`` by its options, and the layouts behind it."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.results.result import Reference, Result, write_result
from airzoo_bench.tables.layouts import (
    benchmarks_layout,
    method_table,
    scenes_layout,
    scenes_table,
    with_floors,
)
from airzoo_bench.tables.marks import mark_best
from tests.statistics.support import made_method, small_result
from tests.support import run_main, write_predictions
from tests.tables.typeset import document, typeset

Show = Callable[..., list[dict[str, str]]]


def made(method: str, city: float, rural: float, *, shipped: bool = True, **parts: Any) -> Result:
    """Return a result of the paper's real benchmark, by the shipped protocol or another."""
    rates = {"City": round(20 * city), "Rural": round(20 * rural)}
    hits = {scene: {"recall@1": [1.0] * n + [0.0] * (20 - n)} for scene, n in rates.items()}
    protocol = load_protocol(shipped_protocols()["airzoo-real-retrieval"])
    prints = protocol.fingerprint if shipped else "x"
    result = made_method(hits, name=method, protocol=prints).result
    truth = result.truth.model_copy(update={"benchmark": "airzoo-real"})
    return result.model_copy(update={"truth": truth, **parts}).with_checksum()


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Write two results; the second is the better in City, the first in Rural and on average."""
    paths = [tmp_path / "Mine.json", tmp_path / "MegaLoc.json"]
    write_result(paths[0], made("Mine", 0.5, 0.5))
    write_result(paths[1], made("MegaLoc", 0.6, 0.25))
    return paths


@pytest.fixture
def show(capsys: pytest.CaptureFixture[str]) -> Show:
    """Return a function that prints a table as CSV and reads it."""

    def run(*arguments: object) -> list[dict[str, str]]:
        code = run_main("table", *arguments, "--format", "csv")
        out, said = capsys.readouterr()
        assert code == 0, said
        return list(csv.DictReader(io.StringIO(out)))

    return run


def test_one_result_by_scene() -> None:
    table = scenes_table(small_result(), methods=method_table([small_result()], wanted=None))
    assert table.texts() == [
        ["Scene", "3", "30.00", "inf"],
        ["Average", "–", "30.00", "inf"],
        ["Pooled", "3", "30.00", "inf"],
    ]
    assert [column.heading for column in table.columns][2:] == ["R@1 [%] ↑", "Distance [m] ↓"]
    assert len(scenes_table(small_result()).columns) == 3
    assert "A note." in table.notes


def test_benchmarks_go_by_their_titles() -> None:
    board = method_table([small_result("m")])
    boards = [
        replace(board, benchmark=name, title=f"{name} v1") for name in ("airzoo-mini", "lake")
    ]
    for parts, titles in (
        (boards, ["AirZoo-Mini", "lake"]),
        ([boards[0], replace(boards[0], title="other v1")], ["airzoo-mini v1", "other v1"]),
    ):
        assert [column.group for column in benchmarks_layout(parts).columns] == ["", *titles]


def test_floors_are_set_apart_and_never_the_best() -> None:
    parts, mean = {"City": {"recall@1": 0.75}, "Rural": {"recall@1": 0.5}}, {"recall@1": 0.625}
    chance = Reference(meaning="of all orders.", scenes=parts, overall=mean, pooled=mean)
    results = [made(n, v, 0.25, references={"Chance": chance}) for n, v in (("a", 0.5), ("b", 0.2))]
    table = mark_best(scenes_layout(with_floors(method_table(results), results)))
    *own, floor = table.rows
    assert floor.floor
    assert floor.is_apart(own[-1])
    assert not any(cell.best for cell in floor.cells)
    best = [[cell.best for cell in row.cells[1:]] for row in own]
    assert best == [[True, True, True], [False, True, False]]
    for floors, shown in ((True, [("Chance", 62.5)]), (False, [])):
        rows = scenes_table(results[0], floors=floors).rows
        assert [(row.name, row.cells[2].value) for row in rows if row.floor] == shown


def test_scenes_and_published_numbers(files: list[Path], show: Show, capsys: Any) -> None:
    rows = show(*files, "--layout", "scenes")
    assert list(rows[0]) == ["Method", "City R@1", "Rural R@1", "Average R@1"]
    assert list(rows[1].values()) == ["MegaLoc", "60.00", "25.00", "42.50"]
    rows = show("airzoo-real-retrieval", "--published", "--layout", "scenes")
    assert list(rows[0])[:3] == ["Method", "City R@1", "City R@3"]
    assert [row["City R@1"] for row in rows] == ["0.62", "6.83", "21.12", "8.70", "9.94"]
    several = show("airzoo-real-retrieval", "uav-visloc-retrieval", "--published")
    assert {name.rpartition(" ")[0] for name in several[0]} >= {"AirZoo-Real", "UAV-VisLoc"}
    assert run_main("table", "airzoo-demo-retrieval", "--published") == 2
    assert "nothing is published on airzoo-demo-retrieval" in capsys.readouterr().err
    for one, said in (
        (made("Mine", 0.5, 0.5, shipped=False), "is not the shipped protocol"),
        (small_result(), "nothing is published on b (retrieval)"),
    ):
        write_result(files[0], one)
        assert run_main("table", files[0], "--published") == 0
        assert said in capsys.readouterr().out


def test_gains(files: list[Path], show: Show) -> None:
    rows = show(*files, "--baseline", "MegaLoc")
    assert [row["R@1 gain"] for row in rows] == ["7.50", ""]
    rows = show(*files, "--published", "--baseline", "SALAD", "--highlight", "Mine")
    assert [row["R@1 gain"] for row in rows] == [""] * 5 + ["42.64", ""]
    # Of two rows of one name, the one that was scored here.
    rows = show(*files, "--published", "--baseline", "MegaLoc (Ours)=MegaLoc")
    assert [row["R@1 gain"] for row in rows][4] == "-23.84"


def test_methods_of_one_name_share_a_row(tmp_path: Path, show: Show) -> None:
    paths = []
    for name, benchmark in (("Ours", "a"), ("Ours", "b"), ("Other", "b")):
        one = made(name, 0.5, 0.25)
        truth = one.truth.model_copy(update={"benchmark": benchmark})
        protocol = one.protocol.model_copy(update={"name": f"{benchmark}-protocol"})
        changes = {"truth": truth, "protocol": protocol}
        paths.append(tmp_path / f"{name} {benchmark}.json")
        write_result(paths[-1], one.model_copy(update=changes).with_checksum())
    rows = show(*paths, "--baseline", "Other")
    assert [list(row.values())[:4] for row in rows] == [
        ["Ours", "37.50", "37.50", "0.00"],
        ["Other", "–", "37.50", ""],
    ]


def test_a_document_with_everything(files: list[Path], tmp_path: Path, capsys: Any) -> None:
    keys = tmp_path / "refs.toml"
    keys.write_text('Mine = "me:2026,you"\n', encoding="utf-8")
    options = ["--layout", "scenes", "--published", "--baseline", "MegaLoc", "--highlight", "Mine"]
    options += ["--cite", "airzoo-paper", "--cite", str(keys), "--format", "latex"]
    assert run_main("table", *files, *options) == 0
    source = capsys.readouterr().out
    rows = [" ".join(row.split()) for row in typeset(document(source), tmp_path).splitlines()]
    assert "Mine [me:2026,you] 50.00 (−10.00) 50.00 (+25.00) 50.00 (+7.50)" in rows
    assert any(row.startswith("SALAD [izquierdo2024optimal]†") for row in rows), rows
    assert "% † reported, not re-scored: airzoo-paper" in source


def test_intervals(data: Path, tmp_path: Path, perfect: dict[str, Any], capsys: Any) -> None:
    perfect["ranked_ids"][0] = list(reversed(perfect["ranked_ids"][0]))
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    assert run_main("eval", "retrieval", path, "--out", tmp_path / "out") == 0

    def table(*options: str) -> Any:
        capsys.readouterr()
        assert run_main("table", tmp_path / "out", "--intervals", "--format", "json", *options) == 0
        return json.loads(capsys.readouterr().out)

    shown, own = table("--layout", "scenes"), table()
    place = [column.get("group") for column in shown["columns"]].index("Scene east")
    low, high = (shown["uncertainties"][0][place][key] for key in ("low", "high"))
    assert 0 < low < shown["rows"][0][place] < high < 100
    assert any(note.startswith("in square brackets: 95 % intervals") for note in shown["notes"])
    # Of one result, a row a scene.
    assert own["columns"][0]["title"] == "Scene"
    rows = {row[0]: spans for row, spans in zip(own["rows"], own["uncertainties"], strict=True)}
    assert rows["Scene east"][2] == shown["uncertainties"][0][place]
    assert rows["Pooled"] == [None] * len(own["columns"])
