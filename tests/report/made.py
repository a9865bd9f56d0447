"""Results to make pictures and reports of: by hand, and of a benchmark with photos and a map."""

from __future__ import annotations

import base64
import json
import re
import zlib
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from typer.testing import CliRunner, Result

from airzoo_bench.cli.main import app
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import ScoreColumn
from tests.statistics.support import ERROR, HIT, made_result, write_method
from tests.support import make_place, run_main, write_predictions

HOSTILE = (
    '</script><script>document.title="bad"</script><img src=x onerror=alert(1)> $x$ {{data}} &'
)

F1 = [
    ScoreColumn.share(f"{what}_{limit}m", f"{what}@{limit}m", headline=what == "f1")
    for limit in (1, 10)
    for what in ("precision", "recall", "f1")
]


def run(*arguments: object) -> Result:
    """Run a command; what it raises is in the result."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def retrieval_method(name: str, seed: int, queries: int = 40, **changes: Any) -> Method:
    """Return a method on two scenes, with ranks, tiles, errors and conditions."""
    random = np.random.default_rng(seed)
    scenes = np.where(np.arange(queries) % 2 == 0, "east", "west")
    ranks = random.integers(0, 6, queries)
    errors = random.exponential(20, queries)
    errors[ranks == 0] = np.inf
    records = pd.DataFrame(
        {
            "scene": scenes,
            "query": [f"{scene}/q{row:05d}" for row, scene in enumerate(scenes)],
            "first_hit_rank": ranks,
            "ranked": 5 - ranks % 3,
            **{
                f"tile@{k}": [f"{scene}/t{(k + row) % 7}" for row, scene in enumerate(scenes)]
                for k in range(1, 6)
            },
            "recall@1": (ranks == 1).astype(float),
            "error_m": errors,
            "altitude_m": np.linspace(20, 180, queries),
            "weather": [("sunny", "rainy", None)[row % 3] for row in range(queries)],
        }
    ).sort_values("query", ignore_index=True)
    settings = {"scores": {"ranks_kept": 5}}
    result = made_result(records, (HIT, ERROR), name, settings=settings, **changes)
    return Method(name, result, records)


def reconstruction_method(name: str, seed: int, scenes: int = 3) -> Method:
    """Return a method of the reconstruction track: a record a scene."""
    random = np.random.default_rng(seed)
    ids = [f"scene{number}" for number in range(scenes)]
    values = {column.key: random.random(scenes) for column in F1}
    records = pd.DataFrame({"scene": ids, "query": ids, **values})
    result = made_result(records, F1, name, protocol="r" * 64)
    return Method(
        name, result.model_copy(update={"track": "reconstruction"}).with_checksum(), records
    )


def write_methods(folder: Path, methods: list[Method]) -> list[Path]:
    """Write each result into a folder of its own."""
    return [
        write_method(folder / f"{method.result.track}{number}", method)
        for number, method in enumerate(methods)
    ]


def write_photo_results(folder: Path, names: list[str]) -> tuple[Path, list[Path]]:
    """Return the data root of 30 photos, and results of random predictions that lack the first."""
    random = np.random.default_rng(0)
    places = {f"p{number:02d}.jpg": tuple(random.uniform(60, 196, 2)) for number in range(30)}
    place = make_place(folder / "sources", places)
    data = folder / "data"
    assert run_main(*place.arguments(out=data / "park")) == 0
    home = next((data / "park" / "scenes").iterdir())
    queries = pd.read_csv(home / "queries.csv")["id"].tolist()[1:]
    tiles = pd.read_parquet(home / "retrieval" / "tiles.parquet")["id"].to_numpy()
    results = []
    for number, name in enumerate(names):
        ranked = [random.permutation(tiles)[:5].tolist() for _ in queries]
        file = write_predictions(
            folder / f"{number}.npz", "park-retrieval", query_ids=queries, ranked_ids=ranked
        )
        out = folder / "results" / str(number)
        ask = ("eval", "retrieval", file, "--data", data, "--method", name, "--out", out)
        assert run_main(*ask) == 0
        results.append(out / "result.json")
    return data, results


class Page(HTMLParser):
    """A page: what its script reads, and its tables by the section that they stand in."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.text = path.read_text(encoding="utf-8")
        found = re.search(r'id="page-data">(.*?)</script>', self.text, re.DOTALL)
        assert found
        self.data: dict[str, Any] = json.loads(found[1])
        self.parts: list[dict[str, Any]] = self.data["parts"]
        self.blobs = re.findall(r'id="blob-\d+">(.*?)</script>', self.text)
        self.tables: dict[str, list[tuple[str, list[list[str]]]]] = {}
        self.images: list[str] = []
        self._part, self._cell, self._caption = "", False, False
        self.feed(self.text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if re.fullmatch(r"part\d+(-\w+)?|overview", given.get("id") or ""):
            self._part = str(given["id"])
        if tag == "caption":
            self.tables.setdefault(self._part, []).append(("", []))
        if tag == "img":
            self.images.append(f"{self._part} {given.get('alt')}")
        rows = self.tables[self._part][-1][1] if self._part in self.tables else []
        if tag == "tr":
            rows.append([])
        if tag in ("th", "td") and rows:
            mark = {"best": "★", "tied": "≈"}
            rows[-1].append("".join(mark.get(c, "") for c in (given.get("class") or "").split()))
        self._caption = tag == "caption" or (self._caption and tag == "span")
        self._cell = tag in ("th", "td", "a")

    def handle_data(self, data: str) -> None:
        if self._caption:
            title, rows = self.tables[self._part][-1]
            self.tables[self._part][-1] = (title + data, rows)
        if self._cell and self.tables.get(self._part):
            self.tables[self._part][-1][1][-1][-1] += data

    def handle_endtag(self, tag: str) -> None:
        self._caption = self._cell = False

    def table(self, place: str, number: int = 0) -> list[list[str]]:
        """Return the texts of a table, heads first, with the marks before them."""
        return self.tables[place][number][1]

    def unpack(self, packed: dict[str, Any]) -> Any:
        content = zlib.decompress(base64.b64decode(self.blobs[packed["blob"]]))
        kind = packed["type"]
        return json.loads(content) if kind == "json" else np.frombuffer(content, kind)


def made_page(folder: Path, *arguments: object) -> Page:
    done = run("report", *arguments, "-o", folder / "report.html")
    assert done.exit_code == 0, (done.output, done.exception)
    return Page(folder / "report.html")


def of_benchmark(method: Method, name: str) -> Method:
    truth = method.result.truth.model_copy(update={"benchmark": name})
    result = method.result.model_copy(update={"truth": truth}).with_checksum()
    return Method(method.name, result, method.records)
