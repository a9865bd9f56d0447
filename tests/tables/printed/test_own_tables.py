"""What ``airzoo-bench table`` prints, whatever its layout, is read back number for number."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.matching.scores import matching_scores
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.reconstruction.scores import reconstruction_scores
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.results.provenance import ProtocolUsed, TruthUsed
from airzoo_bench.results.result import Result, score_columns, write_result
from airzoo_bench.results.scores import Score
from airzoo_bench.retrieval.scores import retrieval_scores
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.tables.printed.cells import Published
from airzoo_bench.tables.printed.scores import Family, read_score
from airzoo_bench.tables.printed.table import read_published
from tests.results.made import result
from tests.support import run_main

PROTOCOLS = ("airzoo-mini-retrieval", "airzoo-mini-matching", "airzoo-mini-reconstruction")
METHODS = ("weak_1 & co", "good 90 %", "X [a]")
SCENES = {"city": "City", "scene_2": "Scene 2", "rural": "Rural"}


def scores_of(name: str) -> list[Score]:
    protocol = load_protocol(shipped_protocols()[name])
    if isinstance(protocol, RetrievalProtocol):
        return retrieval_scores(protocol.scores)
    if isinstance(protocol, MatchingProtocol):
        return matching_scores(protocol.scores)
    assert isinstance(protocol, ReconstructionProtocol)
    return reconstruction_scores(protocol.scores, with_poses=True)


def made(name: str, method: str, seed: int) -> Result:
    """Return a result of made-up numbers."""
    random = np.random.default_rng(seed)
    columns = score_columns(scores_of(name))

    def values() -> dict[str, float]:
        return {c.key: random.random() * (1 if c.unit == "share" else 9) for c in columns}

    scenes = {scene: values() for scene in SCENES}
    mean = {c.key: sum(scenes[s][c.key] for s in scenes) / len(scenes) for c in columns}
    base = result(method)
    content: dict[str, Any] = base.model_dump(by_alias=True) | {
        "track": name.rsplit("-", 1)[1],
        "protocol": ProtocolUsed(name=name, version=1, fingerprint=name, settings={}),
        "truth": TruthUsed(
            benchmark="airzoo-mini", version=1, fingerprint=name, scene_titles=SCENES
        ),
        "columns": columns,
        "scenes": scenes,
        "counts": {scene: {"queries": 59} for scene in SCENES},
        "overall": mean,
        "pooled": mean,
    }
    return Result.model_validate(content).with_checksum()


def read_back(
    folder: Path, form: str, capsys: pytest.CaptureFixture[str], *arguments: object
) -> Published:
    assert run_main("table", *arguments, "--format", form) == 0
    file = folder / f"table.{form}"
    file.write_text(capsys.readouterr().out, encoding="utf-8")
    return read_published(file)


def expected(one: Result, scene: str | None, *, every: bool) -> dict[str, str]:
    """Return what is printed of a scene, or of the average."""
    values = one.scenes[scene] if scene else one.overall
    shown = [c for c in one.columns if every or c.headline]
    return {c.title: f"{values[c.key] * (100 if c.unit == 'share' else 1):.2f}" for c in shown}


def cells_of(published: Published, method: str, scene: str) -> dict[str, str]:
    return {
        cell.score.name: cell.number.text
        for cell in published.cells
        if (cell.method, cell.scene) == (method, scene)
    }


LATEX = ("--siunitx", "--standalone")
EXTRAS = ("--second", "--highlight", METHODS[1], "--baseline", METHODS[0], "--queries")
FORMS = {
    "csv": ("csv",),
    "markdown": ("markdown",),
    "latex": ("latex",),
    "latex, with all": ("latex", *LATEX),
}


@pytest.mark.parametrize("name", PROTOCOLS)
@pytest.mark.parametrize("form", FORMS)
def test_methods_by_scenes(
    name: str, form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = {method: made(name, method, i) for i, method in enumerate(METHODS)}
    files = [tmp_path / f"{i}.json" for i in range(len(METHODS))]
    for file, one in zip(files, results.values(), strict=True):
        write_result(file, one)
    kind, *options = FORMS[form]
    arguments = (*files, "--layout", "scenes", *EXTRAS, *options)
    published = read_back(tmp_path, kind, capsys, *arguments)
    for method, one in results.items():
        for scene, title in SCENES.items():
            assert cells_of(published, method, title) == expected(one, scene, every=False)
        assert cells_of(published, method, "Average") == expected(one, None, every=False)
    assert {cell.queries for cell in published.cells if not cell.is_summary} == {59}
    gains = [cell for cell in published.cells if cell.gain]
    assert {cell.method for cell in gains} == {METHODS[1]}
    assert published.has_bold is (kind != "csv")
    averages = read_back(tmp_path, kind, capsys, *files, "--layout", "methods", "--all", *options)
    for method, one in results.items():
        assert cells_of(averages, method, "overall") == expected(one, None, every=True)


@pytest.mark.parametrize("name", PROTOCOLS)
@pytest.mark.parametrize("form", FORMS)
def test_one_result(
    name: str, form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = made(name, METHODS[0], 0)
    write_result(tmp_path / "r.json", one)
    kind, *options = FORMS[form]
    published = read_back(tmp_path, kind, capsys, tmp_path / "r.json", "--all", *options)
    for scene, title in SCENES.items():
        read = cells_of(published, "(unnamed)", title)
        assert {k: v for k, v in read.items() if k != "Points"} == expected(one, scene, every=True)


@pytest.mark.parametrize("form", FORMS)
def test_several_protocols(form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = {name: made(name, METHODS[0], i) for i, name in enumerate(PROTOCOLS)}
    for name, one in results.items():
        write_result(tmp_path / f"{name}.json", one)
    kind, *options = FORMS[form]
    files = [tmp_path / f"{name}.json" for name in results]
    published = read_back(tmp_path, kind, capsys, *files, *options)
    # An average over a benchmark is no number of one set of queries, nor of one cloud.
    assert not any(cell.is_of_one_set for cell in published.cells)
    for name, one in results.items():
        track = name.rpartition("-")[2]
        read = {c.score.name: c.number.text for c in published.cells if track in c.benchmark}
        assert read == expected(one, None, every=False)


@pytest.mark.parametrize("name", sorted(shipped_protocols()))
def test_every_score_of_ours_is_known(name: str) -> None:
    for score in scores_of(name):
        known = read_score(score.title)
        assert known.higher_is_better is score.higher_is_better, score.title
        if score.column.startswith(("recall@", "precision@", "f1@", "chamfer", "ap@")):
            assert known.family is not Family.OTHER, score.title
