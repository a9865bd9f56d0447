"""Pickles are recognised, never loaded, and the lines of the recipe make files that score."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.matching.world import World
from tests.readers import matching_files

PAGE = Path(__file__).parents[2] / "docs" / "recipes" / "matching.md"


@pytest.mark.parametrize(
    ("number", "write"), [(0, matching_files.write_vismatch), (1, matching_files.write_loftr_dump)]
)
def test_the_lines_do_what_they_say(
    number: int,
    write: Callable[..., Path],
    world: World,
    tmp_path: Path,
    evaluated: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write(tmp_path, world)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(load=matching_files.load_torch))
    text = PAGE.read_text(encoding="utf-8").partition("## Pickles")[2]
    lines = re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)[number]
    exec(lines, {})  # noqa: S102 - what users paste
    found = evaluated(tmp_path / "matches")
    assert found.overall["error_m"] < 1e-6
    assert found.result.predictions.reader.name == "loftr"
