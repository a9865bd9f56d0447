"""A reader in a package of its own: the example is installed, listed, and reads."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.registry import READERS
from tests.packages import ROOT, add_package, listed_when_installed
from tests.readers.retrieval_files import PROTOCOL, Place
from tests.support import run_main

EXAMPLE = ROOT / "examples" / "reader-package"


@pytest.mark.slow
def test_it_is_listed_when_it_is_installed(tmp_path: Path) -> None:
    said = listed_when_installed(EXAMPLE, tmp_path, "readers")
    assert "ranks-csv" in said
    assert "ranks.csv of my method" in said


def test_it_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "ranks-csv" not in READERS.names()
    add_package(EXAMPLE, tmp_path / "package", monkeypatch)
    place = Place()
    data = place.prepare(tmp_path / "data")
    lines = ["query,tile,similarity"]
    for scene in place.scenes:
        order, scores = place.ranked(scene)
        for query, tiles in enumerate(order.tolist()):
            rows = zip(tiles, scores[query].tolist(), strict=True)
            photo = f"{scene.id}/q{query:05d}.jpg"
            lines += [f"{photo},{scene.tile(tile)},{score!r}" for tile, score in rows]
    (tmp_path / "ranks.csv").write_text("\n".join(lines))
    command = ("eval", "retrieval", tmp_path / "ranks.csv", "--protocol", PROTOCOL, "--data", data)
    assert run_main(*command) == 0
    said = capsys.readouterr()
    assert "read by reader ranks-csv" in said.out + said.err
    assert "100.0" in said.out
