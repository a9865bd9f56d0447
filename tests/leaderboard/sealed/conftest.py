from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from PIL import Image, PngImagePlugin

from airzoo_bench.leaderboard.sealing import load_pyrage, seal
from tests.api.place import NAME, make_field
from tests.shared import made_once

SALT = "5a" * 32
TRUE_PLACE = "401234.5 3120234.5"


@dataclass(frozen=True)
class SealedField:
    """A folder with its truth, what was made of it, and the key."""

    folder: Path
    public: Path
    archive: Path
    key: Any


@pytest.fixture(scope="session")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a benchmark of every track with all files that `prepare` can write."""

    def make(root: Path) -> None:
        with mock.patch.dict("os.environ", {"AIRZOO_BENCH_DATA": str(root / "data")}):
            folder = make_field(root, "--copy", "--tiles", "files", "--crops", "files")
        add_metadata(folder / "data" / NAME / "images" / "a.png")

    return made_once(tmp_path_factory, "host", make) / "data" / NAME


def add_metadata(path: Path) -> None:
    notes = PngImagePlugin.PngInfo()
    notes.add_text("place", TRUE_PLACE)
    with Image.open(path) as image:
        exif = image.getexif()
        exif[0x010E] = TRUE_PLACE
        image.save(path, pnginfo=notes, exif=exif)
    with path.open("ab") as stream:
        stream.write(b"PK\x03\x04" + TRUE_PLACE.encode())


@pytest.fixture(scope="session")
def sealed(field: Path, tmp_path_factory: pytest.TempPathFactory) -> SealedField:
    """Seal the benchmark."""
    root = tmp_path_factory.mktemp("sealed")
    key = load_pyrage().x25519.Identity.generate()
    public, archive = root / NAME, root / "truth.age"
    seal(field, public, archive, key.to_public(), salt=SALT)
    return SealedField(field, public, archive, key)
