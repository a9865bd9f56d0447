"""Pages kept from build to build, by the hash of all that they are made from."""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from importlib import metadata, resources
from pathlib import Path

from airzoo_bench.core.files import atomic_write, canonical_json
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.site.kept_files import NO_ARCHIVE

__all__ = ["KeptPages"]

_FOLDER = resources.files("airzoo_bench.leaderboard.site")


class KeptPages:
    """Pages of an earlier build, and those that this one used.

    Parameters
    ----------
    file : Path
        An archive; without one, all pages are made.
    digests : mapping of str to str
        Of the API's files by their paths below ``api/v1/``.
    """

    def __init__(self, file: Path, digests: Mapping[str, str]) -> None:
        self.digests = digests
        self._file = file
        self._used: dict[str, list[tuple[str, bytes]]] = {}
        self._old = _read(file)
        self._new = False

    @cached_property
    def _program(self) -> str:
        """A hash of what turns values into pages."""
        digest = hashlib.sha256(f"{__version__} {metadata.version('jinja2')}".encode())
        for folder in (_FOLDER, _FOLDER / "html"):
            files = {file.name: file for file in folder.iterdir() if file.is_file()}
            for name in sorted(files):
                digest.update(files[name].read_bytes())
        return digest.hexdigest()

    def pages(
        self, given: Sequence[object], make: Callable[[], Iterable[tuple[str, bytes]]]
    ) -> Iterator[tuple[str, bytes]]:
        """Yield pages as they were made of the same before, or make them.

        Parameters
        ----------
        given : sequence
            All that they are made from, as JSON can write it.
        make : callable
        """
        text = canonical_json([self._program, *given])
        key = hashlib.sha256(text.encode()).hexdigest()
        if key not in self._old:
            self._old[key], self._new = list(make()), True
        self._used[key] = self._old[key]
        yield from self._used[key]

    def save(self) -> None:
        """Write what was used, and nothing else, for the next build."""
        if not self._new and len(self._used) == len(self._old):
            return
        with atomic_write(self._file) as stream, zipfile.ZipFile(stream, "w") as archive:
            for key, pages in self._used.items():
                for path, content in pages:
                    archive.writestr(f"{key}/{path}", content)


def _read(file: Path) -> dict[str, list[tuple[str, bytes]]]:
    found: dict[str, list[tuple[str, bytes]]] = {}
    try:
        with zipfile.ZipFile(file) as archive:
            for name in archive.namelist():
                key, _, path = name.partition("/")
                found.setdefault(key, []).append((path, archive.read(name)))
    except NO_ARCHIVE:
        return {}
    return found
