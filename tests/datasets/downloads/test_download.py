"""`airzoo-bench download` against a server on this machine: what is fetched, and verified."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.downloads import HubFile, of_scenes
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from tests.datasets.downloads.hub_place import FILES, parts, there
from tests.datasets.downloads.hub_server import Hub
from tests.support import run_main


def test_all_files_are_fetched_and_verified(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("download", "park") == 0
    said = capsys.readouterr()
    assert there(place / "park") == FILES
    assert parts(place / "park") == []
    assert said.out == "park\n"
    assert "Park, licence: CC0" in said.err
    assert "4 files of 4 to fetch, 10.8 kB;" in said.err
    assert "4 files verified, 4 of them fetched now" in said.err
    assert "next: airzoo-bench prepare park --source park" in said.err


def test_a_second_run_fetches_nothing(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("download", "park") == 0
    hub.asked.clear()
    assert run_main("download", "park") == 0
    assert hub.fetched() == []
    assert "4 files verified, 0 of them fetched now" in capsys.readouterr().err


def test_files_that_someone_else_fetched_are_verified_and_taken(hub: Hub, place: Path) -> None:
    target = place / "elsewhere" / "01" / "drone images.zip"
    target.parent.mkdir(parents=True)
    target.write_bytes(FILES["01/drone images.zip"])
    assert run_main("download", "park", "--to", place / "elsewhere") == 0
    assert "01/drone images.zip" not in dict(hub.fetched())
    assert there(place / "elsewhere") == FILES


@pytest.mark.parametrize("content", [b"mine", bytes(10240)], ids=["shorter", "as long"])
def test_another_file_of_that_name_is_not_overwritten(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str], content: bytes
) -> None:
    target = place / "park" / "01" / "drone images.zip"
    target.parent.mkdir(parents=True)
    target.write_bytes(content)
    assert run_main("download", "park") == 2
    assert "and are not those that are published: 1 of 4 ('01/dr" in capsys.readouterr().err
    assert there(place / "park") == {"01/drone images.zip": content}


def test_a_scene_is_fetched_with_what_all_share(hub: Hub, place: Path) -> None:
    assert run_main("download", "park", "--scene", "02") == 0
    assert set(there(place / "park")) == set(FILES) - {"01/drone images.zip"}


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
