"""A benchmark in a package of its own: the example is installed, listed, prepared and scored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import poses_of, read_queries
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.table_dataset import TableDataset
from airzoo_bench.geometry.crs import to_lonlat
from tests.packages import ROOT, add_package, listed_when_installed
from tests.support import NORTH_WEST, PLACE_CRS, make_place, run_main

EXAMPLE = ROOT / "examples" / "benchmark-package"
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


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"columns": {"image": "photo"}}, "first, height"), ({"angles": "opk"}, "omega-phi-kappa")],
)
def test_a_declaration_says_what_it_lacks(changes: dict[str, Any], words: str) -> None:
    columns = {one: one for one in ("image", "x", "y", "height", "first", "second", "third")}
    whole = {"columns": columns, "lens": {"fov_deg": 70}}
    type("Whole", (TableDataset,), whole)
    with pytest.raises(TypeError, match=words):
        type("Wrong", (TableDataset,), whole | changes)


@pytest.mark.slow
def test_it_is_listed_when_it_is_installed(tmp_path: Path) -> None:
    assert "hills" in listed_when_installed(EXAMPLE, tmp_path, "prepare", "--help")


def test_it_is_prepared_and_scored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "hills" not in DATASETS.names()
    add_package(EXAMPLE, tmp_path / "package", monkeypatch)
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    command = ("prepare", "hills", "--source", make_hills(tmp_path / "Hills"))
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
