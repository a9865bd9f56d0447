"""A benchmark in a package of its own: the example is installed, listed, prepared and scored."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import poses_of, read_queries
from airzoo_bench.datasets.table_dataset import TableDataset
from airzoo_bench.geometry.crs import to_lonlat
from tests.packages import ROOT, install, run_python
from tests.support import NORTH_WEST, PLACE_CRS, make_place

EXAMPLE = ROOT / "examples" / "benchmark-package"
MODULE = EXAMPLE / "src" / "airzoo_bench_hills" / "__init__.py"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(EXAMPLE, tmp_path_factory)


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
        if place.images.name != "photos":
            place.images.rename(folder / scene / "photos")
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


def test_it_is_listed(installed: Path) -> None:
    code, said = run_python("-m", "airzoo_bench", "prepare", "--help", path=installed)
    assert code == 0, said
    assert "hills" in said
    assert "hills" not in run_python("-m", "airzoo_bench", "prepare", "--help")[1]


def test_it_is_prepared_and_scored(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(os.environ, "AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    source = make_hills(tmp_path / "Hills")
    command = ("-m", "airzoo_bench", "prepare", "hills", "--source", source)
    code, said = run_python(*command, path=installed)
    assert code == 0, said
    assert "licence: CC BY 4.0" in said
    benchmark = Benchmark.open(tmp_path / "data" / "hills")
    assert [scene.id for scene in benchmark.file.scenes] == ["north", "south"]
    photos = read_queries(benchmark.scene_folder("north"), benchmark_photos())
    expected = np.array([(64, 64, 200), (192, 64, 200), (64, 192, 200), (192, 192, 200)])
    centres = poses_of(photos).centres - (*NORTH_WEST, 0)
    np.testing.assert_allclose(centres * (1, -1, 1), expected, atol=1e-3)
    out = tmp_path / "retrieval.npz"
    template = ("template", "hills-retrieval", "--out", out, "--kind", "descriptors")
    for words in (template, ("check", out), ("eval", "retrieval", out)):
        code, said = run_python("-m", "airzoo_bench", *words, path=installed)
        assert code == 0, said
    assert "nothing to do" in run_python(*command, path=installed)[1]


def benchmark_photos() -> object:
    import pandas as pd

    return pd.DataFrame({"id": []})
