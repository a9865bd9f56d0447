"""Recipes and the example of a reader: their lines do what they say."""

from __future__ import annotations

import ast
import csv
import pickle
import re
import runpy
import sys
import zipfile
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.registry import READERS
from tests.support import ROOT, add_package, run_main

DOCS = ROOT / "docs"
PAGES = [DOCS / "methods.md", *sorted((DOCS / "recipes").glob("*.md"))]


def python_blocks(text: str) -> list[str]:
    """Return the blocks of Python of a page."""
    return re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)


def test_pages_parse_and_name_every_recipe_and_reader() -> None:
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        named = re.findall(r"--reader ([a-z][\w-]+)|reader `([\w-]+)`", text)
        assert {"".join(one) for one in named} <= {*READERS.names()}, page
        for block in python_blocks(text):
            ast.parse(block)
    text = (DOCS / "methods.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\(recipes/([\w-]+)\.md#", text)) == {page.stem for page in PAGES[1:]}
    for name in READERS.names():
        one = READERS.get(name)
        row = f"| `{name}` | {', '.join(one.methods)} | {one.layout} |".replace("*", "\\*")
        assert row in text, row


def load_torch(path: str, **options: Any) -> Any:
    """Stand in for `torch.load`."""
    assert options == {"weights_only": False}
    with zipfile.ZipFile(path) as archive:
        return pickle.loads(archive.read("archive/data.pkl"))  # noqa: S301 - of this project


@pytest.mark.parametrize(("number", "name"), [(0, "vismatch"), (1, "loftr-dump")])
def test_lines_convert_pickles(number, name, worlds, tmp_path, monkeypatch) -> None:
    worlds.sample(name, tmp_path / "f")
    monkeypatch.chdir(tmp_path / "f")
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(load=load_torch))
    text = (DOCS / "recipes" / "matching.md").read_text(encoding="utf-8").partition("## Pickles")[2]
    exec(python_blocks(text)[number], {})  # noqa: S102 - lines that users paste
    found = worlds.evaluate("matching", tmp_path / "f" / "matches")
    expected = worlds.evaluate("matching", worlds.sample("loftr", tmp_path / "l"))
    assert found.overall == pytest.approx(expected.overall, abs=1e-8)
    assert found.result.predictions.reader.name == "loftr"


class _Tensor:
    """As much of a tensor as the lines for Game4Loc use."""

    def __init__(self, rows: Any) -> None:
        self.numpy = lambda: rows
        self.cpu = self.float = lambda: self

    @staticmethod
    def cat(parts: list[Any]) -> Any:
        return _Tensor(np.concatenate([part.numpy() for part in parts]))


def test_lines_save_features_of_game4loc(worlds, tmp_path, monkeypatch) -> None:
    arrays = np.load(worlds.sample("game4loc", tmp_path / "f"))
    queries, gallery = (_Tensor(arrays[f"{kind}_features"]) for kind in ("query", "gallery"))
    known = {"np": np, "torch": _Tensor, "gallery_features_batch": gallery}
    known |= {"img_features_query": queries, "img_features_gallery": gallery}
    known |= {f"{kind}_list": arrays[f"{kind}_names"].tolist() for kind in ("query", "gallery")}
    known["query_path_list"] = [f"/bench/data/{one}" for one in known["query_list"]]
    known["gallery_path_list"] = [f"/bench/scenes/{one}" for one in known["gallery_list"]]
    text = (DOCS / "recipes" / "retrieval.md").read_text(encoding="utf-8")
    for number, one in enumerate(one for one in python_blocks(text) if "query_f" in one):
        (tmp_path / str(number)).mkdir()
        monkeypatch.chdir(tmp_path / str(number))
        exec(one, dict(known))  # noqa: S102 - lines that users paste
        found = worlds.evaluate("retrieval", tmp_path / str(number) / "features.npz")
        assert found.overall["recall@1"] == 1.0


def test_the_example_reads(worlds, tmp_path, monkeypatch, capsys) -> None:
    assert "ranks-csv" not in READERS.names()
    add_package(ROOT / "examples" / "reader-package", tmp_path / "package", monkeypatch)
    home, lines = worlds.home / "retrieval", ["query,tile,similarity"]
    for line in (home / "trec" / "mine.run").read_text().splitlines():
        query, _, tile, _, score, _ = line.split()
        lines.append(f"{query}.jpg,{tile},{score}")
    (tmp_path / "ranks.csv").write_text("\n".join(lines))
    command = ("eval", "retrieval", "--protocol", "made-retrieval", "--data", home / "data")
    assert run_main(*command, tmp_path / "ranks.csv") == 0
    said = capsys.readouterr()
    assert "read by reader ranks-csv" in said.out + said.err
    assert "100.0" in said.out
    assert run_main(*command, tmp_path / "package") == 2
    assert "ranks-csv" in capsys.readouterr().err
    monkeypatch.setattr(csv, "DictReader", lambda *_, **__: [{}])  # a slip, inside of `readable`
    assert run_main(*command, tmp_path / "ranks.csv") == 2
    assert re.search(r"ranks-csv.*similarity.*__init__\.py.*ranks\.csv", capsys.readouterr().err)
    monkeypatch.delattr(type(READERS.get("ranks-csv")), "title")  # it is left out, with a warning
    assert run_main(*command, tmp_path / "package") == 2
    assert "ranks-csv" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("protocol", "key", "best"),
    [("made-retrieval", "recall@1", 1), ("hills-matching", "error_m", 0)],
)
def test_true_answers_are_perfect(protocol, key, best, worlds, tmp_path, monkeypatch) -> None:
    track, out = protocol.split("-")[1], tmp_path / "perfect.npz"
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(worlds.home / track / "data"))
    monkeypatch.setattr(sys, "argv", ["perfect.py", protocol, str(out)])
    runpy.run_path(str(ROOT / "examples" / "benchmark-package" / "perfect.py"))
    assert worlds.evaluate(track, out).overall[key] == pytest.approx(best, abs=1e-6)
