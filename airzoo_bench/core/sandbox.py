"""Reading what strangers wrote in a child process, under limits of memory, processor and clock.

The child calls one function of the suite and leaves a description of what it returns: JSON and
plain ``.npy`` files, which the parent maps. Nothing that the child leaves is run. These are limits,
not isolation: the child may read what its user may read. A command of ``$AIRZOO_BENCH_CONTAINER``,
such as ``bwrap ... {files} --bind {folder} {folder}``, runs the child instead; ``{files}`` becomes
``--ro-bind PATH PATH`` for the predictions, and for each further file that the child is told of.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core import errors
from airzoo_bench.core.errors import PredictionError, UsageError, UserError
from airzoo_bench.core.registry import resolve

if sys.platform == "linux":
    import resource

_PACKAGE = "airzoo_bench"
_LIBRARIES_BYTES = 512 << 20  # that Python and all libraries take before anything is read
_MOST_DISK_BYTES = 1 << 36
_MOST_ANSWER_BYTES = 256 << 20
_LAST_S = 5  # of a processor, between the signal that asks and the one that kills
_KINDS = "biufUS"
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS")
_ENVIRONMENT = dict.fromkeys(_THREADS, "1") | {"ARROW_DEFAULT_MEMORY_POOL": "system"}
_CONTAINER = "AIRZOO_BENCH_CONTAINER"
_SECRETS = ("GIT_TOKEN", "AIRZOO_BENCH_KEY")
_KEY = "$"  # of what stands for a value that JSON does not have


@dataclasses.dataclass(frozen=True)
class Limits:
    """The memory, besides libraries and maps of files, and the time to read predictions."""

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

    Arguments and result are numbers, texts, arrays, paths, lists and dataclasses of these. A result
    may be a context manager, which is entered while it is written; what has a method
    ``stored(folder)`` is written as what that returns. `where` are the predictions: arrays mapped
    from there are mapped again. `folder` holds the other arrays for as long as they are used.
    """
    check_limits()
    job = {"function": function, "arguments": dict(arguments), "where": where, "limits": limits}
    (folder / "job.json").write_text(_written(job, folder, where))
    _run_child(where, limits, folder, [str(where.absolute()), *map(str, _files(arguments))])
    answer = folder / "answer.json"
    if answer.stat().st_size > _MOST_ANSWER_BYTES:
        raise _refusal(where, "it has far too many entries")
    try:
        found = _read(answer.read_text(), folder, where)
    except (ArithmeticError, AttributeError, LookupError, OSError, TypeError, ValueError) as error:
        raise _refusal(where, f"what was read of it is wrong: {error}") from error
    if isinstance(found, UserError):
        raise found
    return found


def _files(value: Any) -> Iterator[Path]:
    """Yield the files that arguments name; the folder of benchmarks, with their truth, is none."""
    if isinstance(value, Path) and value.is_file():
        yield value.absolute()
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from _files(part)
    elif dataclasses.is_dataclass(value):
        yield from _files(vars(value))


def _run_child(where: Path, limits: Limits, folder: Path, files: Sequence[str]) -> None:
    paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {name: text for name, text in os.environ.items() if name not in _SECRETS}
    container = []
    for word in shlex.split(environment.pop(_CONTAINER, "")):
        if word == "{files}":
            container += [part for path in files for part in ("--ro-bind", path, path)]
        else:
            container.append(word.replace("{folder}", str(folder.resolve())))
    child = subprocess.Popen(
        [*container, sys.executable, "-P", "-m", __name__, str(folder), str(where)],
        env=environment | _ENVIRONMENT | {"PYTHONPATH": os.pathsep.join(paths)},
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
    if container and code > 128:  # as a shell says that a signal ended it
        code = 128 - code
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


def main(folder: Path, where: Path) -> None:
    """Do the job in a folder; this process is the child."""
    job = _read((folder / "job.json").read_text(), folder, where)
    limits = job["limits"]
    memory = limits.memory_bytes + _LIBRARIES_BYTES
    for kind, soft, hard in (
        (resource.RLIMIT_DATA, memory, memory),
        (resource.RLIMIT_CPU, limits.cpu_s, limits.cpu_s + _LAST_S),
        (resource.RLIMIT_FSIZE, _MOST_DISK_BYTES, _MOST_DISK_BYTES),
        (resource.RLIMIT_CORE, 0, 0),
    ):
        most = resource.getrlimit(kind)[1]
        most = sys.maxsize if most == resource.RLIM_INFINITY else most
        resource.setrlimit(kind, (min(soft, most), min(hard, most)))
    fault: UserError
    try:
        found = resolve(job["function"])(**job["arguments"])
        with found if isinstance(found, AbstractContextManager) else nullcontext(found) as value:
            (folder / "answer.json").write_text(_written(value, folder, where))
        return
    except UserError as error:
        fault = error
    except MemoryError:
        fault = _refusal(where, f"it takes more than {limits.memory_bytes:,} bytes of memory")
    except Exception as error:  # noqa: BLE001 - whatever a library makes of hostile bytes
        text = "".join(one if one.isprintable() else " " for one in str(error)[:200])
        fault = _refusal(where, f"{type(error).__name__}: {text}")
    (folder / "answer.json").write_text(_written(fault, folder, where))


def _written(value: Any, folder: Path, where: Path) -> str:
    return json.dumps(value, default=partial(_described, folder=folder, where=where))


def _described(value: Any, folder: Path, where: Path) -> Any:
    """Return JSON that describes a value of another type; arrays go into files."""
    if hasattr(value, "stored"):
        value = value.stored(folder)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return _described_array(value, folder, where)
    if isinstance(value, Path):
        return {_KEY: "path", "text": str(value)}
    if isinstance(value, np.dtype):
        return {_KEY: "dtype", "text": value.str}
    if isinstance(value, UserError):
        texts = {name: getattr(value, name) for name in ("what", "where", "expected", "fix")}
        return {_KEY: "error", "kind": type(value).__name__, **texts}
    fields = {one.name: getattr(value, one.name) for one in dataclasses.fields(value) if one.init}
    kind = f"{type(value).__module__}:{type(value).__qualname__}"
    return {_KEY: "dataclass", "kind": kind, "fields": fields}


def _described_array(array: np.ndarray[Any, Any], folder: Path, where: Path) -> Any:
    if array.dtype.kind not in _KINDS:
        raise TypeError(f"an array of {array.dtype}")
    root: Any = array
    while isinstance(root, np.memmap) and isinstance(root.base, np.memmap):
        root = root.base
    if isinstance(root, np.memmap) and root.filename and array.flags.c_contiguous:
        path = str(Path(str(root.filename)).resolve())
        if _is_below(path, folder, where):
            start = int(root.offset) + array.ctypes.data - root.ctypes.data
            map_of = {"path": path, "start": start, "dtype": array.dtype.str}
            return {_KEY: "map", **map_of, "shape": array.shape}
    number = len(list(folder.glob("[0-9]*.npy")))
    np.save(folder / f"{number}.npy", np.asarray(array), allow_pickle=False)
    return {_KEY: "array", "number": number}


def _is_below(path: str, *folders: Path) -> bool:
    return any(Path(path).resolve().is_relative_to(one.resolve()) for one in folders)


def _read(text: str, folder: Path, where: Path) -> Any:
    return json.loads(text, object_hook=partial(_restored, folder=folder, where=where))


def _restored(found: dict[str, Any], folder: Path, where: Path) -> Any:
    """Return the value of a description."""
    match found.get(_KEY):
        case "path":
            return Path(found["text"])
        case "dtype":
            return np.dtype(found["text"])
        case "array":
            path = folder / f"{int(found['number'])}.npy"
            return np.load(path, mmap_mode="c" if path.stat().st_size > 1 << 20 else None)
        case "map":
            dtype, shape = np.dtype(found["dtype"]), tuple(found["shape"])
            if not _is_below(found["path"], folder, where) or dtype.kind not in _KINDS:
                raise ValueError("an array that is not in the predictions")
            if 0 in shape:
                return np.empty(shape, dtype)
            return np.memmap(found["path"], dtype, "r", found["start"], shape)
        case "error":
            kind = found["kind"] if found["kind"] in errors.__all__ else "PredictionError"
            texts = {name: found[name] for name in ("where", "expected", "fix")}
            return getattr(errors, kind)(found["what"], **texts)
        case "dataclass":
            module, _, _ = found["kind"].partition(":")
            made = resolve(found["kind"]) if module.split(".")[0] == _PACKAGE else None
            if not dataclasses.is_dataclass(made):
                raise ValueError(f"{found['kind']} is no type of the suite")
            return made(**found["fields"])  # type: ignore[operator]
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
