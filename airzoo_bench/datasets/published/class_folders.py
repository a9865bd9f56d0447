"""Trees of images in a folder a class, as University-1652 and those after it have them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError, counted, first_of
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.datasets.published.image_scene import ImageScene
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.retrieval.stated_truth import ImageSet, pairs_of_labels

__all__ = ["ClassImage", "class_images", "find_root", "image_set", "listed", "scene_of_classes"]

_IMAGE_SUFFIXES = (*PHOTO_SUFFIXES, ".ppm", ".bmp", ".pgm", ".webp")  # those of torchvision
_UNFINISHED = (".part", ".crdownload", ".download", ".tmp", ".aria2", ".incomplete")
_ARCHIVES = (".zip", ".rar", ".7z", ".tar", ".gz", ".tgz", ".z01")
_SHOWN = 8


@dataclass(frozen=True)
class ClassImage:
    """An image, its class (a whole number as text, without leading zeros) and its file.

    Attributes
    ----------
    name : str
        Folder and file without its ending, which ids end in.
    image : str
        The file, relative to the folder of the set.
    """

    label: str
    name: str
    image: str


def find_root(
    source: Path, places: Sequence[str], is_root: Callable[[Path], bool], layout: str
) -> Path:
    """Find a benchmark at a place below the source, or below a folder in it."""
    if not source.is_dir():
        raise BenchmarkError(
            "no such folder" if not source.exists() else "a file, not a folder",
            where=source,
            expected=layout,
            fix="unpack the download, and name the folder with --source",
        )
    for homes in ([source], sorted(path for path in source.iterdir() if path.is_dir())):
        found = [home / place for home in homes for place in places if is_root(home / place)]
        if len(found) > 1:
            raise BenchmarkError(
                f"several folders look like the benchmark: {first_of(map(str, found))}",
                where=source,
                fix="name one of them with --source",
            )
        if found:
            return found[0]
    raise BenchmarkError(
        f"the benchmark is not there; found: {listed(source)}",
        where=source,
        expected=layout,
        fix=_fix_for(source),
    )


def listed(folder: Path) -> str:
    """Name the first entries of a folder, for messages."""
    names = sorted(path.name + "/" * path.is_dir() for path in folder.iterdir())
    more = f" and {len(names) - _SHOWN:,} more" if len(names) > _SHOWN else ""
    return ", ".join(map(repr, names[:_SHOWN])) + more if names else "nothing"


def _fix_for(folder: Path) -> str:
    names = sorted(path.name for path in folder.iterdir() if path.is_file())
    for endings, fix in ((_UNFINISHED, "finish the download of"), (_ARCHIVES, "unpack")):
        found = [name for name in names if name.lower().endswith(endings)]
        if found:
            return f"{fix} {first_of(found)}"
    return "unpack the whole download there, or name another folder with --source"


def class_images(folder: Path, below: str = "") -> list[ClassImage]:
    """List the images of all class folders, sorted by class and name."""
    if not folder.is_dir():
        there = next(parent for parent in folder.parents if parent.is_dir())
        raise BenchmarkError(
            f"no such folder; found in {there.name}: {listed(there)}",
            where=folder,
            expected="a folder a class, with the images in it",
            fix=f"{_fix_for(there)}, or choose scenes that are there with --scene",
        )
    found: list[ClassImage] = []
    empty = []
    for home in sorted(_folders(folder)):
        label = _label(folder, home)
        images = _images(folder / home / below)
        if not images:
            empty.append(home)
        inside = f"{home}/{below}".rstrip("/")
        found += [ClassImage(label, f"{home}/{Path(n).stem}", f"{inside}/{n}") for n in images]
    if empty or not found:
        what = f"class folders without an image: {first_of(empty)}" if empty else "no class folder"
        raise BenchmarkError(
            what,
            where=folder,
            expected="a folder a class, with images ending in " + ", ".join(_IMAGE_SUFFIXES),
            fix="download or unpack it again",
        )
    return found


def _folders(folder: Path) -> list[str]:
    with os.scandir(folder) as entries:
        return [e.name for e in entries if e.is_dir() and not e.name.startswith((".", "__"))]


def _label(folder: Path, name: str) -> str:
    if not (name.isascii() and name.isdigit()):
        raise BenchmarkError(
            f"the folder {name!r} is no class",
            where=folder,
            expected="folders whose names are whole numbers, such as 0001",
            fix="move it elsewhere",
        )
    return str(int(name))


def _images(folder: Path) -> list[str]:
    if not folder.is_dir():
        return []
    with os.scandir(folder) as entries:
        files = [entry for entry in entries if not entry.name.startswith(".")]
    names = sorted(entry.name for entry in files)
    unfinished = [name for name in names if name.lower().endswith(_UNFINISHED)]
    if unfinished:
        raise BenchmarkError(
            f"half downloaded: {first_of(unfinished)}", where=folder, fix="finish the download"
        )
    bare = sorted(entry.name for entry in files if entry.is_file() and not entry.stat().st_size)
    if bare:
        raise BenchmarkError(
            f"files of 0 bytes: {first_of(bare)}", where=folder, fix="download or unpack them again"
        )
    images = [name for name in names if name.lower().endswith(_IMAGE_SUFFIXES)]
    odd = [name for name in images if not name.isprintable()]
    if odd:
        raise BenchmarkError(
            f"names that do not print: {first_of(map(repr, odd))}",
            where=folder,
            fix="rename the files in UTF-8",
        )
    return images


def image_set(images: Sequence[ClassImage], positions: Floats | None = None) -> ImageSet:
    """Return listed images as a set."""
    return ImageSet(
        [image.name for image in images],
        [image.image for image in images],
        positions,
        degrees=positions is not None,
    )


def scene_of_classes(
    queries: tuple[Path, Sequence[ClassImage], ImageSet],
    gallery: tuple[Path, Sequence[ClassImage], ImageSet],
) -> ImageScene:
    """Pair queries and gallery, each a folder with what was listed there, by their classes."""
    labels = [[image.label for image in images] for _, images, _ in (queries, gallery)]
    lacking = sorted(set(labels[0]) - set(labels[1]), key=int)
    if lacking:
        raise BenchmarkError(
            f"{counted(len(lacking), 'class', 'classes')} of the queries without an image: "
            f"{first_of(lacking)}",
            where=gallery[0],
            expected=f"every class of {queries[0]}",
            fix="download or unpack it again",
        )
    return ImageScene(queries[2], gallery[2], queries[0], gallery[0], pairs_of_labels(*labels))
