"""Words and names of messages, registries of names, and keys that nobody knows."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import SubmissionError, agreeing, counted, first_of, plural
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.validation import Strict, nearest, validated


def test_words_agree_with_numbers() -> None:
    nouns = {"query": "queries", "scene": "scenes", "match": "matches", "key": "keys"}
    assert {noun: plural(noun) for noun in nouns} == nouns
    assert [counted(n, "photo") for n in (0, 1, 12_000)] == ["0 photos", "1 photo", "12,000 photos"]
    assert [agreeing(n, "is", "are") for n in (0, 1, 2)] == ["are", "is", "are"]
    assert first_of(["a"], 5, noun="query") == "1 of 5 queries (a)"
    assert first_of("abcd", noun="row") == "4 rows (first 3: a, b, c)"


def test_a_package_adds_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "more-tracks-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: more-tracks\nVersion: 1.0\n")
    lines = ["[airzoo_bench.tracks]", "height = pathlib:Path", "depth = pathlib:Path"]
    (info / "entry_points.txt").write_text("\n".join([*lines, "matching = pathlib:Path", ""]))
    monkeypatch.syspath_prepend(tmp_path)
    assert TRACKS.names() == ["retrieval", "matching", "reconstruction", "depth", "height"]
    assert TRACKS.get("height") is Path
    assert TRACKS.get("matching") is not Path
    with pytest.raises(KeyError):
        TRACKS.get("none")


@pytest.mark.parametrize(
    ("name", "near"), [("UAV_VisLoc", "uav-visloc"), ("7", "07"), ("xyz", ""), ("SAM", "sam")]
)
def test_names_like_a_mistyped_one(name: str, near: str) -> None:
    offered = nearest(name, ["uav-visloc", "07", "sam", "aerialextrematch"])
    assert offered.split("'")[1::2] == ([near] if near else [])


@pytest.mark.parametrize("key", ["<b>", "<map>", "plain"])
def test_a_key_that_nobody_knows_is_named_whatever_it_is(key: str) -> None:
    class Table(Strict):
        known: int = 1

    with pytest.raises(SubmissionError, match=f"unknown key '{key}'"):
        validated({key: 1}, Table, SubmissionError, Path("x.toml"), "table")
