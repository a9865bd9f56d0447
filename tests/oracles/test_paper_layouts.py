"""The paper's own tables, rebuilt from its numbers, typeset by a real LaTeX and read back.

What the printed tables say of themselves (which cell is bold, which gain stands behind a value) is
worked out again from the values; the cells where the paper prints something else are listed.
"""

from __future__ import annotations

import csv
import hashlib
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import pytest

from airzoo_bench.matching.metrics import matching_scores
from airzoo_bench.matching.protocol import MatchingProtocol
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.retrieval.track import list_scores
from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.layouts import (
    MethodTable,
    benchmarks_layout,
    methods_layout,
    scenes_layout,
    with_published,
)
from airzoo_bench.tables.marks import add_citations, add_gains, highlight, mark_best
from airzoo_bench.tables.model import Cell, Table
from airzoo_bench.tables.published import (
    PrintedValue,
    published_sources,
    read_source,
    read_source_file,
)
from tests.support import PAPER
from tests.tables.typeset import MINUS, document, typeset

SOURCE = published_sources()["airzoo-paper"]
DATA = SOURCE.with_suffix(".csv")
SHA256_OF_THE_PAPERS = "9d3da0538e5ad4b79788c9e7cf3fee14e330b31721ff0b714f32937beebe8913"

HEADS = {
    "airzoo-real": "AirZoo-Real",
    "airzoo-test": "AirZoo-Test",
    "uavscenes": "UAVScenes",
    "urbanscene3d": "UrbanScene3D",
}

# What the paper calls a score, by the score's key.
PAPER_NAMES = {
    key: name for names in read_source_file(SOURCE).scores.values() for name, key in names.items()
}


@dataclass(frozen=True)
class Printed:
    """How the paper lays one of its tables out."""

    layout: str
    baselines: tuple[str, ...]
    highlighted: tuple[str, ...]


RETRIEVAL = ("MegaLoc (Ours)=MegaLoc",), ("MegaLoc (Ours)",)
MATCHING = ("RoMA",), ("RoMA (GIM)", "RoMA (Ours)")
PRINTED = {
    "tab:uav-visloc": Printed("methods", *RETRIEVAL),
    "tab:ourflight-retrieval": Printed("methods", *RETRIEVAL),
    "tab:6dof_recall": Printed("methods", *MATCHING),
    "tab:translation_accuracy": Printed("methods", *MATCHING),
    "tab:uav_visloc_scenes": Printed("scenes", *RETRIEVAL),
    "tab:uav_real_scenes": Printed("scenes", *RETRIEVAL),
    "tab:matching_results": Printed("scenes", *MATCHING),
    "tab:uav-recon": Printed(
        "benchmarks", ("VGGT (Ours)=VGGT", "DA3-Large (Ours)=DA3-Large"), ("DA3-Large (Ours)",)
    ),
}

# Printed gains that are not the difference of the printed values, with that difference.
OTHER_GAINS = {
    ("tab:ourflight-retrieval", "MegaLoc (Ours)", "Average", "R@1"): ("+12.21", "+12.20"),
    ("tab:ourflight-retrieval", "MegaLoc (Ours)", "Average", "R@5"): ("+28.38", "+28.37"),
    ("tab:uav_visloc_scenes", "MegaLoc (Ours)", "Average", "R@5"): ("+6.96", "+6.97"),
    ("tab:uav_real_scenes", "MegaLoc (Ours)", "Average", "R@5"): ("+28.38", "+28.37"),
    ("tab:uav-recon", "VGGT (Ours)", "UrbanScene3D", "F1"): ("+8.23", "+9.23"),
    ("tab:uav-recon", "DA3-Large (Ours)", "UAVScenes", "F1"): ("+2.93", "+4.04"),
}

# Printed in bold without being the best: what is best is the row below.
BOLD_BESIDE_THE_BEST = {
    ("tab:6dof_recall", "RoMA (GIM)", "Average", "recall@(5m,1deg)"),
    ("tab:6dof_recall", "RoMA (GIM)", "Average", "recall@(10m,1deg)"),
    ("tab:6dof_recall", "RoMA (GIM)", "Average", "recall@(20m,2deg)"),
    ("tab:translation_accuracy", "RoMA (GIM)", "Average", "median_translation_error"),
    ("tab:translation_accuracy", "RoMA (GIM)", "Average", "recall@5m"),
    ("tab:translation_accuracy", "RoMA (GIM)", "Average", "recall@10m"),
}


@cache
def rows() -> list[dict[str, str]]:
    with DATA.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def of_paper(label: str) -> dict[tuple[str, str, str], dict[str, str]]:
    """Return the printed cells by method, place and score; a place is a scene or a benchmark."""
    # Benchmarks with a shipped protocol are headed by its title.
    names = read_source_file(SOURCE).benchmarks
    benchmarks = {title: HEADS.get(name, name) for title, name in names.items()}
    by_benchmark = PRINTED[label].layout == "benchmarks"
    places = {"overall": "Average"}
    return {
        (
            row["method"],
            benchmarks[row["benchmark"]]
            if by_benchmark
            else places.get(row["scene"], row["scene"]),
            row["metric"],
        ): row
        for row in rows()
        if row["table"] == label
    }


def scores_of(track: str) -> tuple[ScoreColumn, ...]:
    """Return the scores of a track; those of the paper's reconstruction are F1 alone."""
    shipped = shipped_protocols()
    if track == "retrieval":
        retrieval = load_protocol(shipped["uav-visloc-retrieval"])
        assert isinstance(retrieval, RetrievalProtocol)
        return tuple(list_scores(retrieval.scores))
    if track == "matching":
        matching = load_protocol(shipped["aerialextrematch-matching"])
        assert isinstance(matching, MatchingProtocol)
        return tuple(matching_scores(matching.scores))
    return (ScoreColumn.share("f1_10m", "F1", headline=True),)


def board_of(label: str, values: Sequence[PrintedValue]) -> MethodTable:
    """Return the board of a printed table, its rows as if they were of the paper's authors."""
    first, printed = values[0], {value.metric for value in values}
    scores = tuple(score for score in scores_of(first.track) if score.key in printed)
    scenes = {value.scene: value.scene for value in values if value.scene}
    empty = MethodTable(label, first.benchmark, first.track, scores, scenes)
    board = with_published(empty, values, [*scenes, ""])
    assert all(entry.reported == f"airzoo-paper, {label}" for entry in board.rows)
    return replace(board, rows=tuple(replace(e, reported="") for e in board.rows))


@cache
def rebuilt(label: str) -> Table:
    how = PRINTED[label]
    values = [value for value in read_source(SOURCE) if value.table == f"airzoo-paper, {label}"]
    boards = [
        board_of(label, [value for value in values if value.benchmark == name])
        for name in dict.fromkeys(value.benchmark for value in values)
    ]
    if how.layout == "benchmarks":
        made = benchmarks_layout(boards)
    elif how.layout == "scenes":
        made = scenes_layout(boards[0])
    else:
        made = methods_layout(boards[0])
    made = highlight(mark_best(made), how.highlighted)
    made = add_gains(made, how.baselines)
    return add_citations(made, ["airzoo-paper"])


def cells_of(table: Table) -> dict[tuple[str, str, str], Cell]:
    tracks = ("retrieval", "matching", "reconstruction")
    by_title = {score.title: score.key for track in tracks for score in scores_of(track)}
    return {
        (
            str(row.cells[0].value),
            column.group or "Average",
            PAPER_NAMES[by_title[column.title]],
        ): cell
        for row in table.rows
        for column, cell in zip(table.columns[1:], row.cells[1:], strict=True)
    }


def test_the_numbers_are_the_papers() -> None:
    # Where the paper's own file is beside the checkout, these are its bytes; this is their digest.
    beside = PAPER / "tables.csv"
    assert not beside.is_file() or DATA.read_bytes() == beside.read_bytes()
    assert hashlib.sha256(DATA.read_bytes()).hexdigest() == SHA256_OF_THE_PAPERS
    assert {row["table"] for row in rows()} == set(PRINTED)


@pytest.mark.parametrize("label", PRINTED)
def test_every_cell_agrees(label: str) -> None:
    paper, ours = of_paper(label), cells_of(rebuilt(label))
    assert set(ours) == set(paper)
    for place, cell in ours.items():
        printed, name = paper[place], (label, *place)
        assert cell.text(2) == printed["value"], name
        gain = "" if cell.gain is None else f"{cell.gain:+.2f}"
        assert (printed["printed_delta"], gain) == OTHER_GAINS.get(
            name, (printed["printed_delta"], printed["printed_delta"])
        ), name
        assert (cell.best != (printed["bold"] == "1")) == (name in BOLD_BESIDE_THE_BEST), name


@pytest.mark.parametrize("label", PRINTED)
def test_a_real_latex_prints_every_cell(label: str, tmp_path: Path) -> None:
    table = rebuilt(label)
    source = latex(table)
    text = typeset(document(source), tmp_path)
    lines = [line.split() for line in text.splitlines()]
    for piece in table.pieces():
        for row, texts in zip(piece.rows, piece.texts(), strict=True):
            key = row.cite
            expected = " ".join([texts[0], *[f"[{key}]"] * bool(key), *texts[1:]])
            assert expected.replace("-", MINUS).split() in [
                " ".join(line).replace("-", MINUS).split() for line in lines
            ], expected
    words = [word for line in lines for word in line]
    for group in {column.group for column in table.columns}:
        assert set(group.split()) <= set(words)
    best = [cell.text(2) for row in table.rows for cell in row.cells if cell.best]
    assert Counter(re.findall(r"textbf\{([0-9.]+)\}", source)) == Counter(best)


def test_the_layout_is_the_papers() -> None:
    source = latex(rebuilt("tab:uav_real_scenes"))
    for line in (
        r" & \multicolumn{4}{c}{\textbf{City}} & \multicolumn{4}{c}{\textbf{Rural}} \\",
        r"\cmidrule(lr){2-5}\cmidrule(lr){6-9}",
        r" & \multicolumn{8}{c}{\textbf{Average}} \\",
        r"\cmidrule(lr){2-9}",
        r"\rowcolor{yellow!25}",
    ):
        assert line in source.splitlines()
    assert r"SALAD~\cite{izquierdo2024optimal} & \multicolumn{2}{c}{7.36} &" in source
    assert r"\multicolumn{2}{c}{\textbf{18.66} {\color{gray}(+12.20)}}" in source
