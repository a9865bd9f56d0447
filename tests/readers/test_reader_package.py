"""A reader in a package of its own: the example is installed, listed, and reads."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.packages import ROOT, install, run_python
from tests.readers.retrieval_support import PROTOCOL, Place

EXAMPLE = ROOT / "examples" / "reader-package"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(EXAMPLE, tmp_path_factory)


def test_it_is_listed(installed: Path) -> None:
    code, said = run_python("-m", "airzoo_bench", "readers", path=installed)
    assert code == 0, said
    assert "ranks-csv" in said
    assert "ranks.csv of my method" in said
    assert "ranks-csv" not in run_python("-m", "airzoo_bench", "readers")[1]


def test_it_reads(installed: Path, tmp_path: Path) -> None:
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
    code, said = run_python("-m", "airzoo_bench", *command, path=installed)
    assert code == 0, said
    assert "read by reader ranks-csv" in said
    assert "100.0" in said
