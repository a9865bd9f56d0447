"""Clouds in gzip files: unpacked to disk for as long as they are read."""

from __future__ import annotations

import gzip
import shutil
import tempfile
import weakref
import zlib
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import temporary_folder
from airzoo_bench.formats.clouds.cloud import FIX_COPY, Cloud, FileCloud, refusal

__all__ = ["Unpacked"]


class Unpacked:
    """What a gzip file holds, as a file that goes away with this object.

    Parameters
    ----------
    packed : Path
        Named as what it holds is, and ``.gz``.

    Raises
    ------
    PredictionError
        It is damaged, or the disk has no room.
    """

    def __init__(self, packed: Path) -> None:
        self._packed = packed
        stack = ExitStack()
        folder = stack.enter_context(temporary_folder(Path(tempfile.gettempdir()), "airzoo-bench"))
        weakref.finalize(self, stack.close)
        self.path = folder / packed.stem
        try:
            with gzip.open(packed) as source, self.path.open("wb") as target:
                shutil.copyfileobj(source, target)
        except (gzip.BadGzipFile, EOFError, zlib.error) as error:
            raise refusal(packed, "is damaged or cut off", fix=FIX_COPY) from error
        except OSError as error:
            raise refusal(
                packed,
                f"cannot be unpacked: {error.strerror}",
                fix="set TMPDIR to a folder on a larger disk",
            ) from error

    def named(self, error: PredictionError) -> PredictionError:
        """Return an error of the unpacked file as one of the packed file."""
        return refusal(self._packed, error.what, expected=error.expected, fix=error.fix)

    def cloud(self, inner: FileCloud) -> FileCloud:
        """Return the cloud in the unpacked file, which stays for as long as the cloud is used."""

        def read(points: int) -> Iterator[Cloud]:
            try:
                yield from inner.read(points)
            except PredictionError as error:
                raise self.named(error) from error

        return replace(inner, path=self._packed, kind=f"{inner.kind}, gzip", read=read)
