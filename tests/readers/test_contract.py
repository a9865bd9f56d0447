"""What holds for every reader: exact files score so; damage is recognised without a word.

Faults that are refused by name are in tests/goldens/refusals.txt.
"""

from __future__ import annotations

import numpy as np
import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.predictions import SURE, find_reader
from tests.hostile.inputs import spoil_bytes
from tests.readers.conftest import LAYOUTS

ALL = pytest.mark.parametrize("name", LAYOUTS)
UNNAMED = [
    name for name, one in LAYOUTS.items() if one.track == "reconstruction" and not one.is_named
]


def test_every_reader_has_a_layout() -> None:
    assert {name.split()[0] for name in LAYOUTS} == set(READERS.names())


@ALL
def test_files_are_of_their_reader_alone(name, worlds, tmp_path) -> None:
    path, reader = worlds.sample(name, tmp_path / "f"), name.split()[0]
    assert find_reader(path)[0] == (None if LAYOUTS[name].needs_track else reader)
    assert find_reader(path, LAYOUTS[name].track)[0] == reader
    sure = {one: READERS.get(one).recognise(path) for one in READERS.names()}
    assert {one for one, value in sure.items() if value >= SURE} <= {reader}


def test_own_files_are_of_no_reader(tmp_path) -> None:
    path = tmp_path / "own.npz"
    np.savez(path, query_ids=["east/q00000"], ranked_ids=[["east/t00000"]], protocol="made")
    assert all(READERS.get(one).recognise(path) < SURE for one in READERS.names())


@ALL
def test_exact_files_score_as_their_truth(name, worlds) -> None:
    """Layouts of one noisy truth score the same, one that needs no conversion among them."""
    layout = LAYOUTS[name]
    if layout.is_pickled:
        with pytest.raises(UserError, match="pickle") as caught:
            worlds.score(name)
        assert caught.value.fix
        return
    found, expected = worlds.score(name), worlds.score(layout.like).overall
    reader = found.result.predictions.reader
    assert reader is not None
    assert reader.name == name.split()[0]
    assert reader.conventions
    assert found.overall == pytest.approx(expected, abs=layout.tolerance)
    if layout.track == "reconstruction":
        noisy = 0.1 < expected["ate_m"] < 0.3 and 0.1 < expected["f1_0.2m"] < 0.2
    else:
        assert found.records["answered"].all()
        noisy = expected.get("map", 0.0) < 1.0 and 0.5 < expected.get("error_m", 1.0) < 5.0
    assert noisy


@pytest.mark.parametrize("name", UNNAMED)
def test_a_list_of_names_decides_which_view_is_which(name, worlds, tmp_path) -> None:
    path, names = worlds.sample(name, tmp_path), tmp_path / "names.txt"
    names.write_text("\n".join(names.read_text().splitlines()[::-1]))
    turned = worlds.evaluate("reconstruction", path, names=names)
    assert turned.overall["ate_m"] > 10 * worlds.score(name).overall["ate_m"]


@ALL
def test_damage_is_looked_at_without_a_word(name, worlds, tmp_path) -> None:
    random, place = np.random.default_rng(len(name)), worlds.sample(name, tmp_path / "f")
    files = sorted(one for one in (place, *place.rglob("*")) if one.is_file())
    for number in range(2):
        file = files[int(random.integers(len(files)))]
        content = file.read_bytes()
        cut = content[: int(random.integers(len(content) + 1))]
        file.write_bytes(cut if number % 2 else spoil_bytes(random, content))
        for reader in READERS.names():
            assert 0.0 <= READERS.get(reader).recognise(place) <= 1.0
        file.write_bytes(content)
