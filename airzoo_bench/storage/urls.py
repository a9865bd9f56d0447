"""Locations as people write them: paths of this machine, or URLs; nothing heavy is imported."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import quote, unquote

from airzoo_bench.core.errors import UsageError

__all__ = ["SCHEMES", "Url", "is_url", "safe_name", "url_of"]

SCHEMES = ("s3", "gs", "hf", "https", "http")
_BEGIN = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")


@dataclass(frozen=True)
class Url:
    """A place in a storage.

    Attributes
    ----------
    scheme : str
        One of `SCHEMES`.
    path : str
        What comes behind it, without a last slash: host or bucket, then names.
    query : str
        Of https, such as a signature; it goes with every file below, and is never shown.
    says_folder : bool
        Whether it was written with a last slash: in a bucket, a file and a folder may have one
        name.
    """

    scheme: str
    path: str
    query: str = ""
    says_folder: bool = False

    @property
    def name(self) -> str:
        """The last part of the path."""
        last = self.path.rpartition("/")[2]
        return unquote(last) if self.read_only else last

    @property
    def parent(self) -> Url:
        """The folder that it lies in."""
        return replace(self, path=self.path.rpartition("/")[0], says_folder=False)

    @property
    def address(self) -> str:
        """The whole of it, for a client."""
        return f"{self.scheme}://{self.path}" + (f"?{self.query}" if self.query else "")

    @property
    def read_only(self) -> bool:
        """Whether nothing can be written there."""
        return self.scheme.startswith("http")

    def child(self, relative: str) -> Url:
        """Return the place of a file below."""
        if {"", ".", ".."} & set(relative.split("/")) or {"\\", "\0"} & set(relative):
            raise UsageError(
                f"has a file that would not lie in its folder: {relative[:80]!r}",
                where=self,
                expected="relative names without '..'",
            )
        name = quote(relative) if self.read_only else relative
        return replace(self, path=f"{self.path}/{name}", says_folder=False)

    def __str__(self) -> str:
        """Return it as messages show it: without a password or a signature."""
        host, slash, rest = self.path.partition("/")
        return f"{self.scheme}://{host.rpartition('@')[2]}{slash}{rest}" + "?…" * bool(self.query)


def is_url(location: object) -> bool:
    """Tell whether a location is written as a URL."""
    return _BEGIN.match(str(location)) is not None


def url_of(location: str | Path) -> Url | None:
    """Return the URL that a location is, or None where it is a path."""
    text = str(location)
    found = _BEGIN.match(text)
    if found is None:
        return None
    scheme, path, query = found[1].lower(), text[found.end() :], ""
    if scheme.startswith("http"):
        path, _, query = path.partition("#")[0].partition("?")
    host = path.partition("/")[0]
    if scheme not in SCHEMES or not host or "?versionId=" in path:
        raise UsageError(
            "is no URL that is read here",
            where=f"{scheme}://…",  # what follows may hold a password
            expected=f"{', '.join(f'{one}://' for one in SCHEMES)}, then a bucket or host and a "
            "folder or file, of which the newest version is read",
        )
    return Url(scheme, path.rstrip("/"), query, says_folder=path.endswith("/"))


def safe_name(url: Url) -> str:
    """Return the last part of a URL as the name of a folder that is not hidden."""
    shown = url.name if "/" in url.path else url.name.rpartition("@")[2]  # of a host, no password
    return re.sub(r'[\\/:*?"<>|\0]', "_", shown)[:100].lstrip(".") or "files"
