"""What an input is, and a case of it: its spoilt copy and a command."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from airzoo_bench.core.files import sha256_of
from tests.hostile.mutations import Random

__all__ = ["Input", "spoilt"]

Spoil = Callable[[Random, bytes], bytes]
_PREDICTIONS = ("retrieval/", "matching/", "reconstruction/", "readers/")


@dataclass(frozen=True)
class Input:
    """A kind of input.

    Attributes
    ----------
    name : str
        ``track/what``; failures are named by it.
    folder : Path
        Is copied for every case.
    file : str
        What is spoilt, relative to it.
    spoil : callable
    commands : tuple of tuples
        Arguments, with FOLDER and FILE where those of the case belong; one is drawn.
    data : str or None
        Data root, relative to the folder; None for what needs no benchmark.
    share : float
        How many cases it gets beside others; less where a case takes long.
    checksums : bool
        Put hashes right again that hold the file, in nine of ten cases.
    """

    name: str
    folder: Path
    file: str
    spoil: Spoil
    commands: tuple[tuple[str, ...], ...]
    data: str | None = None
    share: float = 1.0
    checksums: bool = False


def spoilt(one: Input, random: Random, folder: Path) -> list[str]:
    """Write a case into a folder, and return the arguments of its command."""
    shutil.copytree(one.folder, folder, dirs_exist_ok=True)
    path = folder / one.file
    before = sha256_of(path)
    path.write_bytes(one.spoil(random, path.read_bytes()))
    if one.checksums and random.random() < 0.9:
        _write_checksums(path, before)
    command = one.commands[int(random.integers(len(one.commands)))]
    if one.name.startswith(_PREDICTIONS):
        command = (*command, "--untrusted")
    return [word.replace("FOLDER", str(folder)).replace("FILE", str(path)) for word in command]


def _write_checksums(path: Path, before: str) -> None:
    """Put right what holds a file to its hash, as who made the input by hand would have."""
    after = sha256_of(path)
    for holder in (*path.parents[:6],):
        toml = holder / "benchmark.toml"
        if toml.is_file():
            toml.write_bytes(toml.read_bytes().replace(before.encode(), after.encode()))
            return
    result = path.parent / "result.json"
    if not result.is_file():
        return
    try:
        values = json.loads(result.read_bytes())
    except ValueError:
        return
    if isinstance(values, dict):
        if values.get("records_sha256") == before:
            values["records_sha256"] = after
        result.write_text(json.dumps(_with_checksum(values)))


def _with_checksum(values: dict[str, Any]) -> dict[str, Any]:
    from pydantic import ValidationError

    from airzoo_bench.results.result import Result

    try:
        return json.loads(
            Result.model_validate_json(json.dumps(values))
            .with_checksum()
            .model_dump_json(by_alias=True)
        )
    except (ValidationError, ValueError):
        return values
