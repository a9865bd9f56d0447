"""Scenes as tasks: the same folder from every engine."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.settings import PrepareSettings
from airzoo_bench.engines.dask import DaskEngine, local_cluster
from airzoo_bench.engines.engine import HERE, Engine, Processes
from tests.datasets.published import image_trees, uav_visloc_tree
from tests.engines.scattered import Scattered

VARIABLE = "AIRZOO_BENCH_DATA"


def everything(folder: Path) -> dict[str, bytes]:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


TREES: dict[str, Callable[[Path], Path]] = {
    "uav-visloc": uav_visloc_tree.make_tree,
    "university-1652": image_trees.university_1652,
}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return the data root of this process, and of workers that are started after it."""
    with pytest.MonkeyPatch.context() as patch:
        root = tmp_path_factory.mktemp("root") / "data"
        patch.setenv(VARIABLE, str(root))
        yield root


@pytest.fixture(scope="module", params=[1, 2])
def cluster(request: pytest.FixtureRequest, data: Path) -> Iterator[DaskEngine]:
    """Return workers of another folder than this process."""
    with local_cluster(request.param) as engine:
        engine.client.run(os.chdir, "/")
        yield engine


@pytest.fixture(
    scope="module", params=[pytest.param("uav-visloc", marks=pytest.mark.slow), "university-1652"]
)
def tree(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return TREES[request.param](tmp_path_factory.mktemp("tree") / request.param)


def prepared(tree: Path, data: Path, folder: Path, engine: Engine) -> dict[str, bytes]:
    """Return the files of the folder that is made of a tree, which is named as the dataset."""
    shutil.rmtree(data, ignore_errors=True)  # there are maps and clouds that runs share
    dataset = DATASETS.get(tree.name)
    options = dataset.options(source=Path(tree.name))
    out = Path(os.path.relpath(folder, tree.parent))
    settings = PrepareSettings(out, data, copy=True, engine=engine)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tree.parent)
        made = dataset.prepare(options, settings)
        assert len(made.summaries) > 1
        return everything(made.folder)


@pytest.fixture(scope="module")
def here(tree: Path, data: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return prepared(tree, data, tmp_path_factory.mktemp("here") / "made", HERE)


def test_two_processes_make_the_same(
    tree: Path, data: Path, here: dict[str, bytes], tmp_path: Path
) -> None:
    assert prepared(tree, data, tmp_path / "made", Processes(2)) == here


def test_scenes_are_pure_tasks(
    tree: Path, data: Path, here: dict[str, bytes], tmp_path: Path
) -> None:
    engine = Scattered()
    assert prepared(tree, data, tmp_path / "made", engine) == here
    assert engine.stages["scenes"] > 1


@pytest.mark.slow
def test_any_number_of_workers_makes_the_same(
    tree: Path, data: Path, cluster: DaskEngine, here: dict[str, bytes], tmp_path: Path
) -> None:
    assert prepared(tree, data, tmp_path / "made", cluster) == here
