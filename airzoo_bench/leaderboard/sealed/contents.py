"""What an archive of truth says of the folder that was sealed."""

from __future__ import annotations

import hashlib
from pathlib import PurePosixPath
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from airzoo_bench.core.files import canonical_json
from airzoo_bench.core.validation import Strict

__all__ = ["MANIFEST", "Contents", "SealedFile", "commitment"]

MANIFEST = "manifest.json"
"""The first member of an archive; the files of the folder stand below `files/`."""

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


def _inside(name: str) -> str:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not path.parts or "\0" in name:
        raise ValueError(f"{name!r} is no file of a folder")
    return name


class SealedFile(Strict):
    """A file of the folder.

    Attributes
    ----------
    how : {"public", "sealed", "cut"}
        Whether it stands in the public folder as it was, in the archive, or in the public folder
        without its metadata.
    cuts : tuple of (int, int)
        Of earlier archives, without use: what they hold of photos.
    """

    sha256: Sha256
    size: Annotated[int, Field(ge=0, le=1 << 50)]
    how: Literal["public", "sealed", "cut"]
    cuts: tuple[tuple[int, int], ...] = ()


class Contents(Strict):
    """The manifest of an archive: the salt, and every file of the folder."""

    format: Literal[1]
    salt: Sha256
    files: dict[Annotated[str, AfterValidator(_inside)], SealedFile]


def commitment(contents: Contents) -> str:
    """Return SHA-256 over the salt and the checksums of all files of the sealed folder."""
    sums = {name: file.sha256 for name, file in contents.files.items()}
    return hashlib.sha256(bytes.fromhex(contents.salt) + canonical_json(sums).encode()).hexdigest()
