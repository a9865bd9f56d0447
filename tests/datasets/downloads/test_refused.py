"""`download` that cannot be: each refusal is told, with what to do."""

from __future__ import annotations

import builtins
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About
from tests.datasets.downloads.hub_place import FILES, offer, there
from tests.datasets.downloads.hub_server import Hub
from tests.support import run_main


def test_an_unknown_scene_is_refused(hub: Hub, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main("download", "park", "--scene", "3") == 2
    said = capsys.readouterr().err
    assert "there is no scene '3' to be fetched by itself" in said
    assert "some of 01, 02" in said


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
    assert "who/park: is not there" in capsys.readouterr().err


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


def test_what_is_not_on_the_hub_is_listed(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    links = ("https://a/1.zip", "https://a/2.zip")
    offer(
        "far", About("Far", "A made-up dataset.", "far", "https://far", "none stated", links=links)
    )
    offer(
        "farther",
        About("Farther", "A made-up dataset.", "farther", "https://farther", "none stated"),
    )
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


def test_nothing_is_asked_without_a_terminal(
    hub: Hub, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def asked(*_: object) -> str:
        raise AssertionError("a question without a terminal")

    monkeypatch.setattr(builtins, "input", asked)
    assert run_main("download", "park") == 0
