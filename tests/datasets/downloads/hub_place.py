"""Files of a made-up hub, and what a download leaves of them."""

from __future__ import annotations

import hashlib
from pathlib import Path
from types import SimpleNamespace

from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About

FILES = {
    "README.md": b"about",
    "01/drone images.zip": bytes(range(256)) * 40,
    "02/drone images.zip": b"second" * 100,
    "empty.txt": b"",
}


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
