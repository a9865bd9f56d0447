"""`airzoo-bench download`: what is asked of the hub's client, and what the user hears."""

from __future__ import annotations

import fnmatch
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About, patterns_to_skip
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from tests.support import run_main

PARK: Any = None
FAR: Any = None
SCENES = {"01": ("01/*", "map/*"), "02": ("02/*", "map/*")}
LINKS = ("https://a/1.zip", "https://a/2.zip")


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[dict[str, Any]]:
    """Register two datasets, and a client that takes note of its calls."""
    made: list[dict[str, Any]] = []

    def snapshot_download(**options: Any) -> Any:
        made.append(options)
        sizes = (SimpleNamespace(file_size=n, will_download=n > 9) for n in (5, 1000, 2000))
        return list(sizes) if options.get("dry_run") else str(options["local_dir"])

    told = ("A made-up dataset.", "park", "https://park", "CC0")
    abouts = {"park": About("Park", *told, repository="who/park", scene_files=SCENES)}
    abouts["far"] = About("Far", *told, links=LINKS)
    for name, about in abouts.items():
        monkeypatch.setattr(f"{__name__}.{name.upper()}", SimpleNamespace(about=about))
        monkeypatch.setitem(DATASETS.places, name, f"{__name__}:{name.upper()}")
    client = SimpleNamespace(snapshot_download=snapshot_download)
    monkeypatch.setitem(sys.modules, "huggingface_hub", client)
    monkeypatch.chdir(tmp_path)
    return made


def test_the_client_fetches_missing_files(calls, capsys) -> None:
    assert run_main("download", "park", "--to", "there") == 0
    said = capsys.readouterr()
    assert said.out == "there\n"
    for words in ("licence: CC0", "2 files to fetch, 0.003 MB", "prepare park --source there"):
        assert words in said.err
    assert [one.get("dry_run", False) for one in calls] == [True, False]
    asked = {"repo_id": "who/park", "local_dir": Path("there"), "ignore_patterns": []}
    assert calls[1] | asked == calls[1]
    assert run_main("download", "park", "--scene", "02") == 0
    assert calls[3]["ignore_patterns"] == ["01/*"]


def test_no_hub_and_no_scene(calls, capsys, monkeypatch) -> None:
    assert run_main("download", "far") == 0
    said = capsys.readouterr()
    assert said.out.split() == [*LINKS]
    assert "airzoo-bench prepare far --source FOLDER" in said.err
    for words in (("park", "--scene", "3"), ("uavscenes", "--scene", "01"), ("photos",)):
        assert run_main("download", *words) == 2

    def refuse(**options: Any) -> Any:
        raise PermissionError("gated repo")

    monkeypatch.setattr(sys.modules["huggingface_hub"], "snapshot_download", refuse)
    assert run_main("download", "park") == 2
    said = capsys.readouterr()
    for words in ("https://huggingface.co/datasets/who/park", "gated repo", "hf auth login"):
        assert words in said.err
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    assert run_main("download", "park") == 2
    assert "pip install" in capsys.readouterr().err


def test_scenes_of_airzoo_real_are_those_of_prepare() -> None:
    about = DATASETS.get("airzoo-real").about
    shipped = shipped_protocols()
    tracks = ("retrieval", "reconstruction")
    protocols = [load_protocol(shipped[f"airzoo-real-{track}"]) for track in tracks]
    assert set(about.scene_files) == {scene.id for one in protocols for scene in one.scenes}
    folder = "airzoo_real_recon"
    shared = ["README.md", f"{folder}/dom/fcw_hangtian_DSM.tif"]
    plaza = f"{folder}/guangchang/12-14/images/1_0.png"
    others = [plaza.replace("12-14", "06-08"), plaza.replace("guangchang", "jiaxiao")]
    for scene, wanted in (
        ("City", ["README.md", "Scene1/a.JPG"]),
        ("plaza-12-14", [*shared, plaza]),
    ):
        patterns = patterns_to_skip(about.scene_files, [scene])
        paths = ["Scene1/a.JPG", "Scene2/a.JPG", *shared, plaza, *others]
        left = {one for one in paths if not any(fnmatch.fnmatch(one, p) for p in patterns)}
        assert left == {*wanted}
