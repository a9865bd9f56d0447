"""Tracks and readers that the suite does not know are used as its own: nothing else is touched."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import pytest
import tomli_w

import airzoo_bench as ab
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.core.registry import READERS, TRACKS
from airzoo_bench.evaluation.evaluate import check, evaluate
from airzoo_bench.evaluation.info import TrackInfo
from airzoo_bench.evaluation.predictions import (
    PredictionFile,
    QueryPredictions,
    Reader,
    ReadRequest,
    assign_queries,
)
from airzoo_bench.evaluation.track import Assignment, Run, SceneScores, Track
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.retrieval.predictions import RankedIds
from airzoo_bench.retrieval.truth import read_truth
from tests.support import MadeScene, run_main


class HeightProtocol(Protocol):
    """A protocol with nothing to choose."""

    track: Literal["height"]


INFO = TrackInfo("height", f"{__name__}:HEIGHT", "Score heights above ground.")


class HeightTrack(Track):
    info, protocol = INFO, HeightProtocol

    def open(self, path: Path, memory_bytes: int) -> QueryPredictions[Any]:
        with np.load(path) as file:
            return QueryPredictions(path, str(file["protocol"]), file["query_ids"], file["metres"])

    def truth(self, benchmark: Benchmark, scene: str) -> Any:
        return read_truth(benchmark.scene_folder(scene), scene)

    def assign(self, predictions: Any, truths: Any, protocol: Any) -> Assignment:
        return assign_queries(predictions, truths, protocol)

    def score(self, part: Any, truth: Any, protocol: Any, run: Run) -> SceneScores:
        metres = part.predictions.content[part.rows]
        errors = np.where(part.rows >= 0, np.abs(metres - 100.0), np.inf)
        rows = {"scene": truth.scene, "query": truth.queries["id"], "error_m": errors}
        counts = {"queries": len(errors), "missing": int(np.isinf(errors).sum())}
        return SceneScores(pd.DataFrame(rows), counts, "heights")

    def scores(self, protocol: Any) -> list[ScoreColumn]:
        return [ScoreColumn.error("error_m", "Error", "m", "median", headline=True)]


HEIGHT = HeightTrack()


@pytest.fixture
def heights(
    data: Path, tmp_path: Path, scenes: list[MadeScene], monkeypatch: pytest.MonkeyPatch
) -> Path:
    """Return a prediction file of the track, whose protocol stands in the benchmark folder."""
    monkeypatch.setitem(TRACKS.places, "height", f"{__name__}:INFO")
    values = {"schema": 1, "name": "made-height", "version": 1, "title": "Heights", "summary": "-"}
    places = [{"id": scene.id, "title": scene.id.title()} for scene in scenes]
    values |= {"benchmark": "made", "track": "height", "scenes": places}
    folder = data / "made"
    (folder / "protocols" / "made-height.toml").write_text(tomli_w.dumps(values))
    manifest = folder / "benchmark.toml"
    manifest.write_text(manifest.read_text() + "\n[tracks.height]\n")
    ids = [query for scene in scenes for query in scene.query_ids][:-1]
    path = tmp_path / "heights.npz"
    np.savez(path, protocol="made-height", query_ids=ids, metres=np.arange(len(ids)) + 100.0)
    return path


def test_it_is_scored_checked_and_printed(
    heights: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result, checked = evaluate(heights, data=data).result, check(heights, data=data)
    assert result.scenes["east"]["error_m"] == 2.5
    assert result.counts["west"] == {"queries": 4, "missing": 1}
    assert not checked.errors
    for notes in (result.notes, checked.notes):
        assert any("west/q00003" in note for note in notes)
    out = tmp_path / "high"
    assert run_main("eval", "height", heights, "--out", out) == 0
    assert "Error [m] ↓" in capsys.readouterr().out
    assert run_main("table", out) == 0
    assert run_main("compare", out) == 0
    assert "height" in capsys.readouterr().out
    assert run_main("template", "made-height", "--out", tmp_path / "example.npz") == 2
    assert "the height track has no template" in capsys.readouterr().err


# --- a reader ---

MAGIC = "ranked by Toy\n"
ASK = ("--protocol", "made-retrieval")


class Toy(Reader):
    track = "retrieval"
    title = "ranked lists of Toy"
    layout = "a text that begins with 'ranked by Toy'"
    methods = ("Toy",)

    def recognise(self, path: Path) -> float:
        return 0.9 * (path.is_file() and path.read_bytes().startswith(MAGIC.encode()))

    def read(self, path: Path, request: ReadRequest) -> PredictionFile:
        rows = [line.split() for line in path.read_text().splitlines()[1:]]
        if not rows:
            raise PredictionError("is empty", where=path)
        listed = RankedIds(np.array([row[1:] for row in rows]), None)
        found = QueryPredictions(path, None, np.array([row[0] for row in rows]), listed)
        return PredictionFile(found, ("best first",), (f"{len(request.truths)} scenes",))


TOY = Toy()


@pytest.fixture
def ranked(
    tmp_path: Path, data: Path, monkeypatch: pytest.MonkeyPatch, perfect: dict[str, list[Any]]
) -> Path:
    monkeypatch.setitem(READERS.places, "toy", f"{__name__}:TOY")
    rows = zip(perfect["query_ids"], perfect["ranked_ids"], strict=True)
    path = tmp_path / "toy.txt"
    path.write_text(MAGIC + "".join(f"{query} {' '.join(tiles)}\n" for query, tiles in rows))
    return path


def test_a_method_file_is_recognised_checked_and_scored(
    ranked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("eval", "retrieval", ranked, *ASK, "--out", tmp_path / "run") == 0
    assert "read by reader toy" in capsys.readouterr().err
    result = ab.load_result(tmp_path / "run").result
    assert result.overall["recall@1"] == 1.0
    assert result.predictions.reader is not None
    assert (result.predictions.reader.name, "2 scenes" in result.notes) == ("toy", True)
    assert result.predictions.reader.conventions == ("best first",)
    assert run_main("check", ranked, *ASK) == 0
    said = capsys.readouterr().out
    for words in ("of Toy (Toy): retrieval", "--reader toy", "best first", "10 of 10 queries"):
        assert words in said
    ranked.write_text(MAGIC)
    found = ab.check(ranked, protocol="made-retrieval")
    assert [error.what for error in found.errors] == ["is empty"]
    assert run_main("check", ranked, *ASK) == 1


def test_two_that_are_equally_sure_are_named(ranked: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(READERS.places, "toy2", f"{__name__}:TOY")
    with pytest.raises(UserError, match="--reader toy or --reader toy2"):
        ab.evaluate(ranked, protocol="made-retrieval")
    found = ab.evaluate(ranked, protocol="made-retrieval", reader="toy2")
    assert found.overall["recall@1"] == 1.0
