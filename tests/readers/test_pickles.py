"""Pickles are recognised, never loaded, and the lines of the refusal make files that score."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from airzoo_bench.readers.pairs import LOFTR_DUMP, VISMATCH
from tests.matching.world import World
from tests.readers.samples import pickles

Evaluated = Callable[..., Any]


@pytest.mark.parametrize(
    ("reader", "write"),
    [(VISMATCH, pickles.write), (LOFTR_DUMP, pickles.write_loftr_dump)],
)
def test_the_lines_do_what_they_say(
    reader: Any,
    write: Callable[..., Path],
    world: World,
    tmp_path: Path,
    evaluated: Evaluated,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write(tmp_path, world)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(load=pickles.load))
    lines = reader.lines.strip().splitlines()
    exec("\n".join(lines[:-1]), {})  # noqa: S102 - the lines that the message gives
    assert lines[-1].startswith("airzoo-bench eval matching matches")
    found = evaluated(tmp_path / "matches")
    assert found.overall["error_m"] < 1e-6
    assert found.result.predictions.reader.name == "loftr"
