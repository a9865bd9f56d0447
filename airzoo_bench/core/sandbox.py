"""Reading what strangers wrote in a child process, under limits of memory, processor and clock.

The child calls one function of the suite and leaves a description of what it returns: JSON and
plain ``.npy`` files, which the parent maps. Nothing that the child leaves is run. These are limits,
not isolation: the child may read what its user may read.
"""

from __future__ import annotations

import dataclasses
import importlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core import errors
from airzoo_bench.core.errors import PredictionError, UsageError, UserError
from airzoo_bench.core.registry import resolve

if sys.platform == "linux":
    import resource

__all__ = ["Limits", "call_limited", "check_limits"]

_PACKAGE = "airzoo_bench"
_LIBRARIES_BYTES = 512 << 20  # that Python and all libraries take before anything is read
_MOST_DISK_BYTES = 1 << 36
_MOST_ANSWER_BYTES = 256 << 20
_LAST_S = 5  # of a processor, between the signal that asks and the one that kills
_KINDS = "biufUS"
_ONE_THREAD = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"), "1"),
    "ARROW_DEFAULT_MEMORY_POOL": "system",
}


@dataclasses.dataclass(frozen=True)
class Limits:
    """What reading predictions may take.

    Attributes
    ----------
    memory_bytes : int
        Besides the libraries; maps of files do not count.
    cpu_s : int
        Seconds of a processor.
    wall_s : float
        Seconds by the clock.
    """

    memory_bytes: int
    cpu_s: int = 600
    wall_s: float = 1200.0


def check_limits() -> None:
    """Refuse a system that does not hold a process to its memory."""
    if sys.platform != "linux":
        raise UsageError(
            f"reading under limits needs Linux: {sys.platform} holds no process to its memory",
            where="--untrusted",
            fix="run it in a container or on Linux; leave it out for predictions that you trust",
        )


def call_limited(
    function: str, arguments: Mapping[str, Any], *, where: Path, limits: Limits, folder: Path
) -> Any:
    """Call ``module:function`` of the suite in a child, and return what it returned.

    It may return a context manager, which is entered while its value is written. A value in it
    that has a method ``stored(folder)`` is written as what that returns.

    Parameters
    ----------
    arguments : mapping
        Numbers, texts, paths and dataclasses of them.
    where : Path
        The predictions: arrays that the child mapped from below them are mapped again, not copied.
    folder : Path
        Empty; arrays are left there, and must stay for as long as they are used.

    Raises
    ------
    UserError
        What the function raised; PredictionError where it broke, crashed, or met a limit.
    """
    check_limits()
    job = {
        "function": function,
        "arguments": _describe(dict(arguments), folder, where),
        "where": str(where),
        "limits": dataclasses.asdict(limits),
    }
    (folder / "job.json").write_text(json.dumps(job))
    _run(where, limits, folder)
    answer = folder / "answer.json"
    if answer.stat().st_size > _MOST_ANSWER_BYTES:
        raise _refusal(where, "it has far too many entries")
    try:
        found = _restore(json.loads(answer.read_text()), folder, where)
    except (ArithmeticError, AttributeError, LookupError, OSError, TypeError, ValueError) as error:
        raise _refusal(where, f"what was read of it is wrong: {error}") from error
    if isinstance(found, UserError):
        raise found
    return found


def _run(where: Path, limits: Limits, folder: Path) -> None:
    paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    child = subprocess.Popen(
        [sys.executable, "-P", "-m", __name__, str(folder)],
        env=os.environ | _ONE_THREAD | {"PYTHONPATH": os.pathsep.join(paths)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        code = child.wait(limits.wall_s)
    except subprocess.TimeoutExpired:
        raise _refusal(where, f"it takes more than {limits.wall_s:,.0f} seconds") from None
    finally:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)
            child.wait()
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        raise _refusal(where, f"it takes more than {limits.cpu_s:,} seconds of a processor")
    if code:
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        raise _refusal(where, f"it ends the process that reads it ({name})")


def _refusal(where: Path, why: str) -> PredictionError:
    return PredictionError(
        f"cannot be read under limits: {why}",
        where=where,
        expected="predictions that are whole and no larger than they must be",
        fix="write or copy the files again; --max-memory sets the memory for them",
    )


def main(folder: Path) -> None:
    """Do in this process, the child, what the job in a folder says."""
    job = json.loads((folder / "job.json").read_text())
    where, limits = Path(job["where"]), Limits(**job["limits"])
    memory = limits.memory_bytes + _LIBRARIES_BYTES
    for kind, most in (
        (resource.RLIMIT_DATA, (memory, memory)),
        (resource.RLIMIT_CPU, (limits.cpu_s, limits.cpu_s + _LAST_S)),
        (resource.RLIMIT_FSIZE, (_MOST_DISK_BYTES, _MOST_DISK_BYTES)),
        (resource.RLIMIT_CORE, (0, 0)),
    ):
        hard = resource.getrlimit(kind)[1]
        allowed = [one if hard == resource.RLIM_INFINITY else min(one, hard) for one in most]
        resource.setrlimit(kind, (allowed[0], allowed[1]))
    try:
        arguments = _restore(job["arguments"], folder, where)
        found = resolve(job["function"])(**arguments)
        with found if isinstance(found, AbstractContextManager) else nullcontext(found) as value:
            answer = _describe(value, folder, where)
    except UserError as error:
        answer = _describe(error, folder, where)
    except MemoryError:
        why = f"it takes more than {limits.memory_bytes:,} bytes of memory"
        answer = _describe(_refusal(where, why), folder, where)
    except Exception as error:  # noqa: BLE001 - whatever a library makes of hostile bytes
        text = "".join(one if one.isprintable() else " " for one in str(error)[:200])
        answer = _describe(_refusal(where, f"{type(error).__name__}: {text}"), folder, where)
    (folder / "answer.json").write_text(json.dumps(answer))


def _describe(value: Any, folder: Path, where: Path) -> Any:
    """Return a value as JSON can hold it; arrays go into files."""
    if hasattr(value, "stored"):
        value = value.stored(folder)
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        return _describe_array(value, folder, where)
    if isinstance(value, Path | np.dtype):
        kind = "path" if isinstance(value, Path) else "dtype"
        return {kind: str(value) if isinstance(value, Path) else value.str}
    if isinstance(value, list | tuple):
        parts = [_describe(one, folder, where) for one in value]
        return parts if isinstance(value, list) else {"tuple": parts}
    if isinstance(value, dict):
        return {"dict": [[key, _describe(one, folder, where)] for key, one in value.items()]}
    kind = f"{type(value).__module__}:{type(value).__qualname__}"
    if isinstance(value, UserError):
        fields = {name: getattr(value, name) for name in ("what", "where", "expected", "fix")}
        name = type(value).__name__ if type(value).__module__ == errors.__name__ else ""
        return {"error": name or "PredictionError", "fields": fields}
    fields = {one.name: getattr(value, one.name) for one in dataclasses.fields(value) if one.init}
    return {"type": kind, "fields": _describe(fields, folder, where)}


def _describe_array(array: np.ndarray[Any, Any], folder: Path, where: Path) -> Any:
    if array.dtype.kind not in _KINDS:
        raise TypeError(f"an array of {array.dtype}")
    root: Any = array
    while isinstance(root, np.memmap) and isinstance(root.base, np.memmap):
        root = root.base
    if isinstance(root, np.memmap) and root.filename and array.flags.c_contiguous:
        path, start = Path(str(root.filename)), array.ctypes.data - root.ctypes.data
        if _is_below(path, folder, where):
            place = {"path": str(path), "offset": int(root.offset) + start}
            return {"map": place, "dtype": array.dtype.str, "shape": list(array.shape)}
    number = len(list(folder.glob("*.npy")))
    np.save(folder / f"{number}.npy", np.asarray(array), allow_pickle=False)
    return {"array": number}


def _is_below(path: Path, *folders: Path) -> bool:
    return any(path.resolve().is_relative_to(one.resolve()) for one in folders)


def _restore(found: Any, folder: Path, where: Path) -> Any:
    """Return the value that was described."""
    match found:
        case [*parts]:
            return [_restore(one, folder, where) for one in parts]
        case None | bool() | int() | float() | str():
            return found
        case {"array": number}:
            path = folder / f"{int(number)}.npy"
            return np.load(path, mmap_mode="c" if path.stat().st_size > 1 << 20 else None)
        case {"map": {"path": path, "offset": offset}, "dtype": dtype, "shape": shape}:
            return _mapped(Path(path), offset, np.dtype(dtype), tuple(shape), folder, where)
        case {"path": text} | {"dtype": text}:
            return Path(text) if "path" in found else np.dtype(text)
        case {"tuple": parts}:
            return tuple(_restore(one, folder, where) for one in parts)
        case {"dict": pairs}:
            return {key: _restore(one, folder, where) for key, one in pairs}
        case {"error": kind, "fields": fields} if kind in errors.__all__:
            return getattr(errors, kind)(fields.pop("what"), **fields)
        case {"type": kind, "fields": fields}:
            return _dataclass(kind)(**_restore(fields, folder, where))
    raise ValueError("the process that reads predictions left no description")


def _mapped(
    path: Path, offset: int, dtype: np.dtype[Any], shape: tuple[int, ...], *roots: Path
) -> Any:
    size = int(np.prod(shape, dtype=object)) * dtype.itemsize
    if not _is_below(path, *roots) or min(offset, *shape) < 0 or dtype.kind not in _KINDS:
        raise ValueError("an array that is not in the predictions")
    if not size:
        return np.empty(shape, dtype)
    if offset + size > path.stat().st_size:
        raise PredictionError("the file ends before its data does", where=path)
    return np.memmap(path, dtype, "r", offset, shape)


def _dataclass(kind: str) -> Any:
    module, _, name = kind.partition(":")
    if module.split(".")[0] != _PACKAGE:
        raise ValueError(f"{kind} is no type of the suite")
    found = getattr(importlib.import_module(module), name)
    if not (isinstance(found, type) and dataclasses.is_dataclass(found)):
        raise ValueError(f"{kind} is no type of the suite")
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]))
