"""What holds for every reader: exact files are perfect, in any order, and damage is no crash."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.reader import SURE, find_reader
from tests.hostile.mutations import spoil_bytes
from tests.readers.cases import (
    AMBIGUOUS,
    LISTED,
    MATCHING,
    NAMED,
    PICKLES,
    POSES,
    RECONSTRUCTION,
    RETRIEVAL,
    TRACKS,
    Worlds,
)
from tests.readers.retrieval_files import Place

SPOILT = 3  # ways a file


def test_every_reader_has_a_case() -> None:
    assert {name.split()[0] for name in TRACKS} == set(READERS.names())


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, worlds: Worlds) -> dict[str, Path]:
    """Write the files of all layouts once."""
    home = tmp_path_factory.mktemp("written")
    return {name: worlds.sample(name, home / str(n)) for n, name in enumerate(TRACKS)}


@pytest.mark.parametrize("name", TRACKS)
def test_files_are_of_their_reader_alone(name: str, written: dict[str, Path]) -> None:
    path, reader = written[name], name.split()[0]
    assert find_reader(path) == (None if name in AMBIGUOUS else reader)
    assert find_reader(path, TRACKS[name]) == reader
    sure = {one: READERS.get(one).recognise(path) for one in READERS.names()}
    assert {one for one, value in sure.items() if value >= SURE} <= {reader}


def test_own_files_are_of_no_reader(tmp_path: Path) -> None:
    path = Place().canonical(tmp_path / "own.npz")
    assert all(READERS.get(one).recognise(path) < SURE for one in READERS.names())
    assert find_reader(path) is None


@pytest.mark.parametrize("name", RETRIEVAL)
def test_descriptors_and_ranks(name: str, written: dict[str, Path], worlds: Worlds) -> None:
    """They score as the ranks of TREC, which name queries and tiles by their ids."""
    found, expected = (worlds.evaluate("retrieval", written[one]) for one in (name, "trec"))
    assert found.overall["map"] < 1.0
    assert found.overall == expected.overall
    reader = found.result.predictions.reader
    assert reader is not None
    assert reader.name == name
    assert reader.conventions


@pytest.mark.parametrize("name", MATCHING)
def test_matches_and_poses(name: str, written: dict[str, Path], worlds: Worlds) -> None:
    """They score as those that need no conversion: pixels of the whole size, R and t by name."""
    if name in PICKLES:
        with pytest.raises(UserError, match="pickle") as caught:
            worlds.evaluate("matching", written[name])
        assert caught.value.fix
        return
    names = written[name].parent / "names.txt" if name in LISTED else None
    found = worlds.evaluate("matching", written[name], names=names)
    plain = "hloc-poses" if name in POSES else "aerialextrematch"
    expected = worlds.evaluate("matching", written[plain])
    assert 0.5 < expected.overall["error_m"] < 5.0
    tolerance = 1e-4 if name == "hloc" else 1e-8  # float32
    assert found.overall == pytest.approx(expected.overall, abs=tolerance)
    assert found.records["answered"].all()
    reader = found.result.predictions.reader
    assert reader is not None
    assert reader.conventions


@pytest.mark.parametrize("name", RECONSTRUCTION)
def test_views_in_any_order(
    name: str, written: dict[str, Path], worlds: Worlds, tmp_path: Path
) -> None:
    """Exact files are perfect, and so are turned ones, where names say which view is which."""
    path = written[name]
    names = path.parent / "names.txt" if name in LISTED else None
    found = worlds.evaluate("reconstruction", path, names=names)
    reader = found.result.predictions.reader
    assert reader is not None
    assert reader.name == name.split()[0]
    assert reader.conventions
    tolerance = 1e-3 if name == "vggt-slam" else 1e-4
    assert found.overall["f1_0.2m"] == 1.0
    assert found.overall["chamfer_m"] < tolerance
    assert found.overall["ate_m"] < tolerance
    assert found.overall["pose_auc_3deg"] > 0.999
    again = worlds.sample(name, tmp_path / "turned", turned=True)
    names = None if name in NAMED else again.parent / "names.txt"
    turned = worlds.evaluate("reconstruction", again, names=names)
    assert turned.overall == pytest.approx(found.overall, abs=5e-5)


@pytest.mark.parametrize("name", TRACKS)
def test_damage_is_looked_at_without_a_word(
    name: str, written: dict[str, Path], tmp_path: Path
) -> None:
    random, source = np.random.default_rng(len(name)), written[name]
    copy: Callable[..., Any] = shutil.copytree if source.is_dir() else shutil.copyfile
    for number in range(SPOILT):
        place = tmp_path / str(number) / source.name
        place.parent.mkdir()
        copy(source, place)
        files = sorted(one for one in (place, *place.rglob("*")) if one.is_file())
        file = files[int(random.integers(len(files)))]
        content = file.read_bytes()
        cut = content[: int(random.integers(len(content) + 1))]
        file.write_bytes(cut if number % 2 else spoil_bytes(random, content))
        for reader in READERS.names():
            assert 0.0 <= READERS.get(reader).recognise(place) <= 1.0
