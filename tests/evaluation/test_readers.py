"""Readers: files of a made-up method are recognised, read, scored, and described."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import airzoo_bench as ab
from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.predictions import QueryPredictions, Reader, Reading, ReadPredictions
from airzoo_bench.retrieval.predictions import RankedIds
from tests.support import run_main

MAGIC = "ranked by Toy\n"
ASK = ("--protocol", "made-retrieval")


class Toy(Reader):
    track = "retrieval"
    title = "ranked lists of Toy"
    layout = "a text that begins with 'ranked by Toy'"
    methods = ("Toy",)

    def recognise(self, path: Path) -> float:
        return 0.9 * (path.is_file() and path.read_bytes().startswith(MAGIC.encode()))

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        rows = [line.split() for line in path.read_text().splitlines()[1:]]
        if not rows:
            raise PredictionError("is empty", where=path)
        listed = RankedIds(np.array([row[1:] for row in rows]), None)
        found = QueryPredictions(path, None, np.array([row[0] for row in rows]), listed)
        return ReadPredictions(found, ("best first",), (f"{len(reading.truths)} scenes",))


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


@pytest.mark.parametrize("command", [("eval", "retrieval"), ("check",)])
def test_a_damaged_benchmark_is_not_called_missing(
    command: tuple[str, ...], ranked: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = next(path for path in (data / "made" / "scenes").iterdir())
    (scene / "queries.csv").write_text("id,image\n")
    assert run_main(*command, ranked, *ASK) == 2
    said = capsys.readouterr().err
    assert str(scene) in said
    assert "missing" not in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "does not say which protocol it is for"),
        ([*ASK, "--reader", "tyo"], "did you mean 'toy'?"),
        (["--protocol", "nowhere"], "unknown protocol"),
    ],
)
def test_refusals(
    ranked: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("eval", "retrieval", ranked, *arguments) == 2
    assert words in capsys.readouterr().err


def test_two_that_are_equally_sure_are_named(ranked: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(READERS.places, "toy2", f"{__name__}:TOY")
    with pytest.raises(UserError, match="--reader toy or --reader toy2"):
        ab.evaluate(ranked, protocol="made-retrieval")
    found = ab.evaluate(ranked, protocol="made-retrieval", reader="toy2")
    assert found.overall["recall@1"] == 1.0
