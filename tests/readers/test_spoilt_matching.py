"""Spoilt samples of the matching track are refused with a message, or read."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.reader import Reading
from tests.hostile.mutations import spoil_arrays, spoil_bytes
from tests.matching.world import World
from tests.readers.samples import aerialextrematch, colmap, hloc, matchers, poses

WRITERS: dict[str, Callable[..., Path]] = {
    "hloc": hloc.write,
    "hloc-poses": poses.write,
    "loftr": matchers.write_loftr,
    "superglue": matchers.write_superglue,
    "roma": matchers.write_roma,
    "dust3r-matches": matchers.write_dust3r,
    "mast3r-visloc": matchers.write_mast3r_visloc,
    "aerialextrematch": aerialextrematch.write,
    "colmap-poses": colmap.write_model,
}
CASES = 40


@pytest.mark.parametrize("name", WRITERS)
def test_spoilt_files_end_in_a_message(name: str, world: World, tmp_path: Path) -> None:
    source = WRITERS[name](tmp_path, world)
    random = np.random.default_rng(len(name))
    reading = Reading(world.protocol, [world.truth], None, 1 << 26)
    ended: list[Any] = []
    for number in range(CASES):
        copy = tmp_path / "spoilt" / f"{number}{source.suffix}"
        copy.parent.mkdir(exist_ok=True)
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, copy)
        files = sorted(one for one in (copy, *copy.rglob("*")) if one.is_file())
        file = files[int(random.integers(len(files)))]
        spoil = spoil_arrays if file.suffix == ".npz" and number % 2 else spoil_bytes
        file.write_bytes(spoil(random, file.read_bytes()))
        reader = READERS.get(name)
        assert 0.0 <= reader.recognise(copy) <= 1.0
        try:
            ended.append(reader.read(copy, reading))
        except UserError as error:
            ended.append(error)
    assert any(isinstance(one, UserError) for one in ended)
