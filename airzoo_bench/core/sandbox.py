"""Reading what strangers wrote in a child process, under limits of memory, processor and clock.

The child calls one function of the suite and leaves its result as JSON and plain ``.npy`` files,
of which nothing is run. These are limits, not isolation: the child reads what its user may read.
A command of ``$AIRZOO_BENCH_CONTAINER``, such as ``bwrap ... {files} --bind {folder} {folder}``,
runs the child instead; ``{files}`` becomes ``--ro-bind PATH PATH`` for each file that it needs.
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
from functools import partial
from mmap import mmap
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core import errors
from airzoo_bench.core.errors import PredictionError, UsageError, UserError, printable
from airzoo_bench.core.registry import resolve

if sys.platform == "linux":
    import resource

_LIBRARIES_BYTES = 512 << 20  # that Python and all libraries take before anything is read
_ENVIRONMENT = {"ARROW_DEFAULT_MEMORY_POOL": "system", "OMP_NUM_THREADS": "1"}
_ENVIRONMENT |= {"OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"}
_SECRETS = ("GIT_TOKEN", "AIRZOO_BENCH_KEY")


@dataclasses.dataclass(frozen=True)
class Limits:
    """The memory, besides libraries and maps of files, and the time to read predictions."""

    memory_bytes: int
    cpu_s: int = 600
    wall_s: float = 1200.0


def check_limits() -> None:
    """Refuse a system that does not hold a process to its memory."""
    if sys.platform != "linux":
        fix = "run it in a container or on Linux; leave it out for predictions that you trust"
        what = f"reading under limits needs Linux: {sys.platform} holds no process to its memory"
        raise UsageError(what, where="--untrusted", fix=fix)


def call_limited(
    function: str, arguments: Mapping[str, Any], *, where: Path, limits: Limits, folder: Path
) -> Any:
    """Call ``module:function`` of the suite in a child, and return what it returned.

    Values are numbers, texts, arrays, paths, lists and dataclasses of these, context managers
    (entered and written), or have a method ``stored(folder)``, whose result is written. `where`
    are the predictions, whose maps are not copied; `folder` holds the other arrays in use.
    """
    check_limits()
    _write(folder, "job.json", [function, dict(arguments), limits], where)
    # What arguments name is seen in a container too; the folder of benchmarks, with its truth, not.
    parts = [getattr(one, "__dict__", {"": one}).values() for one in arguments.values()]
    also = [one for some in parts for one in some if isinstance(one, Path) and one.is_file()]
    _run_child(where, limits, folder, [str(one.absolute()) for one in (where, *also)])
    try:
        found = _read(folder, "answer.json", where)
    except (ArithmeticError, AttributeError, LookupError, OSError, TypeError, ValueError) as error:
        raise _refusal(where, f"what was read of it is wrong: {error}") from error
    if isinstance(found, UserError):
        raise found
    return found


def _run_child(where: Path, limits: Limits, folder: Path, files: Sequence[str]) -> None:
    paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {name: text for name, text in os.environ.items() if name not in _SECRETS}
    environment |= _ENVIRONMENT | {"PYTHONPATH": os.pathsep.join(paths)}
    binds = " ".join(shlex.join(("--ro-bind", path, path)) for path in files)
    words = environment.pop("AIRZOO_BENCH_CONTAINER", "").replace("{files}", binds)
    container = shlex.split(words.replace("{folder}", shlex.quote(str(folder))))
    command = [*container, sys.executable, "-P", "-m", __name__, str(folder), str(where)]
    streams: Any = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    child = subprocess.Popen(command, env=environment, start_new_session=True, **streams)
    try:
        code = child.wait(limits.wall_s)
    except subprocess.TimeoutExpired:
        raise _refusal(where, f"it takes more than {limits.wall_s:,.0f} seconds") from None
    finally:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)
            child.wait()
    code = 128 - code if container and code > 128 else code  # a shell's way to name a signal
    if code == -signal.SIGXCPU:
        raise _refusal(where, f"it takes more than {limits.cpu_s:,} seconds of a processor")
    if code:
        name = {-one: one.name for one in signal.Signals}.get(code, f"exit code {code}")
        raise _refusal(where, f"the process that reads it was ended ({name})")


def _refusal(where: Path, why: str) -> PredictionError:
    fix = "write or copy the files again; --max-memory sets the memory for them"
    return PredictionError(f"cannot be read under limits: {why}", where=where, fix=fix)


def main(folder: Path, where: Path) -> None:
    """Do the job in a folder; this process is the child."""
    function, arguments, limits = _read(folder, "job.json", where)
    memory = limits.memory_bytes + _LIBRARIES_BYTES
    for kind, soft, hard in (
        (resource.RLIMIT_DATA, memory, memory),
        (resource.RLIMIT_CPU, limits.cpu_s, limits.cpu_s + 5),
        (resource.RLIMIT_FSIZE, 1 << 36, 1 << 36),
        (resource.RLIMIT_CORE, 0, 0),
    ):
        most = resource.getrlimit(kind)[1] % (1 << 63)  # -1 is no limit
        resource.setrlimit(kind, (min(soft, most), min(hard, most)))
    try:
        found = resolve(function)(**arguments)
        with found if isinstance(found, AbstractContextManager) else nullcontext(found) as value:
            _write(folder, "answer.json", value, where)
        return
    except UserError as error:
        fault = error
    except MemoryError:
        fault = _refusal(where, f"it takes more than {limits.memory_bytes:,} bytes of memory")
    except Exception as error:  # noqa: BLE001 - whatever a library makes of hostile bytes
        fault = _refusal(where, f"{type(error).__name__}: {printable(error)}")
    _write(folder, "answer.json", fault, where)


# --- values as JSON, where a list after a "$" describes what JSON has not ---


def _write(folder: Path, name: str, value: Any, where: Path) -> None:
    (folder / name).write_text(json.dumps(value, default=partial(_describe, folder, where)))


def _read(folder: Path, name: str, where: Path) -> Any:
    if (folder / name).stat().st_size > 1 << 28:  # as much memory would be taken here
        raise ValueError("it has far too many entries")
    return json.loads((folder / name).read_text(), object_hook=partial(_restore, folder, where))


def _describe(folder: Path, where: Path, value: Any) -> Any:
    value = value.stored(folder) if hasattr(value, "stored") else value
    if isinstance(getattr(value, "base", None), mmap) and value.filename == where.resolve():
        return {"$": ["map", value.offset, value.dtype.str, value.shape, value.flags["F"]]}
    match value:
        case np.generic():
            return value.item()
        case Path():
            return {"$": ["path", str(value)]}
        case np.dtype():
            return {"$": ["dtype", value.str]}
        case UserError():
            texts = {name: getattr(value, name) for name in ("what", "where", "expected", "fix")}
            return {"$": ["error", type(value).__name__, texts]}
        case np.ndarray():
            number = len(list(folder.glob("[0-9]*.npy")))
            np.save(folder / f"{number}.npy", value, allow_pickle=False)
            return {"$": ["array", number]}
    kind = f"{type(value).__module__}:{type(value).__qualname__}"
    fields = [one.name for one in dataclasses.fields(value) if one.init]
    return {"$": ["dataclass", kind, {name: getattr(value, name) for name in fields}]}


def _restore(folder: Path, where: Path, found: dict[str, Any]) -> Any:
    match found.get("$"):
        case ["path", text]:
            return Path(text)
        case ["dtype", text]:
            return np.dtype(text)
        case ["array", number]:
            path = folder / f"{int(number)}.npy"
            return np.load(path, mmap_mode="c" if path.stat().st_size > 1 << 20 else None)
        case ["map", offset, str(dtype), shape, order] if np.dtype(dtype).kind in "biuf":
            return np.memmap(where, dtype, "r", offset, tuple(shape), "F" if order else "C")
        case ["error", kind, texts]:
            made: Any = getattr(errors, kind, UserError)
            if isinstance(made, type) and issubclass(made, UserError):
                return made(**texts)
        case ["dataclass", kind, fields]:
            made = resolve(kind) if kind.startswith("airzoo_bench.") else None
            if not dataclasses.is_dataclass(made):
                raise ValueError(f"{kind} is no type of the suite")
            return made(**fields)  # type: ignore[operator]
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
