"""The command: exit codes, formats, options, and the paper's own tables."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from airzoo_bench.tables.render import FORMATS
from tests.support import PUBLISHED

Command = Callable[..., Result]
WRONG = "method,scene,metric,value\nA,East,R@1,96.22\nA,East,R@3,95.83\n"
CLEAN = "method,scene,metric,value\nA,East,R@1,96.21\nA,East,R@3,96.59\n"
SCENES = (817, 1071, 768, 738, 473, 338, 26, 1033, 444, 144, 590)
COUNTS = "City=161,Rural=190,AerialExtreMatch/overall=264" + "".join(
    f",Scene {i}={n}" for i, n in enumerate(SCENES, 1)
)


@pytest.mark.parametrize("form", FORMATS)
def test_exit_codes(command: Command, tmp_path: Path, form: str) -> None:
    clean, wrong = tmp_path / "clean.csv", tmp_path / "wrong.csv"
    clean.write_text(CLEAN)
    wrong.write_text(WRONG)
    assert command("audit", clean, "--format", form).exit_code == 0
    found = command("audit", wrong, "--counts", "East=264", "--format", form)
    assert found.exit_code == 1
    assert "impossible" in found.stdout


def test_the_papers_counts_and_findings(command: Command) -> None:
    alone, given = (
        json.loads(command("audit", PUBLISHED, *more, "-f", "json").stdout)
        for more in ((), ("--counts", COUNTS))
    )
    titles = [column["title"] for column in given["columns"]]
    rows, others = ([dict(zip(titles, r, strict=True)) for r in t["rows"]] for t in (given, alone))
    notes, places = alone["notes"], {"AerialExtreMatch, matching, overall": 264}
    places |= {f"Scene {number}": n for number, n in enumerate(SCENES, 1)}
    places |= {f"AirZoo-Real, {track}, City": 161 for track in ("retrieval", "matching")}
    for place, n in (places | {"AirZoo-Real, matching, Rural": 190}).items():
        assert any(f"{place}: n = {n} fits" in note for note in notes)
    # An average over scenes is no share of queries.
    assert not any(f"{name}: n" in " ".join(notes) for name in ("Average", "retrieval, overall"))
    told = [note for note in notes if "the definition is mean precision" in note]
    assert ["54 of 55" in told[0], "10 of 10" in told[1], len(told)] == [True, True, 2]
    cells = {(r["Scene"], r["Method"], r["Printed"]) for r in rows if r["Grade"] == "impossible"}
    assert cells == {
        ("UAV-VisLoc, Scene 9", "MegaLoc (Ours)", "15.90"),
        ("AirZoo-Real, City", "RoMA (GIM)", "81.44"),
    }
    near = {r["Printed"] for r in rows if (r["Grade"], r["Check"]) == ("rounding", "counts")}
    assert near == {"8.08", "73.30", "3.78"}
    assert Counter((r["Grade"], r["Check"]) for r in rows) == {
        ("impossible", "counts"): 2,
        ("rounding", "counts"): 3,
        ("inconsistent", "counts"): 1,
        ("inconsistent", "average"): 13,
        ("inconsistent", "bold"): 6,
        ("inconsistent", "gain"): 2,
        ("rounding", "average"): 14,
        ("rounding", "gain"): 4,
    }
    # Without anything given, the numbers alone lead to the same cells.
    keys = ("Check", "Table", "Method", "Score", "Scene")
    same, found = ({tuple(r[k] for k in keys) for r in part} for part in (others, rows))
    assert same == found
    assert not any(r["Grade"] == "impossible" for r in others)
