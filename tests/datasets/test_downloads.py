"""`airzoo-bench download`: what is asked of the hub's client, and what the user hears."""

from __future__ import annotations

import fnmatch
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.downloads import others_patterns
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from tests.support import run_main

PARK: Any = None
SCENES = {"01": ("01/*", "map/*"), "02": ("02/*", "map/*")}


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[dict[str, Any]]:
    """Register a dataset, and a client that takes note of its calls."""
    made: list[dict[str, Any]] = []

    def snapshot_download(**options: Any) -> Any:
        made.append(options)
        sizes = (SimpleNamespace(file_size=n, will_download=n > 9) for n in (5, 1000, 2000))
        return list(sizes) if options.get("dry_run") else str(options["local_dir"])

    about = About("Park", "A made-up dataset.", "park", "https://park", "CC0", "who/park")
    about = About(**{**vars(about), "scene_files": SCENES})
    monkeypatch.setattr(f"{__name__}.PARK", SimpleNamespace(about=about))
    monkeypatch.setitem(DATASETS.places, "park", f"{__name__}:PARK")
    client = SimpleNamespace(snapshot_download=snapshot_download)
    monkeypatch.setitem(sys.modules, "huggingface_hub", client)
    monkeypatch.chdir(tmp_path)
    return made


def test_the_client_fetches_what_lacks(
    calls: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("download", "park", "--to", "there") == 0
    said = capsys.readouterr()
    assert said.out == "there\n"
    assert "Park, licence: CC0" in said.err
    assert "2 files to fetch, 0.003 MB" in said.err
    assert "next: airzoo-bench prepare park --source there" in said.err
    assert [one.get("dry_run", False) for one in calls] == [True, False]
    assert calls[1]["repo_id"] == "who/park"
    assert calls[1]["local_dir"] == Path("there")
    assert calls[1]["ignore_patterns"] == []


def test_a_scene_is_fetched_with_what_all_share(calls: list[dict[str, Any]]) -> None:
    assert run_main("download", "park", "--scene", "02") == 0
    assert calls[1]["ignore_patterns"] == ["01/*"]
    assert run_main("download", "park", "--scene", "3") == 2
    assert run_main("download", "uavscenes", "--scene", "01") == 2


def test_scenes_of_airzoo_real_are_those_of_prepare() -> None:
    about = DATASETS.get("airzoo-real").about
    protocols = [
        load_protocol(shipped_protocols()[f"airzoo-real-{task}"])
        for task in ("retrieval", "reconstruction")
    ]
    assert set(about.scene_files) == {scene.id for one in protocols for scene in one.scenes}
    recon = "airzoo_real_recon"
    paths = ["README.md", "Scene1/a.JPG", "Scene2/a.JPG", f"{recon}/dom/fcw_hangtian_DSM.tif"]
    paths += [
        f"{recon}/{site}/{hours}/images/1_0.png"
        for site in ("guangchang", "jiaxiao")
        for hours in ("06-08", "12-14")
    ]

    def left(scene: str) -> list[str]:
        patterns = others_patterns(about.scene_files, [scene])
        return [one for one in paths if not any(fnmatch.fnmatch(one, p) for p in patterns)]

    assert left("City") == ["README.md", "Scene1/a.JPG"]
    assert left("plaza-12-14") == [
        "README.md",
        paths[3],
        f"{recon}/guangchang/12-14/images/1_0.png",
    ]


def test_what_the_client_says_is_told(
    calls: list[dict[str, Any]], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**options: Any) -> Any:
        raise PermissionError("gated repo")

    monkeypatch.setattr(sys.modules["huggingface_hub"], "snapshot_download", refuse)
    assert run_main("download", "park") == 2
    said = capsys.readouterr().err
    assert "https://huggingface.co/datasets/who/park" in said
    assert "gated repo" in said
    assert "hf auth login" in said
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    assert run_main("download", "park") == 2
    assert "pip install" in capsys.readouterr().err


def test_what_is_not_on_the_hub_is_listed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    links = ("https://a/1.zip", "https://a/2.zip")
    about = About("Far", "A made-up dataset.", "far", "https://far", "none stated", links=links)
    monkeypatch.setattr(f"{__name__}.PARK", SimpleNamespace(about=about))
    monkeypatch.setitem(DATASETS.places, "far", f"{__name__}:PARK")
    assert run_main("download", "far") == 0
    said = capsys.readouterr()
    assert said.out == "https://a/1.zip\nhttps://a/2.zip\n"
    assert "airzoo-bench prepare far --source FOLDER" in said.err
    assert run_main("download", "photos") == 2
