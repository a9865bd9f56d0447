"""Descriptors in a mapped file: records on Dask's workers, and what makes a run another run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.engines.dask import local_cluster
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.retrieval import ranking
from tests.support import MadeScene, made_protocol, write_benchmark, write_predictions

SCENES = [MadeScene("a", [[0], [3, 4], [49]], 50), MadeScene("b", [[7], [8]], 31)]


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return write_benchmark(tmp_path / "data" / "made", made_protocol(SCENES), SCENES)


def described(path: Path, gallery: np.ndarray | None = None) -> Path:
    rng = np.random.default_rng(0)
    queries, rows = (rng.standard_normal((n, 8)).astype("f4") for n in (5, 81))
    return write_predictions(
        path,
        "made-retrieval",
        query_ids=[one for scene in SCENES for one in scene.query_ids],
        query_descriptors=queries,
        gallery_ids=[one for scene in SCENES for one in scene.tile_ids],
        gallery_descriptors=rows if gallery is None else gallery,
    )


@pytest.mark.parametrize("workers", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_records_are_the_same_bytes(
    workers: int, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ranking, "_SENT_QUERIES", 2)
    path = described(tmp_path / "p.npz")
    expected = evaluate(path, data=data).records.to_csv()
    with local_cluster(workers, 1 << 30) as engine:
        found = evaluate(path, data=data, run=Run(engine=engine))
    assert found.records.to_csv() == expected


def test_nan_is_named_as_in_one_process(data: Path, tmp_path: Path) -> None:
    rows = np.random.default_rng(1).standard_normal((81, 8)).astype("f4")
    rows[27] = np.nan
    path = described(tmp_path / "p.npz", rows)
    with local_cluster(1, 1 << 30) as engine:
        for resources in (Run(), Run(engine=engine)):
            with pytest.raises(PredictionError, match=r"1 of 50 \(a/t00027\)"):
                evaluate(path, data=data, run=resources)
