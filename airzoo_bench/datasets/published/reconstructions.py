"""What the reconstruction benchmarks have in common: protocols, files of scenes, and photos."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from airzoo_bench.core.errors import BenchmarkError, UsageError, first_of
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.core.validation import nearest
from airzoo_bench.datasets.published.places import folder_content
from airzoo_bench.protocol.lookup import protocol_of_track
from airzoo_bench.reconstruction.settings import ReconstructionProtocol

__all__ = [
    "chosen_photos",
    "files_by_scene",
    "photos_by_stem",
    "published_scenes",
    "reconstruction_protocol",
    "stem_of",
]

T = TypeVar("T")

_ENDING = re.compile("|".join(rf"\{suffix}$" for suffix in PHOTO_SUFFIXES), re.IGNORECASE)


def reconstruction_protocol(benchmark: str, root: Path) -> ReconstructionProtocol:
    """Return a benchmark's own protocol."""
    return protocol_of_track(f"{benchmark}-reconstruction", root, ReconstructionProtocol)


def published_scenes(benchmark: str) -> list[str]:
    """Return the ids of all scenes of a shipped reconstruction protocol, in its order."""
    return [scene.id for scene in reconstruction_protocol(benchmark, Path()).scenes]


def files_by_scene(
    given: Iterable[str] | None, option: str, scenes: Sequence[str]
) -> dict[str, Path]:
    """Read an option that is given as SCENE=FILE; with one scene only, FILE will do."""
    found: dict[str, Path] = {}
    for text in given or ():
        scene, equals, name = text.partition("=")
        if not (equals and scene in scenes) and len(scenes) == 1 and Path(text).is_file():
            scene, name = scenes[0], text
        if scene not in scenes or scene in found:
            raise UsageError(
                f"names {scene[:80]!r} twice"
                if scene in found
                else f"names no scene that is there{nearest(scene[:80], list(scenes))}",
                where=f"--{option} {text}",
                expected=f"SCENE=FILE with a scene among {first_of(scenes)}",
            )
        if not Path(name).is_file():
            raise UsageError("no such file", where=f"--{option} {text}", expected="SCENE=FILE")
        found[scene] = Path(name)
    return found


def photos_by_stem(folder: Path, expected: str) -> dict[str, str]:
    """Return the photos of a folder by their names without the ending, in that order."""
    there = [path for path in folder.iterdir() if path.is_file()] if folder.is_dir() else []
    names = sorted(
        path.name
        for path in there
        if path.suffix.lower() in PHOTO_SUFFIXES and not path.name.startswith(".")
    )
    if not names:
        raise BenchmarkError(
            f"holds no photo: {folder_content(folder)}",
            where=folder,
            expected=expected,
            fix="download and unpack it completely",
        )
    found: dict[str, str] = {}
    for name in names:
        other = found.setdefault(stem_of(name), name)
        if other != name:
            raise BenchmarkError(
                f"{other} and {name} claim to be one photo", where=folder, fix="keep one of them"
            )
    return dict(sorted(found.items()))


def stem_of(name: str) -> str:
    """Return a photo's name without its ending, with points for underscores."""
    return _ENDING.sub("", name.strip()).replace("_", ".")


def chosen_photos(photos: Sequence[T], every: int) -> tuple[list[T], tuple[str, ...]]:
    """Choose every Nth photo, starting with the first, and say so."""
    chosen = list(photos[::every])
    said = f"one photo in {every} is taken, {len(chosen)} of {len(photos):,} (--every)"
    return chosen, (said,) if every > 1 else ()
