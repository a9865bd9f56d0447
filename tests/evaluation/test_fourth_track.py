"""A track that the suite does not know is scored, checked and printed: nothing else is touched."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import pytest
import tomli_w

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.evaluation.evaluate import check, evaluate
from airzoo_bench.evaluation.info import TrackInfo
from airzoo_bench.evaluation.predictions import QueryPredictions, assign_queries
from airzoo_bench.evaluation.track import Assignment, Run, SceneScores, Track
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.retrieval.truth import read_truth
from tests.support import MadeScene, run_main


class HeightProtocol(Protocol):
    """A protocol with nothing to choose."""

    track: Literal["height"]


INFO = TrackInfo("height", f"{__name__}:HEIGHT", "ScoreColumn heights above ground.")


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
    assert run_main("eval", "heigth", heights) == 2
    assert "did you mean 'height'" in capsys.readouterr().err


def test_what_it_lacks(
    heights: Path, data: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = heights.with_name("example.npz")
    assert run_main("template", "made-height", "--out", out) == 2
    assert "the height track has no template" in capsys.readouterr().err
    assert not out.exists()
    monkeypatch.setattr(HEIGHT, "scores", lambda _: [ScoreColumn.share("r", "R", headline=True)])
    with pytest.raises(KeyError, match="r"):  # it does not vanish
        evaluate(heights, data=data)
