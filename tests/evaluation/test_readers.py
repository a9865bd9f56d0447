"""Readers: files of a made-up method are recognised, read, scored, and described."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import Result

import airzoo_bench as ab
from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.queries import QueryPredictions
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions
from airzoo_bench.retrieval.predictions import RankedIds
from tests.support import run_main

MAGIC = "ranked by Toy\n"


class Toy(Reader):
    track = "retrieval"
    title = "ranked lists of Toy"
    layout = "a text that begins with 'ranked by Toy'"
    methods = ("Toy",)

    def recognise(self, path: Path) -> float:
        if not path.is_file():
            return 0.0
        with path.open("rb") as stream:
            return 0.9 * (stream.read(len(MAGIC)) == MAGIC.encode())

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        rows = [line.split() for line in path.read_text().splitlines()[1:]]
        if not rows:
            raise PredictionError("is empty", where=path)
        listed = RankedIds(np.array([row[1:] for row in rows]), None)
        found = QueryPredictions(path, None, np.array([row[0] for row in rows]), listed)
        return ReadPredictions(found, ("best first",), (f"{len(reading.truths)} scenes",))


TOY = Toy()


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(READERS.places, "toy", f"{__name__}:TOY")


@pytest.fixture
def ranked(tmp_path: Path, data: Path, toy: None, perfect: dict[str, list[Any]]) -> Path:
    rows = zip(perfect["query_ids"], perfect["ranked_ids"], strict=True)
    path = tmp_path / "toy.txt"
    path.write_text(MAGIC + "".join(f"{query} {' '.join(tiles)}\n" for query, tiles in rows))
    return path


def test_a_method_file_is_recognised_and_scored(
    ranked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    arguments = ("--protocol", "made-retrieval", "--out", out)
    assert run_main("eval", "retrieval", ranked, *arguments) == 0
    assert "read by reader toy" in capsys.readouterr().err
    result = json.loads((out / "result.json").read_text())
    assert result["overall"]["recall@1"] == 1.0
    assert result["predictions"]["reader"] == {"name": "toy", "conventions": ["best first"]}
    assert "2 scenes" in result["notes"]
    assert ab.load_result(out).overall["recall@1"] == 1.0


@pytest.mark.parametrize("command", [("eval", "retrieval"), ("check",)])
def test_a_damaged_benchmark_is_not_called_missing(
    command: tuple[str, ...], ranked: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = next(path for path in (data / "made" / "scenes").iterdir())
    (scene / "queries.csv").write_text("id,image\n")
    assert run_main(*command, ranked, "--protocol", "made-retrieval") == 2
    said = capsys.readouterr().err
    assert str(scene) in said
    assert "missing" not in said


def test_check_says_what_it_is(ranked: Path, command: Callable[..., Result]) -> None:
    ran = command("check", ranked, "--protocol", "made-retrieval")
    assert ran.exit_code == 0
    assert "ranked lists of Toy (Toy): retrieval predictions for" in ran.stdout
    assert "read by --reader toy" in ran.stdout
    assert "taken to be so: best first" in ran.stdout
    assert "answers 10 of 10 queries" in ran.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "does not say which protocol it is for"),
        (["--protocol", "made-retrieval", "--reader", "tyo"], "did you mean 'toy'?"),
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


def test_what_a_reader_refuses_is_an_error_of_the_check(
    ranked: Path, command: Callable[..., Result]
) -> None:
    ranked.write_text(MAGIC)
    found = ab.check(ranked, protocol="made-retrieval")
    assert [error.what for error in found.errors] == ["is empty"]
    assert command("check", ranked, "--protocol", "made-retrieval").exit_code == 1
