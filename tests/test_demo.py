"""The shipped demo: its command, and that AirZoo-Mini's code still makes what is shipped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from airzoo_bench.benchmark.folder import find_benchmark
from tests.demo_region import make
from tests.support import run_main


@pytest.mark.slow
def test_the_demo_keeps_its_predictions(tmp_path: Path) -> None:
    assert run_main("demo", "--out", tmp_path / "demo") == 0
    made = {path: path.stat().st_mtime_ns for path in (tmp_path / "demo").rglob("sift*.npz")}
    assert len(made) == 2
    assert run_main("demo", "--out", tmp_path / "demo") == 0
    assert made == {path: path.stat().st_mtime_ns for path in made}


@pytest.mark.slow
def test_the_shipped_region_is_what_airzoo_mini_makes(tmp_path: Path) -> None:
    made = tmp_path / "airzoo-demo"
    make(made)
    shipped = find_benchmark("airzoo-demo", tmp_path / "none").folder
    files = {path.relative_to(shipped) for path in shipped.rglob("*") if path.is_file()}
    assert files == {path.relative_to(made) for path in made.rglob("*") if path.is_file()}
    for file in files:
        if file.suffix == ".csv":
            pd.testing.assert_frame_equal(pd.read_csv(shipped / file), pd.read_csv(made / file))
        elif file.suffix == ".npz":
            with np.load(shipped / file) as old, np.load(made / file) as new:
                assert all(np.array_equal(old[key], new[key]) for key in {*old, *new})
        elif file.suffix == ".jpg":  # colours depend on the processor in their last digit
            old, new = (np.asarray(Image.open(home / file), float) for home in (shipped, made))
            assert np.abs(old - new).mean() < 0.5
        elif file.suffix in {".laz", ".parquet", ".tif", ".toml"}:
            assert (shipped / file).stat().st_size == (made / file).stat().st_size
