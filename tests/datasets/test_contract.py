"""What every dataset keeps to, built-in or of another package; goldens hold what it makes."""

from __future__ import annotations

import os
import random
import re
import shutil
from contextlib import nullcontext
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.main import get_command

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import poses_of, read_queries
from airzoo_bench.cli.prepare import app as prepare_app
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.core.progress import silent
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import load_about, read_about
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.settings import PrepareSettings, SourceOptions
from airzoo_bench.datasets.table_dataset import PoseTable, TableDataset
from airzoo_bench.engines.dask import local_cluster
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.geometry.crs import to_lonlat
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from tests.engines.work import Scattered
from tests.goldens.recipes import spoil
from tests.goldens.run import CASES, run
from tests.support import (
    NORTH_WEST,
    PLACE_CRS,
    ROOT,
    add_package,
    listed_when_installed,
    make_place,
    run_main,
    write_raster,
)

SHARED = {"out", "tiles", "crops", "copy", "force", "jobs", "engine"}
PREPARED = [
    (name, line)
    for name, lines in CASES.items()
    for line in lines
    if line.startswith("prepare ") and "airzoo-mini" not in line and "|" not in line
]


@pytest.mark.parametrize("name", DATASETS.names())
def test_it_says_what_the_command_line_asks(name: Any) -> None:
    dataset: Dataset[Any] = DATASETS.get(name)
    about = dataset.about
    assert isinstance(dataset, Dataset)
    assert is_dataclass(dataset.options)
    assert about == load_about(name)
    assert about.title
    assert about.summary.split("\n\n")[0].endswith(".")
    assert about.page.startswith("https://") or not about.is_published
    assert not about.scene_files or about.repository
    for sentence in (*about.assumptions, *about.unverified):
        assert sentence[0].isupper() or sentence[0].isdigit()
        assert sentence.endswith(".")
    group = get_command(prepare_app).make_context("prepare", [], resilient_parsing=True)
    words = about.example.split()
    found = group.command.get_command(group, words[0])  # type: ignore[attr-defined]
    assert words[0] == name
    found.make_context(words[0], words[1:])
    flags = {flag for one in found.params for flag in one.opts}
    assert {f"--{one}" for one in SHARED} <= flags
    for field in fields(dataset.options):
        option = about.options[field.name.replace("_", "-")]
        assert option.name not in SHARED
        assert f"--{option.name}" in flags
        assert field.default is not MISSING or f"--{option.name} " in about.example + " "


def test_the_page_of_benchmarks_has_what_datasets_say() -> None:
    protocols = [load_protocol(path) for path in shipped_protocols().values()]
    rows = []
    for name, about in ((name, DATASETS.get(name).about) for name in DATASETS.names()):
        first = f"[{about.title}]({about.page}) | {about.licence}"
        for one in (one for one in protocols if about.is_published and one.benchmark == name):
            count = sum(scene.queries or 0 for scene in one.scenes)
            queries = f"{count:,}" if count else ""
            rows.append(f"| {first} | {one.name} | {len(one.scenes)} | {queries} |")
            first = " | "
    page = (ROOT / "docs" / "benchmarks.md").read_text("utf-8")
    lines = page.split("| --- |\n")[1].split("\n")
    assert lines[: len(rows) + 1] == [*rows, ""]


@pytest.mark.parametrize("number", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2))])
@pytest.mark.parametrize(("name", "command"), PREPARED, ids=[line for _, line in PREPARED])
def test_a_spoiled_file_is_no_bug_of_the_suite(name, command, number, tmp_path, tree) -> None:
    """It is named, or it is not read."""
    whole = Path(shutil.copytree(tree(name), tmp_path / "whole"))
    source = whole / "in" if (whole / "in").is_dir() else whole
    files = [path.relative_to(whole) for path in sorted(source.rglob("*")) if path.is_file()]
    order = random.Random(f"{command} {number}")
    file, action = order.choice(files), order.choice(("rm", "cut 0.5", "text <html>\\n"))
    spoil(whole, f"{file}: {action}")
    code, said = run(command, whole)
    assert code in (0, 1, 2), f"{file}: {action}: exit {code}\n{said}"
    assert "bug of the suite" not in said
    assert "fix:" in said or "expected:" in said or code == 0, f"{file}: {said}"


def prepared(source: Path, home: Path, engine: Engine) -> str:
    """Return the hash of the folder that is made of a tree."""
    dataset, data = DATASETS.get(source.name), home / "data"
    settings = PrepareSettings(home / "made", data, copy=True, engine=engine)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AIRZOO_BENCH_DATA", str(data))
        patch.chdir(source.parent)
        made = dataset.prepare(dataset.options(source=Path(source.name)), settings)
        assert len(made.summaries) > 1
    found = sha256_of_tree(made.folder)
    shutil.rmtree(home)  # there are maps and clouds that runs share
    return found


@pytest.mark.parametrize(
    "name", ["university-1652", pytest.param("uav-visloc", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    "workers", [None, *(pytest.param(n, marks=pytest.mark.slow) for n in ("processes", "cluster"))]
)
def test_scenes_are_pure_tasks(name, workers, tmp_path, tree) -> None:
    """Any workers, also of another folder than this process, make the same."""
    source, home = tmp_path / name, tmp_path / "home"
    shutil.copytree(tree(name) / "in", source)
    here = prepared(source, home, HERE)
    if workers == "processes":
        assert prepared(source, home, Engine(2)) == here
    elif workers == "cluster":
        with local_cluster(2) as cluster:
            cluster.client.run(os.chdir, "/")
            data = {"AIRZOO_BENCH_DATA": str(home / "data")}
            cluster.client.run(lambda: os.environ.update(data))  # its method would change a copy
            assert prepared(source, home, cluster) == here
    else:
        engine = Scattered()
        assert prepared(source, home, engine) == here
        assert engine.stages["scenes"] > 1


# --- benchmarks of other packages ---

EXAMPLE = ROOT / "examples" / "benchmark-package"
OTHER_CRS = "EPSG:32634"
MODULE = EXAMPLE / "src" / "airzoo_bench_hills" / "__init__.py"


def make_hills(folder: Path) -> Path:
    """Write the benchmark as it is downloaded: two scenes of the same place."""
    for scene in ("north", "south"):
        place = make_place(folder / scene)
        place.dom.rename(folder / scene / "map.tif")
        place.dsm.rename(folder / scene / "surface.tif")
        centres = np.array([*place.centres.values()]) * (1, -1) + NORTH_WEST
        rows = zip(place.centres, to_lonlat(PLACE_CRS, centres).tolist(), strict=True)
        lines = [f"{name},{lon!r},{lat!r},200,0,-90,0" for name, (lon, lat) in rows]
        header = "photo,longitude,latitude,altitude,yaw,pitch,roll"
        (folder / scene / "poses.csv").write_text("\n".join([header, *lines]))
    return folder


def test_the_example_is_short() -> None:
    assert len(MODULE.read_text().splitlines()) <= 40


PLANE = "photo east north height yaw pitch roll\na.jpg 500064 5199936 200 0 -90 0\n"
COLUMNS = {"image": "photo", "x": "east", "y": "north"}
OWN = {"name": "a", "about": load_about("odm"), "protocols": "b", "images": "{scene}/photos"}
OWN |= {"poses": PoseTable("{scene}/plane", "gimbal", COLUMNS), "dsm": "{scene}/surface.tif"}


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"plane_height_m": {"south": 9.0}, "lens": {"south": {"fx": 64.0}}}, ""),
        ({"crs": "EPSG:9", "lens": {"fx": 64.0}}, "class Own, crs"),
        ({"crs": {}, "dom": None, "dsm": None, "lens": {"fx": 64.0}}, "class Own, crs"),
        ({"lens": {"fy": 3.0}}, "class Own, lens"),
        ({"lens": {"fx": 64.0, "cx": 3.0}}, "class Own, lens"),
    ],
)
def test_scenes_differ_and_a_fault_of_a_class_is_found_there(changes, fault, tmp_path) -> None:
    options, own = SourceOptions(tmp_path), type("Own", (TableDataset,), OWN | changes)()
    make_place(tmp_path / "south")
    (tmp_path / "south" / "plane").write_text(PLANE)
    write_raster(tmp_path / "south" / "surface.tif", np.ones((1, 9, 9), np.float32), crs=OTHER_CRS)
    with pytest.raises(UserError, match=f"^{fault}") if fault else nullcontext():
        read = own.read(options, "south", silent)
        assert (read.crs, read.plane_height_m, read.cameras.focal[0, 0]) == (OTHER_CRS, 9.0, 64.0)


def test_a_declaration_says_what_is_wrong_with_it(tmp_path) -> None:
    (tmp_path / "about.toml").write_text("titel = 'Hills'")
    with pytest.raises(UserError, match=r"about\.toml.*titel\D*title, summary"):
        read_about(tmp_path / "about.toml")
    for orientation, columns in (("opk", {}), ("gimbal", {"omega": "o"})):
        with pytest.raises(ValueError, match="omega"):
            PoseTable("poses.csv", orientation, columns)  # type: ignore[arg-type]
    parent = type("Parent", (TableDataset,), {"name": "a", "about": 1, "protocols": "b"})
    with pytest.raises(TypeError, match="poses, lens"):
        parent()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("package", "command", "name"),
    [("benchmark-package", "prepare --help", "hills"), ("reader-package", "readers", "ranks-csv")],
)
def test_examples_are_listed_when_they_are_installed(package, command, name, tmp_path) -> None:
    example = ROOT / "examples" / package
    assert name in listed_when_installed(example, tmp_path, *command.split())


def test_it_is_prepared_and_scored(tmp_path, monkeypatch, capsys) -> None:
    assert "hills" not in DATASETS.names()
    add_package(EXAMPLE, tmp_path / "package", monkeypatch)
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    command = ("prepare", "hills", "--source", make_hills(tmp_path / "Hills"))
    (tmp_path / "Hills" / "south").rename(tmp_path / "Hills" / "sout")
    assert run_main(*command) == 2
    assert re.search(r"south.poses\.csv.*'sout'.*\.toml", capsys.readouterr().err)
    assert run_main(*command, "--scene", "north", "--out", tmp_path / "part") == 0
    (tmp_path / "Hills" / "sout").rename(tmp_path / "Hills" / "south")
    assert run_main(*command) == 0
    assert "licence: CC BY 4.0" in capsys.readouterr().out
    benchmark = Benchmark.open(tmp_path / "data" / "hills")
    assert [scene.id for scene in benchmark.file.scenes] == ["north", "south"]
    photos = read_queries(benchmark.scene_folder("north"), pd.DataFrame({"id": []}))
    expected = np.array([(64, 64, 200), (192, 64, 200), (64, 192, 200), (192, 192, 200)])
    centres = poses_of(photos).centres - (*NORTH_WEST, 0)
    np.testing.assert_allclose(centres * (1, -1, 1), expected, atol=1e-3)
    out = tmp_path / "retrieval.npz"
    template = ("template", "hills-retrieval", "--out", out, "--kind", "descriptors")
    for words in (template, ("check", out), ("eval", "retrieval", out)):
        assert run_main(*words) == 0
    capsys.readouterr()
    assert run_main(*command) == 0
    assert "nothing to do" in "".join(capsys.readouterr())
    for method in ("read", "scenes"):  # a slip of the package
        monkeypatch.setattr(type(DATASETS.get("hills")), method, lambda *_: {}["dsm"])
        assert run_main(*command, "--force") == 2
        assert "KeyError: 'dsm'" in capsys.readouterr().err
    assert run_main("protocols", "photos-matching") == 0  # of data that have no page
    assert ": \n" not in capsys.readouterr().out
