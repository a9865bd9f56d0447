"""What every dataset must keep to, the built-in ones and one of another package."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields, is_dataclass
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np
import pandas as pd
import pytest
from typer.main import get_command

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import SceneInputs, photo_table
from airzoo_bench.cli.prepare import app as prepare_app
from airzoo_bench.core import registry
from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.core.registry import DATASETS, TRACKS, Option
from airzoo_bench.datasets.dataset import Dataset, Prepared, PrepareSettings
from airzoo_bench.datasets.folder import write_benchmark
from airzoo_bench.datasets.scene_content import SceneContent
from airzoo_bench.datasets.truths import BenchmarkProtocols, SceneTruths, build_truths
from airzoo_bench.protocol.model import ProtocolScene
from tests.datasets.parts import hold_tiles
from tests.own_protocols import photo_protocols
from tests.support import DOWN, NORTH_WEST, PLACE_CRS, PLACE_PHOTOS, Place, make_place, run_main

SHARED = {"out", "tiles", "crops", "copy", "force"}
SPREAD = {"jobs", "engine", "scheduler"}


# --- a dataset of another package ------------------------------------------------------------


@dataclass(frozen=True)
class LevelOptions:
    """Where the native data lie."""

    source: Annotated[Path, Option("source", "Folder as it was downloaded.")]
    scenes: Annotated[int, Option("scenes", "How many scenes.", least=1, most=2)] = 1


class Level(Dataset[LevelOptions]):
    """Photos that look straight down, on known places: two scenes of the same data."""

    summary = "Make a benchmark of a level place."
    example = "level --source level"
    options = LevelOptions
    without_truth = {"matching": "its photos have no priors"}  # noqa: RUF012

    def benchmark(self, options: LevelOptions) -> str:
        return "level"

    def prepare(self, options: LevelOptions, settings: PrepareSettings) -> Prepared:
        from airzoo_bench.geometry.cameras import Cameras
        from airzoo_bench.geometry.poses import Poses
        from airzoo_bench.geometry.rasters import open_info

        home, names = options.source, tuple(PLACE_PHOTOS)
        if not home.is_dir():
            raise UsageError("no such folder", where=home)
        matrices = np.array([[[64.0, 0, 32], [0, 64, 24], [0, 0, 1]]] * 4)
        cameras = Cameras.from_matrices(
            matrices, np.full(4, 64), np.full(4, 48), np.zeros((4, 5)), names=names
        )
        x, y = np.array(list(PLACE_PHOTOS.values())).T
        centres = np.stack([NORTH_WEST[0] + x, NORTH_WEST[1] - y, np.full(4, 200.0)], axis=1)
        poses = Poses.from_centres(np.array([DOWN] * 4), centres, names)
        files = {key: home / f"{key}.tif" for key in ("dom", "dsm")}
        ids = [f"s{number}" for number in range(options.scenes)]
        named = {"scenes": tuple(ProtocolScene(id=one, title=one) for one in ids)}
        retrieval = photo_protocols("level", (64,)).retrieval
        protocols = BenchmarkProtocols(retrieval and retrieval.model_copy(update=named))
        scenes = []
        for one in settings.progress(ids, "scenes", len(ids)):
            table = photo_table(one, names, cameras, poses, None, 100.0)
            dom = open_info(files["dom"])
            inputs = SceneInputs(one, table, PLACE_CRS, dom, files["dsm"], 100.0)
            sources = {"images": home / "photos", **files}
            scenes.append(SceneContent(inputs, build_truths(inputs, protocols), sources))
        return write_benchmark(scenes, protocols, settings)


LEVEL = Level()


@pytest.fixture
def level(monkeypatch: pytest.MonkeyPatch) -> None:
    """Install a package that has the dataset."""
    point = EntryPoint("level", f"{__name__}:LEVEL", "airzoo_bench.datasets")

    def entry_points(*, group: str) -> Iterator[EntryPoint]:
        return iter([point] if group == point.group else [])

    monkeypatch.setattr(registry, "entry_points", entry_points)


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return make_place(tmp_path / "source")


# --- every dataset ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*DATASETS.names(), "level"])
def test_it_says_what_the_command_line_asks(
    name: str, level: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "160")  # a narrow terminal cuts long names
    dataset: Dataset[Any] = DATASETS.get(name)
    assert isinstance(dataset, Dataset)
    assert is_dataclass(dataset.options)
    assert dataset.summary.split("\n\n")[0].endswith(".")
    assert dataset.example.split()[0] == name
    assert set(dataset.without_truth) <= set(TRACKS.names())
    hints = get_type_hints(dataset.options, include_extras=True)
    assert run_main("prepare", name, "--help") == 0
    said = capsys.readouterr().out
    for field in fields(dataset.options):
        (option,) = get_args(hints[field.name])[1:]
        assert option.name not in SHARED | SPREAD
        assert f"--{option.name}" in said
        assert field.default is not MISSING or f"--{option.name} " in dataset.example + " "
    assert all(f"--{one}" in said for one in SHARED)
    assert all((f"--{one}" in said) == (dataset.jobs is not None) for one in SPREAD)
    assert (dataset.jobs is None) == (name == "level")


@pytest.mark.parametrize("name", DATASETS.names())
def test_its_example_is_a_command(name: str, tmp_path: Path) -> None:
    dataset: Dataset[Any] = DATASETS.get(name)
    command = get_command(prepare_app)
    group = command.make_context("prepare", [], resilient_parsing=True)
    words = dataset.example.split()
    found = command.get_command(group, words[0])  # type: ignore[attr-defined]
    found.make_context(words[0], words[1:])


@pytest.mark.parametrize("name", DATASETS.names())
def test_what_is_published_is_told(name: str) -> None:
    about = DATASETS.get(name).about
    if about is None:
        assert name in ("photos", "airzoo-mini")
        return
    assert about.title
    assert about.licence
    assert about.page.startswith(("https://", "docs/"))
    assert not about.scene_files or about.repository
    for sentence in (*about.assumptions, *about.unverified):
        assert sentence[0].isupper() or sentence[0].isdigit()
        assert sentence.endswith(".")


def test_none_loads_numpy_for_the_help() -> None:
    code = """
import sys
from airzoo_bench.core.registry import DATASETS
for name in DATASETS.names():
    DATASETS.get(name)
heavy = {"numpy", "pandas", "pydantic", "rasterio", "pyproj"}
sys.exit(str(heavy & set(sys.modules)) if heavy & set(sys.modules) else 0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


# --- what the command does for all -----------------------------------------------------------


def test_another_package_makes_a_benchmark(
    level: None, place: Place, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "made"
    call = ("prepare", "level", "--source", place.dom.parent, "--out", out)
    assert run_main(*call, "--scenes", 2, "--tiles", "files", "--copy") == 0
    said = capsys.readouterr()
    tracks = [
        "  retrieval       4 queries, 49 tiles, 9 to 9 positives per query, mean 9.0",
        "  matching        no: its photos have no priors",
    ]
    assert said.out.splitlines() == [str(out), "s0, 4 photos", *tracks, "s1, 4 photos", *tracks]
    assert said.err.splitlines() == [
        f"next: airzoo-bench baseline retrieval level-retrieval --data {out} --out retrieval.npz"
    ]
    moved = out.rename(tmp_path / "moved")
    assert [scene.title for scene in Benchmark.open(moved).file.scenes] == ["s0", "s1"]
    for scene in load_benchmark(moved).scenes:
        hold_tiles(moved / "scenes" / scene.id, scene)
        assert len(list(scene.queries())) == 4


def test_the_folder_is_the_benchmarks_name_in_the_data_root(
    level: None, place: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    assert run_main("prepare", "level", "--source", place.dom.parent) == 0
    assert Benchmark.open(tmp_path / "data" / "level").file.name == "level"


def test_a_folder_is_replaced_only_if_that_is_asked(
    level: None, place: Place, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "made"
    assert run_main("prepare", "level", "--source", place.dom.parent, "--out", out) == 0
    before = (out / "benchmark.toml").stat().st_mtime_ns
    # Refused before anything is read, as the missing data are not.
    assert run_main("prepare", "level", "--source", tmp_path / "none", "--out", out) == 2
    assert "--force" in capsys.readouterr().err
    assert run_main("prepare", "level", "--source", tmp_path / "none", "--out", out, "--force") == 2
    assert "no such folder" in capsys.readouterr().err
    assert (out / "benchmark.toml").stat().st_mtime_ns == before
    assert run_main("prepare", "level", "--source", place.dom.parent, "--out", out, "--force") == 0
    assert (out / "benchmark.toml").stat().st_mtime_ns > before


def test_options_are_held_to_their_bounds(
    level: None, place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("prepare", "level", "--source", place.dom.parent, "--scenes", 3) == 2
    assert "--scenes" in capsys.readouterr().err


def test_scenes_without_truth_make_no_folder(tmp_path: Path) -> None:
    settings = PrepareSettings(tmp_path / "made", tmp_path)
    inputs = SceneInputs("level", pd.DataFrame(), None, None, None, None)
    nothing = SceneContent(inputs, SceneTruths(pd.DataFrame(), None, None, None), {})
    with pytest.raises(BenchmarkError, match="no track that every scene"):
        write_benchmark([nothing], photo_protocols("level", (64,)), settings)
    assert not (tmp_path / "made").exists()
