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
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core import errors
from airzoo_bench.core.errors import PredictionError, UsageError, UserError
from airzoo_bench.core.registry import resolve

if sys.platform == "linux":
    import resource

_LIBRARIES_BYTES = 512 << 20  # that Python and all libraries take before anything is read
_MOST_DISK_BYTES = 1 << 36
_MOST_ANSWER_BYTES = 256 << 20
_LAST_S = 5  # of a processor, between the signal that asks and the one that kills
_KINDS = "biufUS"
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS")
_ENVIRONMENT = dict.fromkeys(_THREADS, "1") | {"ARROW_DEFAULT_MEMORY_POOL": "system"}
_CONTAINER = "AIRZOO_BENCH_CONTAINER"
_SECRETS = ("GIT_TOKEN", "AIRZOO_BENCH_KEY")
_TEXTS = ("what", "where", "expected", "fix")


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
    files, given = _Files(folder, where), list(arguments.values())
    job = {"function": function, "arguments": dict(arguments), "limits": limits}
    files.write("job.json", job)
    # What arguments name is seen in a container too; the folder of benchmarks, with its truth, not.
    given += [part for one in given if dataclasses.is_dataclass(one) for part in vars(one).values()]
    also = [str(one.absolute()) for one in given if isinstance(one, Path) and one.is_file()]
    _run_child(where, limits, folder, [str(where.absolute()), *also])
    try:
        if (folder / "answer.json").stat().st_size > _MOST_ANSWER_BYTES:
            raise ValueError("it has far too many entries")
        found = files.read("answer.json")
    except (ArithmeticError, AttributeError, LookupError, OSError, TypeError, ValueError) as error:
        raise _refusal(where, f"what was read of it is wrong: {error}") from error
    if isinstance(found, UserError):
        raise found
    return found


def _run_child(where: Path, limits: Limits, folder: Path, files: Sequence[str]) -> None:
    paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {name: text for name, text in os.environ.items() if name not in _SECRETS}
    environment |= _ENVIRONMENT | {"PYTHONPATH": os.pathsep.join(paths)}
    container: list[str] = []
    for word in shlex.split(environment.pop(_CONTAINER, "")):
        binds = [part for path in files for part in ("--ro-bind", path, path)]
        container += binds if word == "{files}" else [word.replace("{folder}", str(folder))]
    command = [*container, sys.executable, "-P", "-m", __name__, str(folder), str(where)]
    none = subprocess.DEVNULL
    child = subprocess.Popen(
        command, env=environment, stdin=none, stdout=none, stderr=none, start_new_session=True
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
    files = _Files(folder, where)
    job = files.read("job.json")
    limits: Limits = job["limits"]
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
            files.write("answer.json", value)
        return
    except UserError as error:
        fault = error
    except MemoryError:
        fault = _refusal(where, f"it takes more than {limits.memory_bytes:,} bytes of memory")
    except Exception as error:  # noqa: BLE001 - whatever a library makes of hostile bytes
        text = "".join(one if one.isprintable() else " " for one in str(error)[:200])
        fault = _refusal(where, f"{type(error).__name__}: {text}")
    files.write("answer.json", fault)


class _Files:
    """Values in the files of a folder: JSON, where a list after a "$" describes what JSON has not.

    An array is a file of its own, or a part of a file of the predictions.
    """

    def __init__(self, folder: Path, predictions: Path) -> None:
        self.folder, self.places = folder, (folder.resolve(), predictions.resolve())

    def write(self, name: str, value: Any) -> None:
        (self.folder / name).write_text(json.dumps(value, default=self._describe))

    def read(self, name: str) -> Any:
        return json.loads((self.folder / name).read_text(), object_hook=self._restore)

    def _describe(self, value: Any) -> Any:
        if hasattr(value, "stored"):
            value = value.stored(self.folder)
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, np.ndarray):
            return {"$": self._describe_array(value)}
        if isinstance(value, Path):
            return {"$": ["path", str(value)]}
        if isinstance(value, np.dtype):
            return {"$": ["dtype", value.str]}
        if isinstance(value, UserError):
            texts = {name: getattr(value, name) for name in _TEXTS}
            return {"$": ["error", type(value).__name__, texts]}
        kind = f"{type(value).__module__}:{type(value).__qualname__}"
        fields = [one.name for one in dataclasses.fields(value) if one.init]
        return {"$": ["dataclass", kind, {name: getattr(value, name) for name in fields}]}

    def _describe_array(self, array: np.ndarray[Any, Any]) -> list[Any]:
        if array.dtype.kind not in _KINDS:
            raise TypeError(f"an array of {array.dtype}")
        root: Any = array
        while isinstance(root, np.memmap) and isinstance(root.base, np.memmap):
            root = root.base
        if isinstance(root, np.memmap) and root.filename and array.flags.c_contiguous:
            path = Path(str(root.filename)).resolve()
            if any(path.is_relative_to(place) for place in self.places):
                start = int(root.offset) + array.ctypes.data - root.ctypes.data
                return ["map", str(path), start, array.dtype.str, array.shape]
        number = len(list(self.folder.glob("[0-9]*.npy")))
        np.save(self.folder / f"{number}.npy", np.asarray(array), allow_pickle=False)
        return ["array", number]

    def _restore(self, found: dict[str, Any]) -> Any:
        match found.get("$"):
            case ["path", text]:
                return Path(text)
            case ["dtype", text]:
                return np.dtype(text)
            case ["array", number]:
                path = self.folder / f"{int(number)}.npy"
                return np.load(path, mmap_mode="c" if path.stat().st_size > 1 << 20 else None)
            case ["map", path, start, text, shape]:
                dtype = np.dtype(text)
                inside = any(Path(path).resolve().is_relative_to(place) for place in self.places)
                if not inside or dtype.kind not in _KINDS:
                    raise ValueError("an array that is not in the predictions")
                if 0 in shape:
                    return np.empty(shape, dtype)
                return np.memmap(path, dtype, "r", start, tuple(shape))
            case ["error", kind, texts]:
                return getattr(errors, kind if kind in errors.__all__ else "UserError")(**texts)
            case ["dataclass", kind, fields]:
                made = resolve(kind) if kind.startswith("airzoo_bench.") else None
                if not dataclasses.is_dataclass(made):
                    raise ValueError(f"{kind} is no type of the suite")
                return made(**fields)  # type: ignore[operator]
        return found


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
