"""`airzoo-bench download` against a server on this machine: what is fetched, and verified."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.downloads import HubFile, of_scenes
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from tests.datasets.hub import Hub, served
from tests.support import run_main

LARGE = "01/drone images.zip"
FILES = {
    "README.md": b"about",
    LARGE: bytes(range(256)) * 40,
    "02/drone images.zip": b"second" * 100,
    "empty.txt": b"",
}


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("HF_TOKEN", "HUGGING_FACE_HUB_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    # The client waits between attempts.
    why = "the extra `download` is not installed"
    fetching = pytest.importorskip("huggingface_hub.file_download", reason=why)
    monkeypatch.setattr(fetching.time, "sleep", lambda _: None)
    return tmp_path


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch) -> Iterator[Hub]:
    made = Hub(dict(FILES))
    scenes = {"01": ("01/*",), "02": ("02/*",)}
    about = About("Park", "A made-up dataset.", "park", "https://park", "CC0", "who/park")
    about = About(**{**vars(about), "scene_files": scenes})
    DATASETS.add("park", SimpleNamespace(about=about, is_published=True))
    with served(made) as address:
        monkeypatch.setenv("HF_ENDPOINT", address)
        yield made
    DATASETS.remove("park")


def there(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    found = {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
    return {name: data for name, data in found.items() if not name.startswith(".cache")}


def test_all_files_are_fetched_once_and_verified(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("download", "park") == 0
    said = capsys.readouterr()
    assert there(place / "park") == FILES
    assert said.out == "park\n"
    assert "Park, licence: CC0" in said.err
    assert "4 files of 4 to fetch, 10.8 kB;" in said.err
    assert "4 files verified, 4 of them fetched now" in said.err
    assert "next: airzoo-bench prepare park --source park" in said.err
    hub.fetched.clear()
    assert run_main("download", "park") == 0
    assert hub.fetched == []
    hub.files["README.md"] = b"about it"
    assert run_main("download", "park") == 0
    assert hub.fetched == ["README.md"]
    assert there(place / "park") == hub.files


@pytest.mark.parametrize("content", [b"mine", bytes(10240)], ids=["shorter", "as long"])
def test_another_file_of_that_name_is_not_overwritten(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str], content: bytes
) -> None:
    target = place / "park" / LARGE
    target.parent.mkdir(parents=True)
    target.write_bytes(content)
    assert run_main("download", "park") == 2
    assert "and are not those that are published: 1 of 4 ('01/dr" in capsys.readouterr().err
    assert there(place / "park") == {LARGE: content}


@pytest.mark.parametrize("name", [LARGE, "README.md"])
def test_a_damaged_file_does_not_appear(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    hub.wrong.add(name)
    assert run_main("download", "park") == 2
    assert f"{name} is damaged: what came is not what the dataset's list" in capsys.readouterr().err
    assert name not in there(place / "park")
    hub.wrong.clear()
    assert run_main("download", "park") == 0
    assert there(place / "park") == FILES


def test_a_scene_is_fetched_with_what_all_share(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("download", "park", "--scene", "02") == 0
    assert set(there(place / "park")) == set(FILES) - {LARGE}
    assert run_main("download", "park", "--scene", "3") == 2
    assert "some of 01, 02" in capsys.readouterr().err
    assert run_main("download", "uavscenes", "--scene", "01") == 2
    assert "can only be fetched whole" in capsys.readouterr().err


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
    files = [HubFile(path, 1, "") for path in paths]
    city = [one.path for one in of_scenes(files, about.scene_files, ["City"])]
    assert city == ["README.md", "Scene1/a.JPG"]
    plaza = [one.path for one in of_scenes(files, about.scene_files, ["plaza-12-14"])]
    assert plaza == ["README.md", paths[3], f"{recon}/guangchang/12-14/images/1_0.png"]
    with pytest.raises(UserError, match="no file of scene Rural is listed"):
        of_scenes(files[:2], about.scene_files, ["Rural"])


def test_a_gated_dataset_says_which_page_to_visit(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    hub.gated = True
    assert run_main("download", "park") == 2
    said = capsys.readouterr().err
    assert f"visit {os.environ['HF_ENDPOINT']}/datasets/who/park, accept its terms" in said
    assert "hf auth login" in said
    assert not (place / "park").exists()
    monkeypatch.setenv("HF_TOKEN", hub.token)
    assert run_main("download", "park") == 0
    assert there(place / "park") == FILES


def test_a_server_that_is_not_there(
    hub: Hub, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_ENDPOINT", "http://127.0.0.1:9")
    assert run_main("download", "park") == 2
    assert "look at the network, the proxy and HF_ENDPOINT" in capsys.readouterr().err


@pytest.mark.parametrize("path", ["../out", "/etc/out", "a/../../out"])
def test_nothing_is_written_elsewhere(hub: Hub, place: Path, path: str) -> None:
    hub.files = {path: b"x"}
    assert run_main("download", "park") != 0
    assert not (place / "out").exists()
    assert not Path("/etc/out").exists()


def test_what_is_not_on_the_hub_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    links = ("https://a/1.zip", "https://a/2.zip")
    about = About("Far", "A made-up dataset.", "far", "https://far", "none stated", links=links)
    DATASETS.add("far", SimpleNamespace(about=about, is_published=True))
    try:
        assert run_main("download", "far") == 0
    finally:
        DATASETS.remove("far")
    said = capsys.readouterr()
    assert said.out == "https://a/1.zip\nhttps://a/2.zip\n"
    assert "airzoo-bench prepare far --source FOLDER" in said.err
    assert run_main("download", "photos") == 2
    assert "there is no published benchmark 'photos'" in capsys.readouterr().err


def test_without_the_client_it_says_how_to_install_it(
    hub: Hub, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    assert run_main("download", "park") == 2
    assert "pip install 'airzoo-bench[download]'" in capsys.readouterr().err
