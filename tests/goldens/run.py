"""Runs commands as users do, in this process, and collects what they leave."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import platform
import re
import shlex
import shutil
import sys
import tarfile
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from tests.goldens.recipes import spoil, steps

HERE = Path(__file__).parent
# What times, versions, paths and hashes of them stand in, or what stands in another golden.
VOLATILE = ("prepared.json", "benchmark.toml")


def table(path: Path) -> dict[str, list[str]]:
    """Return the lines of a text by the section, a name in brackets, that they stand in."""
    sections: dict[str, list[str]] = {}
    for line in path.read_text("utf-8").splitlines():
        if line.startswith("["):
            lines = sections.setdefault(line.strip("[]"), [])
        elif line and not line.startswith("#"):
            lines.append(line)
    return sections


CASES = table(HERE / "cases.txt")


def unpack(name: str, home: Path) -> None:
    """Unpack the inputs of a name."""
    with tarfile.open(HERE / "inputs" / f"{name}.tar.xz") as archive:
        archive.extractall(home, filter="data")


def run(command: str, home: Path) -> tuple[int, str]:
    """Run a command in a folder, and return its exit code and all that it prints."""
    from airzoo_bench.cli.main import main

    printed = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    settings = {"AIRZOO_BENCH_DATA": "data", "COLUMNS": "200", "TERM": "dumb"}
    code: Any = 0
    with (
        contextlib.chdir(home),
        mock.patch.dict(os.environ, settings),
        mock.patch.object(sys, "argv", ["airzoo-bench", *shlex.split(command)]),
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(printed),
    ):
        try:
            main()
        except SystemExit as done:
            code = done.code or 0
    printed.flush()
    return int(code), printed.buffer.getvalue().decode()  # type: ignore[attr-defined]


def observe(name: str, home: Path) -> dict[str, Any]:
    """Run the commands of a name in turn, and return by case what is compared.

    A line ``case | recipe | command`` runs on inputs of its own that the recipe changed.
    """
    unpack(name, home / "inputs")
    found: dict[str, Any] = {}
    for line in CASES[name]:
        case, *changed = (part.strip() for part in line.split("|"))
        if changed:
            place = home / f"case{len(found)}"
            unpack(name, place)
            for step in steps(changed[0]):
                spoil(place, step)
            found[case] = _outcome(changed[1], place)
        else:
            found[case] = _outcome(case, home / "inputs")
    return found


def _outcome(command: str, home: Path) -> dict[str, Any]:
    """Run a command that succeeds, and return what it left."""
    before = _benchmarks(home)
    shutil.rmtree(home / "out", ignore_errors=True)
    evaluates = command.startswith("eval ")
    code, printed = run(f"{command} --out out" if evaluates else command, home)
    if code:
        raise AssertionError(f"{command}: exit {code}\n{printed}")
    if evaluates:
        return _result(home / "out")
    [folder] = _benchmarks(home) - before
    code, printed = run(command, home)
    if code or "nothing to do" not in printed:
        raise AssertionError(f"{command}, once more: exit {code}\n{printed}")
    return _folder(folder)


def _benchmarks(home: Path) -> set[Path]:
    return {path.parent for path in home.glob("data/*/benchmark.toml")}


def _result(out: Path) -> dict[str, Any]:
    result = json.loads((out / "result.json").read_bytes())
    protocol, predictions = result["protocol"], result["predictions"]
    kept = ("counts", "extra_queries", "scenes", "overall", "pooled", "references")
    return {
        "protocol": {key: protocol[key] for key in ("name", "version", "fingerprint")},
        "kind": predictions["kind"],
        "reader": (predictions.get("reader") or {}).get("name"),
        "notes": len(result["notes"]),
        **{key: result[key] for key in kept if key in result},
        "records": _csv(out / "records.csv"),
    }


def _folder(folder: Path) -> dict[str, Any]:
    """Return the tables and arrays of a benchmark folder by file, and the names of others."""
    readers = {".csv": _csv, ".parquet": _parquet, ".npz": _npz, ".json": _json}
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name not in VOLATILE:
            read = readers.get(path.suffix)
            found[path.relative_to(folder).as_posix()] = read(path) if read else None
    return found


def _csv(path: Path) -> dict[str, list[Any]]:
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return {name: [_value(row[n]) for row in rows] for n, name in enumerate(header)}


def _parquet(path: Path) -> dict[str, list[Any]]:
    import pyarrow.parquet as pq

    return {key: [*map(_value, values)] for key, values in pq.read_table(path).to_pydict().items()}


def _npz(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name].tolist() for name in file.files}


def _json(path: Path) -> Any:
    return json.loads(path.read_bytes())


def _value(cell: Any) -> Any:
    """Return a number where a cell holds a finite one, else its text."""
    try:
        number = float(cell)
    except (TypeError, ValueError):
        return str(cell)
    return number if np.isfinite(number) else str(cell)


def load(name: str) -> dict[str, Any]:
    """Return a golden, which is empty where it was not recorded."""
    path = HERE / "recorded" / f"{name}.json"
    return json.loads(path.read_bytes()) if path.is_file() else {"machine": "", "values": {}}


def save(name: str, values: dict[str, Any]) -> None:
    """Write a golden: a line a table's column, so that a diff shows what moved."""
    lines = json.dumps({"machine": machine(), "values": values}, indent=1, ensure_ascii=False)
    text = re.sub(r"\[\s+([^\[\]{}]*?)\s+\]", _in_a_line, lines)
    (HERE / "recorded" / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def _in_a_line(found: re.Match[str]) -> str:
    return "[" + re.sub(r",\n\s+", ", ", found[1]) + "]"


def machine() -> str:
    """Return what last digits depend on: the processor's model and the C library."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
        return f"{models[0]}, {'-'.join(platform.libc_ver())}"
    return f"{platform.processor()}, {'-'.join(platform.libc_ver())}"
