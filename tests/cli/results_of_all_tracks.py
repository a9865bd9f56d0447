"""Three methods a track, made of the truth and noise, and what their commands print, read back."""

from __future__ import annotations

import csv
import html
import io
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn
from unittest import mock
from xml.etree import ElementTree

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from PIL import Image

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.datasets.dataset import PrepareSettings
from airzoo_bench.datasets.mini import prepare as airzoo_mini
from airzoo_bench.datasets.mini.export.frame_list import FrameList
from airzoo_bench.datasets.mini.prepare import ROLL, Photos, mini_photos
from airzoo_bench.datasets.photo_options import PhotoOptions
from airzoo_bench.datasets.photos import prepare_photos
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.results.result import Result, ScoreColumn, read_result
from airzoo_bench.retrieval.truth import read_truth as read_retrieval
from tests.support import photo_protocols, run_main

TRACKS = ("retrieval", "matching", "reconstruction")
# From bad to good, with what formats must escape.
NAMES = ("weak_1 & co", "fair #2", "good 90 %")
FORMATS = ("terminal", "latex", "csv", "markdown", "html", "json")

_MEMORY = 1 << 30


# --- benchmarks ------------------------------------------------------------------------------


def sparse_mini(root: Path) -> Path:
    """Prepare AirZoo-Mini with every sixth photo of the surveys, every second of the rolls.

    Each weather and time of day is there once, as in the whole one twice.
    """
    with mock.patch.object(airzoo_mini, "mini_photos", _every_few):
        settings = PrepareSettings(root / "airzoo-mini", root, jobs=2)
        return airzoo_mini.prepare_airzoo_mini(0, settings).folder


def _every_few(*given: Any) -> Photos:
    photos = mini_photos(*given)
    every = [2 if sequence == ROLL else 6 for sequence in photos.sequence]
    numbers = [int(name[-4:]) for name in photos.frames.names]
    rows = [row for row, number in enumerate(numbers) if number % every[row] == 0]
    taken = _taken(photos.frames, rows)
    return Photos(taken, tuple(photos.sequence[row] for row in rows))


def _taken(frames: FrameList, rows: list[int]) -> FrameList:
    return replace(
        frames,
        names=tuple(frames.names[row] for row in rows),
        poses=frames.poses.take(np.array(rows)),
        weather=tuple(frames.weather[row] for row in rows),
        time_of_day=tuple(frames.time_of_day[row] for row in rows),
    )


def real_scene(root: Path, home: Path) -> Path:
    """Prepare Brighton Beach."""
    sources = PhotoOptions(
        "brighton",
        home / "images",
        home / "poses.json",
        home / "dom_10cm.tif",
        dsm=home / "dsm_10cm.tif",
        cloud=home / "model.laz",
    )
    settings = PrepareSettings(root / "brighton", root)
    prepare_photos(sources, photo_protocols("brighton", (256, 128)), settings)
    return root / "brighton"


# --- results ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Scored:
    """Three methods on a track of a benchmark; `paths` are in the order of `NAMES`."""

    benchmark: Path
    track: str
    paths: tuple[Path, ...]

    @property
    def results(self) -> dict[str, Result]:
        return {name: read_result(path) for name, path in zip(NAMES, self.paths, strict=True)}

    @property
    def records(self) -> dict[str, pd.DataFrame]:
        pairs = zip(NAMES, self.paths, strict=True)
        return {name: pd.read_csv(path.parent / "records.csv") for name, path in pairs}

    @property
    def headline(self) -> list[ScoreColumn]:
        return [column for column in read_result(self.paths[0]).columns if column.headline]

    @property
    def scene(self) -> str:
        """The last scene's id."""
        return list(read_result(self.paths[0]).scenes)[-1]


def score_methods(benchmark: Path, track: str, out: Path) -> Scored:
    """Write predictions of growing quality and score them as a user does."""
    write = {"retrieval": _rank, "matching": _pose, "reconstruction": _cloud}[track]
    paths = []
    for quality, name in enumerate(NAMES):
        home = out / str(quality)
        home.mkdir(parents=True)
        predictions = write(Benchmark.open(benchmark), quality, home)
        ask = ("eval", track, predictions, "--data", benchmark, "--method", name, "--out", home)
        assert run_main(*ask) == 0
        paths.append(home / "result.json")
    return Scored(benchmark, track, tuple(paths))


def _scenes(benchmark: Benchmark) -> list[str]:
    return [scene.id for scene in benchmark.file.scenes]


def _rank(benchmark: Benchmark, quality: int, home: Path) -> Path:
    """Order tiles by noise, and positive ones by something more."""
    random = np.random.default_rng(quality)
    ids: list[str] = []
    ranked = []
    for scene in _scenes(benchmark):
        truth = read_retrieval(benchmark.scene_folder(scene), scene)
        tiles = truth.tiles["id"].to_numpy(str)
        for row, query in enumerate(truth.queries["id"]):
            score = random.normal(size=len(tiles))
            score[truth.positives.of(row)] += (0.0, 0.8, 1.6)[quality]
            ids.append(query)
            ranked.append(tiles[np.argsort(-score)[:20]])
    protocol = f"{benchmark.file.name}-retrieval"
    np.savez(home / "p.npz", protocol=protocol, query_ids=ids, ranked_ids=np.array(ranked))
    return home / "p.npz"


def _pose(benchmark: Benchmark, quality: int, home: Path) -> Path:
    """Move the true poses by metres, and give some queries none."""
    random = np.random.default_rng(quality)
    ids: list[str] = []
    poses = []
    for scene in _scenes(benchmark):
        truth = read_matching(benchmark, scene)
        noise = random.normal(0, (6.0, 2.0, 0.6)[quality], (len(truth.queries), 3))
        moved = truth.poses.translation + noise
        found = np.concatenate([truth.poses.rotation, moved[..., None]], axis=2)
        found[random.random(len(found)) < (0.6, 0.2, 0.0)[quality]] = np.nan
        ids += truth.queries["id"].tolist()
        poses.append(found)
    protocol = f"{benchmark.file.name}-matching"
    np.savez(home / "p.npz", protocol=protocol, query_ids=ids, poses=np.concatenate(poses))
    return home / "p.npz"


def _cloud(benchmark: Benchmark, quality: int, home: Path) -> Path:
    """Take a share of the true points and move them; the weak method leaves out a scene."""
    random = np.random.default_rng(quality)
    folder = home / "clouds"
    folder.mkdir()
    (folder / "protocol.txt").write_text(f"{benchmark.file.name}-reconstruction")
    left_out = _scenes(benchmark)[1:] if quality == 0 else []
    for scene in _scenes(benchmark):
        if scene not in left_out:
            truth = read_reconstruction(benchmark, scene)
            poses, points = truth.poses, _true_points(truth.cloud)
            points = points[:: (500, 50, 10)[quality]]
            noise = random.normal(0, (2.0, 0.5, 0.1)[quality], points.shape)
            np.save(folder / f"{scene}.npy", points + noise)
            np.savez(
                folder / f"{scene}.cameras.npz",
                image_names=truth.photos["image"].to_numpy(str),
                extrinsics=np.concatenate([poses.rotation, poses.translation[..., None]], axis=2),
            )
    return folder


def _true_points(path: Path) -> NDArray[np.float64]:
    cloud = open_cloud(path, limit_bytes=_MEMORY, sampling=None)
    return np.concatenate([piece.points for piece in cloud.pieces(1 << 20)])


# --- what was printed ------------------------------------------------------------------------


def strict_json(text: str) -> Any:
    """Read JSON as the standard has it: without NaN and Infinity."""

    def refuse(constant: str) -> NoReturn:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


@dataclass(frozen=True)
class Grid:
    """A printed table: cells by the column's name, group before title."""

    columns: tuple[str, ...]
    rows: tuple[Mapping[str, Any], ...]

    def column(self, name: str) -> list[Any]:
        return [row[name] for row in self.rows]

    def where(self, **cells: Any) -> Grid:
        """Return the rows that have these cells."""
        kept = [row for row in self.rows if cells.items() <= row.items()]
        return Grid(self.columns, tuple(kept))

    def one(self, **cells: Any) -> Mapping[str, Any]:
        (row,) = self.where(**cells).rows
        return row


def json_grid(text: str) -> Grid:
    table = strict_json(text)
    names = tuple(f"{c.get('group', '')} {c['title']}".strip() for c in table["columns"])
    return Grid(names, tuple(dict(zip(names, row, strict=True)) for row in table["rows"]))


def csv_grid(text: str) -> Grid:
    names, *rows = csv.reader(io.StringIO(text))
    return Grid(tuple(names), tuple(dict(zip(names, row, strict=True)) for row in rows))


def number(cell: Any) -> float | None:
    """Return a cell's number, infinite ones too, or None where it has none."""
    try:
        return None if isinstance(cell, bool) or cell is None else float(cell)
    except ValueError:
        return None


def plain(text: str, form: str) -> str:
    """Return a table's words without the marks and escapes of its format."""
    if form == "latex":
        text = text.replace(r"$-$", "-").replace(r"$^\circ$", "°").replace("{[}", "[")
        text = re.sub(r"\\(?:textbf|underline|multicolumn\{\d+\}\{\w\})\{([^{}]*)\}", r"\1", text)
    if form in ("latex", "markdown"):
        text = re.sub(r"\\(\W|_)", r"\1", text).replace("**", "")
    if form == "html":
        text = re.sub(r"<[^>]*>", " ", text)
    if form in ("html", "markdown"):
        text = html.unescape(text)
    if form == "json":
        text = json.dumps(strict_json(text), ensure_ascii=False)
    return " ".join(text.split())


def shown_numbers(text: str) -> list[str]:
    """Return numbers of two decimals, in order, as all formats print scores."""
    return re.findall(r"(?<![\w.])-?\d+\.\d\d(?![\d%])", text)


def says_not_a_number(text: str) -> bool:
    return re.search(r"\bnan\b", text, re.IGNORECASE) is not None


@dataclass(frozen=True)
class Said:
    """What a command printed."""

    out: str
    err: str


def check_cell(exact: Any, shown: str) -> None:
    """Hold what CSV prints to the number that JSON holds."""
    value = number(exact)
    if value is None:
        return
    printed = float(shown)
    digits = len(shown.partition(".")[2]) if "e" not in shown else 17
    assert printed == value or abs(printed - value) <= 0.5 * 10.0**-digits + 1e-9


def as_shown(column: ScoreColumn, value: float) -> float:
    return value * 100 if column.unit == "share" else value


def with_unit(column: ScoreColumn) -> str:
    return f"{column.title} [{'%' if column.unit == 'share' else column.unit}]"


def same(one: Any, other: float) -> bool:
    found = number(one)
    return found is not None and (found == other or bool(np.isclose(found, other, rtol=1e-9)))


def conditions(scored: Scored) -> list[str]:
    """Return the columns that are conditions; a scene of reconstruction has its counts only."""
    records = scored.records[NAMES[0]]
    if scored.track == "reconstruction":
        return ["scene", "answered", "points"]
    known = ("altitude_m", "pitch_deg", "weather", "time_of_day", "sequence")
    return ["scene", *(name for name in known if name in records.columns)]


def check_picture(path: Path) -> None:
    if path.suffix == ".png":
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("L"))
        # Letters and lines take some of the page; a picture without data is nearly white.
        assert 0.01 < (pixels < 200).mean() < 0.9
        rows, columns = (pixels < 200).any(axis=1).mean(), (pixels < 200).any(axis=0).mean()
        assert min(rows, columns) > 0.6
    elif path.suffix == ".svg":
        root = ElementTree.parse(path).getroot()
        assert root.tag.endswith("svg")
        assert len(list(root.iter("{http://www.w3.org/2000/svg}path"))) > 10
    else:
        content = path.read_bytes()
        assert content.startswith(b"%PDF-")
        assert content.rstrip().endswith(b"%%EOF")


def check_averages(result: Result, headline: list[ScoreColumn], table: str) -> None:
    for column in headline:
        value = as_shown(column, result.overall[column.key])
        assert f"{value:.2f}" in table


def check_section(one: Scored, section: dict[str, Any], table: str) -> None:
    # The best first.
    assert [method["name"] for method in section["methods"]] == list(NAMES)[::-1]
    titles = {score["title"] for score in section["scores"]}
    assert {column.title for column in one.headline} <= titles
    assert len(section["scenes"]) == len(one.results[NAMES[0]].scenes)
    assert section["figures"]
    by_query = one.track != "reconstruction"
    assert bool(section["maps"]) == bool(section["hardest"]) == bool(section["queries"]) == by_query
    for result in one.results.values():
        check_averages(result, one.headline, table)
