"""What a folder of photos is made of: copies of one photo, several cameras, several days."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date, datetime
from numbers import Real
from pathlib import Path

from airzoo_bench.core.files import sha256_of
from airzoo_bench.formats.photos import opened_photo

__all__ = ["PhotoFiles", "survey_photos"]

_MODEL, _EXIF_IFD, _TAKEN, _FOCAL_MM, _SERIAL = 0x0110, 0x8769, 0x9003, 0x920A, 0xA431


@dataclass(frozen=True)
class PhotoFiles:
    """Photos of a scene as files.

    Attributes
    ----------
    copies : tuple of tuple of str
        Names of photos that hold the same bytes, a group each.
    cameras : mapping of str to tuple of str
        Names by camera (model, serial number, focal length), as EXIF has it; photos that do not
        say are left out.
    days : tuple of date
        On which the photos were taken, ascending; those that say.
    """

    copies: tuple[tuple[str, ...], ...]
    cameras: Mapping[str, tuple[str, ...]]
    days: tuple[date, ...]


def survey_photos(folder: Path, names: Iterable[str]) -> PhotoFiles:
    """Look which photos are the same file, and which camera took them when.

    Parameters
    ----------
    folder : Path
    names : iterable of str
        Relative to the folder.

    Raises
    ------
    BenchmarkError
        One is not a readable photo.
    """
    paths = {name: folder / name for name in names}
    said = {name: _camera_and_day(path) for name, path in paths.items()}
    cameras = _grouped({name: camera for name, (camera, _) in said.items() if camera})
    days = sorted({day for _, day in said.values() if day is not None})
    return PhotoFiles(_copies(paths), cameras, tuple(days))


def _copies(paths: Mapping[str, Path]) -> tuple[tuple[str, ...], ...]:
    """Group names by their bytes, which are read of files of one size only."""
    sizes = _grouped({name: str(path.stat().st_size) for name, path in paths.items()})
    alike = [name for group in sizes.values() if len(group) > 1 for name in group]
    found = _grouped({name: sha256_of(paths[name]) for name in alike})
    return tuple(group for group in found.values() if len(group) > 1)


def _grouped(keys: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    for name in sorted(keys):
        found[keys[name]] = (*found.get(keys[name], ()), name)
    return found


def _camera_and_day(path: Path) -> tuple[str, date | None]:
    with opened_photo(path) as image:
        exif = image.getexif()
        model, more = exif.get(_MODEL), exif.get_ifd(_EXIF_IFD)
    serial, focal = more.get(_SERIAL), more.get(_FOCAL_MM)
    length = float(focal) if isinstance(focal, Real) else 0.0
    parts = [_text(model), f"no. {_text(serial)}" if _text(serial) else ""]
    parts.append(f"at {length:g} mm" if length > 0.0 else "")
    return " ".join(part for part in parts if part), _day(_text(more.get(_TAKEN)))


def _text(value: object) -> str:
    """Return a text of EXIF, which may hold anything, as one that prints."""
    text = value.strip("\0 ") if isinstance(value, str) else ""
    return "".join(one for one in text if one.isprintable())[:40]


def _day(text: str) -> date | None:
    try:
        return datetime.strptime(text, "%Y:%m:%d %H:%M:%S").date()
    except ValueError:  # not stated, or all zero where the camera's clock was not set
        return None
