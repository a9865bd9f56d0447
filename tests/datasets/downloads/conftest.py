"""A made-up hub on this machine, and a folder to fetch into."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About
from tests.datasets.downloads.hub_place import FILES, offer
from tests.datasets.downloads.hub_server import Hub, served


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))
    for name in ("HF_TOKEN", "HF_ENDPOINT", "HUGGING_FACE_HUB_TOKEN"):
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
    offer(
        "park",
        About(
            "Park",
            "A made-up dataset.",
            "park",
            "https://park",
            "CC0",
            repository="who/park",
            scene_files=scenes,
        ),
    )
    with served(made) as address:
        monkeypatch.setenv("HF_ENDPOINT", address)
        yield made
    DATASETS.remove("park")
