from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.registry import TRACKS, Registry


def install(folder: Path, package: str, *names: str) -> None:
    """Write what an installed package leaves behind that adds tracks of these names."""
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    lines = [f"{name} = pathlib:Path" for name in names]
    (info / "entry_points.txt").write_text("\n".join(["[airzoo_bench.tracks]", *lines, ""]))


def test_a_package_adds_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, "more-tracks", "height", "depth")
    monkeypatch.syspath_prepend(tmp_path)
    assert TRACKS.names() == ["retrieval", "matching", "reconstruction", "depth", "height"]
    assert TRACKS.get("height") is Path


def test_a_name_is_added_once_and_taken_back() -> None:
    registry = Registry("airzoo_bench.none", {"built": "pathlib:Path"})
    registry.add("mine", 5)
    with pytest.raises(ValueError, match="there already"):
        registry.add("built", 6)
    assert (registry.names(), registry.get("mine")) == (["built", "mine"], 5)
    registry.remove("mine")
    with pytest.raises(KeyError):
        registry.get("mine")
