"""What holds for every reader: over all samples, and over what is no sample of any."""

from __future__ import annotations

import inspect
import shutil
import sys
import typing
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from airzoo_bench.core.registry import READERS, TRACKS
from airzoo_bench.evaluation.reader import SURE, Reader, find_reader
from tests.hostile.mutations import spoil_bytes
from tests.readers import samples
from tests.readers.retrieval_support import Place

ENDINGS = ("", ".npz", ".npy", ".h5", ".mat", ".txt", ".run", ".ply", ".bin", ".json", ".parquet")
MAGICS = (
    *(b"", b"\x93NUMPY\x01\x00v\x00{'descr': '<f4', 'fortran_order': False, 'shape': (1, 99), }"),
    *(b"PK\x03\x04", b"\x89HDF\r\n\x1a\n", b"ply\nformat ascii 1.0\n", b"\x80\x04", b"\x1f\x8b"),
    *(b"MATLAB 5.0 MAT-file" + b" " * 105 + b"\x00\x01IM", b"a Q0 b 1 0.5 c\n", b"PAR1"),
)
SPOILT = 8  # ways a file


def _modules() -> dict[str, ModuleType]:
    names = [found.name for found in iter_modules(samples.__path__)]
    modules = {name: import_module(f"{samples.__name__}.{name}") for name in names}
    return {name: module for name, module in modules.items() if hasattr(module, "write")}


MODULES = _modules()


def _maker(write: Callable[..., Path]) -> Callable[[Path], Any]:
    """Return what makes the second argument of a sample's `write`."""
    place = list(inspect.signature(write).parameters)[1]
    kind = typing.get_type_hints(write)[place]
    found: Callable[[Path], Any] = sys.modules[kind.__module__].make_world  # type: ignore[attr-defined]
    return found


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Write all samples; a world that several share is made once."""
    worlds: dict[Any, Any] = {}
    found = {}
    for name, module in MODULES.items():
        maker = _maker(module.write)
        if maker not in worlds:
            worlds[maker] = maker(tmp_path_factory.mktemp("world"))
        found[name] = module.write(tmp_path_factory.mktemp(name), worlds[maker])
    return found


@pytest.mark.parametrize("name", MODULES)
def test_a_sample_is_of_its_reader_alone(name: str, written: dict[str, Path]) -> None:
    own = getattr(MODULES[name], "READER", name.replace("_", "-"))
    sure = {one: READERS.get(one).recognise(written[name]) for one in READERS.names()}
    assert {one for one, value in sure.items() if value >= SURE} == {own}
    assert find_reader(written[name]) == own


@pytest.mark.parametrize("name", READERS.names())
def test_readers_describe_themselves(name: str) -> None:
    reader = READERS.get(name)
    assert isinstance(reader, Reader)
    assert reader.track in TRACKS.names()
    assert reader.title
    assert reader.layout
    assert reader.methods
    assert not reader.title.endswith(".")


def test_own_files_are_of_no_reader(tmp_path: Path) -> None:
    path = Place().canonical(tmp_path / "own.npz")
    assert all(READERS.get(one).recognise(path) < SURE for one in READERS.names())
    assert find_reader(path) is None


def _recognised(path: Path) -> None:
    for name in READERS.names():
        assert 0.0 <= READERS.get(name).recognise(path) <= 1.0


@given(some.sampled_from(ENDINGS), some.sampled_from(MAGICS), some.binary(max_size=300))
def test_any_bytes_are_looked_at_without_a_word(
    tmp_path_factory: pytest.TempPathFactory, ending: str, magic: bytes, rest: bytes
) -> None:
    path = tmp_path_factory.mktemp("any") / f"file{ending}"
    path.write_bytes(magic + rest)
    _recognised(path)
    _recognised(path.parent)


def test_empty_folders_are_of_no_reader(tmp_path: Path) -> None:
    (tmp_path / "preds").mkdir()
    (tmp_path / "info.log").touch()
    _recognised(tmp_path)
    assert find_reader(tmp_path) is None


@pytest.mark.parametrize("name", MODULES)
def test_what_may_not_be_read_is_passed_over(
    name: str, written: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> Any:
        raise PermissionError("not allowed")

    monkeypatch.setattr(Path, "open", refuse)
    _recognised(written[name])


@pytest.mark.parametrize("name", MODULES)
def test_spoilt_samples_are_looked_at_without_a_word(
    name: str, written: dict[str, Path], tmp_path: Path
) -> None:
    random = np.random.default_rng(len(name))
    source = written[name]
    for number in range(SPOILT):
        copy = tmp_path / str(number) / source.name
        copy.parent.mkdir()
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, copy)
        files = sorted(one for one in (copy, *copy.rglob("*")) if one.is_file())
        file = files[int(random.integers(len(files)))]
        content = file.read_bytes()
        cut = content[: int(random.integers(len(content) + 1))]
        file.write_bytes(cut if number % 2 else spoil_bytes(random, content))
        _recognised(copy)
