"""`airzoo-bench download` against a server on this machine: whole, resumed, refused, damaged."""

from __future__ import annotations

import builtins
import hashlib
import importlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.downloads import of_scenes
from airzoo_bench.datasets.hub import HubFile
from airzoo_bench.datasets.published.airzoo_real_photos import REGIONS
from airzoo_bench.datasets.published.airzoo_real_sites import DAY, SITE_SCENES, SITES
from tests.datasets.hub_server import Hub, served
from tests.support import run_main

pytest.importorskip("huggingface_hub", reason="the extra `download` is not installed")

FILES = {
    "README.md": b"about",
    "01/drone images.zip": bytes(range(256)) * 40,
    "02/drone images.zip": b"second" * 100,
    "empty.txt": b"",
}


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))
    for name in ("HF_TOKEN", "HF_ENDPOINT", "HUGGING_FACE_HUB_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    # The client waits between attempts.
    fetching = importlib.import_module("huggingface_hub.file_download")
    monkeypatch.setattr(fetching.time, "sleep", lambda _: None)
    return tmp_path


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch) -> Iterator[Hub]:
    made = Hub(dict(FILES))
    scenes = {"01": ("01/*",), "02": ("02/*",)}
    offer("park", About("Park", "https://park", "CC0", repository="who/park", scene_files=scenes))
    with served(made) as address:
        monkeypatch.setenv("HF_ENDPOINT", address)
        yield made
    DATASETS.remove("park")


def offer(name: str, about: About) -> None:
    DATASETS.add(name, SimpleNamespace(about=about, is_published=True))


def there(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    found = {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
    return {name: data for name, data in found.items() if not name.startswith(".airzoo-bench")}


def parts(folder: Path) -> list[Path]:
    return sorted((folder / ".airzoo-bench").glob("*.part"))


def part_of(folder: Path, name: str) -> Path:
    return folder / ".airzoo-bench" / f"{hashlib.sha256(FILES[name]).hexdigest()}.part"


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


def test_a_newer_version_replaces_what_this_fetched(hub: Hub, place: Path) -> None:
    assert run_main("download", "park") == 0
    hub.files["README.md"] = b"about it"
    hub.asked.clear()
    assert run_main("download", "park") == 0
    assert hub.fetched() == [("README.md", None)]
    assert there(place / "park") == hub.files


def test_a_file_that_was_changed_since_is_refused(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("download", "park") == 0
    (place / "park" / "README.md").write_bytes(b"About")
    assert run_main("download", "park") == 2
    assert "'README.md'" in capsys.readouterr().err


def test_only_the_bytes_that_lack_are_fetched(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = part_of(place / "park", "01/drone images.zip")
    part.parent.mkdir(parents=True)
    part.write_bytes(FILES["01/drone images.zip"][:7000])
    assert run_main("download", "park") == 0
    assert ("01/drone images.zip", "bytes=7000-") in hub.fetched()
    assert there(place / "park") == FILES
    assert "to fetch, 3.85 kB" in capsys.readouterr().err


def test_a_cut_connection_is_gone_on_with(hub: Hub, place: Path) -> None:
    hub.cut["01/drone images.zip"] = 5000
    assert run_main("download", "park") == 0
    spans = [span for name, span in hub.fetched() if name == "01/drone images.zip"]
    assert spans[0] is None
    assert there(place / "park") == FILES


def test_what_was_begun_wrong_is_fetched_anew(hub: Hub, place: Path) -> None:
    part = part_of(place / "park", "01/drone images.zip")
    part.parent.mkdir(parents=True)
    part.write_bytes(b"?" * 7000)
    assert run_main("download", "park") == 0
    spans = [span for name, span in hub.fetched() if name == "01/drone images.zip"]
    assert spans == ["bytes=7000-", None]
    assert there(place / "park") == FILES


@pytest.mark.parametrize("name", ["01/drone images.zip", "README.md"])
def test_a_damaged_file_does_not_appear(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    hub.wrong.add(name)
    assert run_main("download", "park") == 2
    assert f"{name} is damaged: what came is not what the dataset's list" in capsys.readouterr().err
    assert name not in there(place / "park")
    assert parts(place / "park") == []
    hub.wrong.clear()
    assert run_main("download", "park") == 0
    assert there(place / "park") == FILES


def test_a_scene_is_fetched_with_what_all_share(hub: Hub, place: Path) -> None:
    assert run_main("download", "park", "--scene", "02") == 0
    assert set(there(place / "park")) == set(FILES) - {"01/drone images.zip"}


def test_an_unknown_scene_is_refused(hub: Hub, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main("download", "park", "--scene", "3") == 2
    said = capsys.readouterr().err
    assert "there is no scene '3' to be fetched by itself" in said
    assert "some of 01, 02" in said


def test_scenes_of_airzoo_real_are_those_of_prepare() -> None:
    about = DATASETS.get("airzoo-real").about
    assert set(about.scene_files) == {*REGIONS, *SITE_SCENES}
    recon = "airzoo_real_recon"
    paths = ["README.md", "Scene1/a.JPG", "Scene2/a.JPG", f"{recon}/dom/fcw_hangtian_DSM.tif"]
    paths += [f"{recon}/{site}/{hours}/images/1_0.png" for site in SITES.values() for hours in DAY]
    files = [HubFile(path, 1, "") for path in paths]
    city = [one.path for one in of_scenes(files, about.scene_files, ["City"])]
    assert city == ["README.md", "Scene1/a.JPG"]
    plaza = [one.path for one in of_scenes(files, about.scene_files, ["plaza-12-14"])]
    assert plaza == ["README.md", paths[3], f"{recon}/guangchang/12-14/images/1_0.png"]
    with pytest.raises(UserError, match="no file of scene Rural is listed"):
        of_scenes(files[:2], about.scene_files, ["Rural"])


@pytest.mark.parametrize("name", ["uavscenes", "uav-visloc"])
def test_what_can_only_be_fetched_whole_says_so(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("download", name, "--scene", "01") == 2
    assert "can only be fetched whole" in capsys.readouterr().err


def test_a_gated_dataset_says_which_page_to_visit(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    hub.gated = True
    assert run_main("download", "park") == 2
    said = capsys.readouterr().err
    assert "access to this dataset must be asked for" in said
    assert f"visit {os.environ['HF_ENDPOINT']}/datasets/who/park, accept its terms" in said
    assert "hf auth login" in said
    assert not (place / "park").exists()
    monkeypatch.setenv("HF_TOKEN", hub.token)
    assert run_main("download", "park") == 0
    assert there(place / "park") == FILES


@pytest.mark.parametrize(
    ("status", "said"),
    [
        (401, "the login is not valid, or there is no such dataset (status 401)"),
        (403, "this login may not read it (status 403)"),
        (404, "is not there (status 404)"),
        (429, "too many requests (status 429)"),
        (500, "the server fails (status 500)"),
    ],
)
def test_each_refusal_of_the_server_is_told(
    hub: Hub, capsys: pytest.CaptureFixture[str], status: int, said: str
) -> None:
    hub.status["/api/datasets"] = status
    assert run_main("download", "park") == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("status", [403, 404, 500])
def test_a_file_that_is_refused_is_named(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str], status: int
) -> None:
    hub.status["/datasets/who/park/resolve/" + "c" * 40 + "/02/"] = status
    assert run_main("download", "park") == 2
    error = capsys.readouterr().err
    assert "datasets/who/park, 02/drone images.zip: " in error
    assert f"(status {status})" in error
    assert set(there(place / "park")) == {"01/drone images.zip"}


def test_a_dataset_that_does_not_exist(hub: Hub, capsys: pytest.CaptureFixture[str]) -> None:
    hub.repository = "who/else"
    assert run_main("download", "park") == 2
    assert "there is no such dataset, or it is private" in capsys.readouterr().err


def test_a_server_that_is_not_there(
    hub: Hub, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_ENDPOINT", "http://127.0.0.1:9")
    assert run_main("download", "park") == 2
    said = capsys.readouterr().err
    assert "cannot be reached" in said
    assert "look at the network, the proxy and HF_ENDPOINT" in said


@pytest.mark.parametrize("path", ["../out", "/etc/out", "a/../../out", "a\\b", "C:out"])
def test_a_path_that_leads_elsewhere_is_refused(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str], path: str
) -> None:
    hub.files[path] = b"x"
    assert run_main("download", "park") == 2
    assert "a path that leads elsewhere" in capsys.readouterr().err
    assert not (place / "park").exists()


def test_too_little_room_is_said_before_anything_is_fetched(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    few = SimpleNamespace(total=0, used=0, free=10_000)
    monkeypatch.setattr("airzoo_bench.datasets.downloads.shutil.disk_usage", lambda _: few)
    assert run_main("download", "park") == 2
    assert "not enough room: 10.8 kB needed, 10 kB free" in capsys.readouterr().err
    assert hub.fetched() == []
    assert run_main("download", "park", "--yes") == 0
    assert there(place / "park") == FILES


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is full")
def test_a_full_disk_keeps_what_is_there(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = part_of(place / "park", "02/drone images.zip")
    part.parent.mkdir(parents=True)
    part.symlink_to("/dev/full")
    assert run_main("download", "park") == 2
    said = capsys.readouterr().err
    assert "the disk is full" in said
    assert "make room and run this again: what is there is kept" in said
    assert set(there(place / "park")) == {"01/drone images.zip"}


def test_what_is_not_on_the_hub_is_listed(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    links = ("https://a/1.zip", "https://a/2.zip")
    offer("far", About("Far", "https://far", "none stated", links=links))
    offer("farther", About("Farther", "https://farther", "none stated"))
    try:
        assert run_main("download", "far") == 0
        said = capsys.readouterr()
        assert run_main("download", "farther") == 0
        farther = capsys.readouterr()
    finally:
        DATASETS.remove("far")
        DATASETS.remove("farther")
    assert said.out == "https://a/1.zip\nhttps://a/2.zip\n"
    assert "Far is not on Hugging Face: fetch it by hand" in said.err
    assert "wget -c" in said.err
    assert "airzoo-bench prepare far --source FOLDER" in said.err
    assert farther.out == "https://farther\n"
    assert "as the page says" in farther.err


def test_only_published_benchmarks_are_offered(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main("download", "photos") == 2
    assert "there is no published benchmark 'photos'" in capsys.readouterr().err


def test_without_the_client_it_says_how_to_install_it(
    hub: Hub, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    assert run_main("download", "park") == 2
    assert "pip install 'airzoo-bench[download]'" in capsys.readouterr().err


def test_a_damaged_record_is_left_aside(hub: Hub, place: Path) -> None:
    assert run_main("download", "park") == 0
    record = place / "park" / ".airzoo-bench" / "verified.json"
    for text in ("{", "[]", '{"README.md": 3}'):
        record.write_text(text)
        hub.asked.clear()
        assert run_main("download", "park") == 0
        assert hub.fetched() == []
    assert set(json.loads(record.read_text())) == set(FILES)


RUN = """
import sys
from airzoo_bench.cli.main import main
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About
from types import SimpleNamespace
about = About("Park", "https://park", "CC0", repository="who/park")
DATASETS.add("park", SimpleNamespace(about=about, is_published=True))
sys.argv = ["airzoo-bench", "download", "park"]
main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_after_ctrl_c_another_run_goes_on(hub: Hub, place: Path) -> None:
    big = os.urandom(1 << 20) * 64
    hub.files = {"big.bin": big}
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen([sys.executable, "-c", RUN], env=environment, cwd=place) as run:
        while not any(path.stat().st_size for path in parts(place / "park")):
            time.sleep(0.002)
            if run.poll() is not None:
                break
        run.send_signal(signal.SIGINT)
    if run.returncode == 0:
        pytest.skip("it was done before it could be stopped")
    assert run.returncode == 130
    (part,) = parts(place / "park")
    begun = part.stat().st_size
    assert 0 < begun < len(big)
    hub.asked.clear()
    assert run_main_of_all("park") == 0
    assert hub.fetched() == [("big.bin", f"bytes={begun}-")]
    assert (place / "park" / "big.bin").read_bytes() == big


def run_main_of_all(*arguments: Any) -> int:
    return run_main("download", *arguments)


def test_nothing_is_asked_without_a_terminal(
    hub: Hub, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def asked(*_: object) -> str:
        raise AssertionError("a question without a terminal")

    monkeypatch.setattr(builtins, "input", asked)
    assert run_main("download", "park") == 0
