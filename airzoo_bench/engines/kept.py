"""Another engine, whose finished tasks stay on disk until the run is saved."""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.temporaries import PART
from airzoo_bench.engines.engine import Engine, runs

__all__ = ["Kept", "kept_folder"]

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

_SUFFIX = ".task"
_MAGIC = b"airzoo-bench task 1"
_MARK = "finished-tasks.txt"
_WHAT = (
    "Finished tasks of a run that was not saved: `--resume` goes on from them; safe to delete.\n"
)


def kept_folder(out: Path) -> Path:
    """Return where tasks of a run are kept that is to be saved in `out`."""
    return out.with_name(f"{out.name}.unfinished")


class Kept(Engine):
    """Keeps each result as an npz with its checksum, and uses it again.

    Results must be mappings of str to arrays. A file is used that is whole and was made by the
    same task of the same run, as `begin` names it; any other is done again.

    Parameters
    ----------
    inner : Engine
        Does what is not there.
    folder : Path
    reuse : bool
        Use what is there; else it is done again, and replaced.
    """

    def __init__(self, inner: Engine, folder: Path, *, reuse: bool) -> None:
        if folder.exists() and not (folder / _MARK).is_file():
            raise UsageError(
                "this folder is where finished tasks are kept, and holds something else",
                where=folder,
                fix="move it away, or choose another --out",
            )
        self._inner, self.folder, self._reuse = inner, folder, reuse
        self._run: str | None = None
        self._stages = 0

    @property
    def leftovers(self) -> int:
        """How many tasks lie there."""
        return sum(1 for _ in self.folder.glob(f"*{_SUFFIX}"))

    def begin(self, run: str) -> None:
        """See `Engine.begin`."""
        self._run, self._stages = run, 0

    def forget(self) -> None:
        """See `Engine.forget`."""
        self.remove()

    def cut(self, count: int, size: int) -> list[slice]:
        """Cut by size on any engine: what is one task would be lost as a whole."""
        return runs(count, size)

    def map(
        self,
        work: Callable[[S, T], R],
        items: Sequence[T],
        *,
        shared: S,
        stage: str,
        name: Callable[[T], str],
    ) -> Iterator[R]:
        """See `Engine.map`."""
        if self._run is None:
            yield from self._inner.map(work, items, shared=shared, stage=stage, name=name)
            return
        self._stages += 1
        of = f"of {len(items)} {stage}"
        keys = [self._key(work, item, f"{index} {of}") for index, item in enumerate(items)]

        def done(these: Sequence[T]) -> Iterator[R]:
            return self._inner.map(work, these, shared=shared, stage=stage, name=name)

        missing = [not self._reuse or not self._file(key).is_file() for key in keys]
        fresh = done([item for item, lacks in zip(items, missing, strict=True) if lacks])
        for item, key, lacks in zip(items, keys, missing, strict=True):
            found = None if lacks else self._read(key)
            if found is None:
                result = next(fresh) if lacks else next(done([item]))
                self._write(key, cast("Mapping[str, NDArray[Any]]", result))
                yield result
            else:
                yield cast("R", found)

    def remove(self) -> None:
        """Remove what is kept, and nothing else: the run was saved, or what it read was changed."""
        with suppress(OSError):
            for path in self.folder.iterdir():
                if path.name == _MARK or path.name.endswith((_SUFFIX, PART)):
                    path.unlink()
            self.folder.rmdir()

    def _key(self, work: Callable[[S, T], R], item: T, place: str) -> str:
        function = getattr(work, "func", work)
        described = f"{function.__module__}.{function.__qualname__} {self._stages} {place}"
        digest = hashlib.sha256(f"{self._run} {described} ".encode())
        digest.update(pickle.dumps(item, protocol=5))
        return digest.hexdigest()

    def _file(self, key: str) -> Path:
        return self.folder / f"{key}{_SUFFIX}"

    def _write(self, key: str, result: Mapping[str, NDArray[Any]]) -> None:
        _check(result)
        mark = self.folder / _MARK
        if not mark.exists():
            with atomic_write(mark, "w") as stream:
                stream.write(_WHAT)
        body = io.BytesIO()
        write_npz(body, result)
        with atomic_write(self._file(key)) as stream:
            stream.write(_head(key, body.getvalue()))
            stream.write(body.getvalue())

    def _read(self, key: str) -> dict[str, NDArray[Any]] | None:
        """Return what was kept; nothing where it is damaged, or of another task."""
        try:
            head, _, body = self._file(key).read_bytes().partition(b"\n")
        except OSError:
            return None
        if head + b"\n" != _head(key, body):
            return None
        with np.load(io.BytesIO(body), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}


def _check(result: object) -> None:
    if not isinstance(result, Mapping) or not all(
        isinstance(array, np.ndarray) and not array.dtype.hasobject for array in result.values()
    ):
        raise TypeError("results of tasks that are kept must be mappings of str to arrays")


def _head(key: str, body: bytes) -> bytes:
    return b" ".join((_MAGIC, key.encode(), hashlib.sha256(body).hexdigest().encode())) + b"\n"
