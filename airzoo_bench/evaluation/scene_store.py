"""Scored scenes on disk, from which `eval --resume` goes on when a run was stopped."""

from __future__ import annotations

import io
import json
import pkgutil
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.files import atomic_write, fingerprint, write_npz
from airzoo_bench.core.temporaries import PART

__all__ = ["SceneStore"]

T = TypeVar("T")

_SUFFIX = ".scene"
_PACKAGE = "airzoo_bench."


class SceneStore:
    """Keeps what is computed for a scene in a folder until the run is saved.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._run = ""

    def begin(self, run: str) -> None:
        """Set the fingerprint of the run, by which scenes of another run are told apart."""
        self._run = run

    def paths(self) -> list[Path]:
        """Return the files of scenes that are kept."""
        return list(self.folder.glob(f"*{_SUFFIX}"))

    def load_or(self, name: str, truth: object, compute: Callable[[], T]) -> T:
        """Return what is kept under a name, else compute and keep it; the truth is not written."""
        path = self.folder / f"{fingerprint([self._run, name])[:32]}{_SUFFIX}"
        absent_or_damaged = (OSError, ValueError, KeyError, zipfile.BadZipFile)
        with suppress(*absent_or_damaged), path.open("rb") as stream:
            arrays = np.load(stream, allow_pickle=False)
            kept: T = _decode(json.loads(str(arrays["tree"])), arrays, truth)
            return kept
        found = compute()
        parts = dict[str, NDArray[Any]]()
        parts["tree"] = np.array(json.dumps(_encode(found, parts, truth)))
        with atomic_write(path) as stream:
            write_npz(stream, parts)
        return found

    def remove(self) -> None:
        """Remove what is kept, and nothing else."""
        with suppress(OSError):  # there is none, or something else is in it
            for path in self.folder.iterdir():
                if path.name.endswith((_SUFFIX, PART)):
                    path.unlink()
            self.folder.rmdir()


def _encode(value: Any, arrays: dict[str, NDArray[Any]], truth: object) -> Any:
    """Return a value as JSON; its arrays and tables go into `arrays`."""
    if value is truth:
        return {"truth": True}
    if isinstance(value, Enum):
        return {"class": _class_name(value), "values": [value.value]}
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, np.ndarray | np.generic):
        arrays[key := f"array{len(arrays)}"] = np.asarray(value)
        return {"array": key, "scalar": isinstance(value, np.generic)}
    if isinstance(value, dict):
        return {"dict": {key: _encode(one, arrays, truth) for key, one in value.items()}}
    if is_dataclass(value) or hasattr(value, "_fields"):
        names = [one.name for one in fields(value)] if is_dataclass(value) else value._fields
        values = [_encode(getattr(value, name), arrays, truth) for name in names]
        return {"class": _class_name(value), "values": values}
    if isinstance(value, list | tuple):
        listed = [_encode(one, arrays, truth) for one in value]
        return {"values": listed, "tuple": isinstance(value, tuple)}
    table = io.BytesIO()
    value.to_parquet(table)
    arrays[key := f"array{len(arrays)}"] = np.frombuffer(table.getvalue(), np.uint8)
    return {"table": key}


def _class_name(value: object) -> str:
    return f"{type(value).__module__}:{type(value).__qualname__}"


def _decode(tree: Any, arrays: Any, truth: object) -> Any:
    if not isinstance(tree, dict):
        return tree
    if "truth" in tree:
        return truth
    if "array" in tree:
        return arrays[tree["array"]][()] if tree["scalar"] else arrays[tree["array"]]
    if "table" in tree:
        import pandas as pd

        return pd.read_parquet(io.BytesIO(arrays[tree["table"]].tobytes()))
    if "dict" in tree:
        return {key: _decode(one, arrays, truth) for key, one in tree["dict"].items()}
    listed = [_decode(one, arrays, truth) for one in tree["values"]]
    if "class" not in tree:
        return tuple(listed) if tree["tuple"] else listed
    if not tree["class"].startswith(_PACKAGE):
        raise ValueError(tree["class"])
    return pkgutil.resolve_name(tree["class"])(*listed)
