"""Inputs to spoil, and how: at their bytes, at their words, at their arrays.

Inputs are those of the goldens, clouds of every format, results, published numbers. A kind of input
is a folder and a command; a case spoils a copy of one file that the command reads.
"""

from __future__ import annotations

import io
import json
import re
import shlex
import shutil
import struct
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import ValidationError

from airzoo_bench.core.files import sha256_of
from airzoo_bench.results.result import Result
from tests.formats import cloud_support as clouds
from tests.formats import test_meshes as meshes
from tests.goldens.run import CASES, run, unpack
from tests.support import PUBLISHED

Random = np.random.Generator

_TRACKS = ("retrieval", "matching", "reconstruction")
_GOLDENS = [f"{kind}-{track}" for track in _TRACKS for kind in ("canonical", "readers")]
_TEXTS = {".csv", ".txt", ".json", ".toml", ".run", ".log", ".MRK", ".xyz", ".pts", ".obj"}
_RESULTS = (
    *("report A B --out r.html", "compare A B", "table A B --intervals"),
    *(f"table A B --format {form}" for form in ("latex", "csv", "html", "terminal")),
)


@dataclass(frozen=True)
class Input:
    """A kind of input: a command in a folder, and how many cases it gets beside others."""

    name: str
    folder: Path
    command: str
    share: float = 1.0

    def files(self) -> Iterator[list[Path]]:
        """Yield the files that the command names, and those of the benchmark."""
        words = [self.folder / word for word in shlex.split(self.command)]
        for some in (words, [self.folder / "data", self.folder / "sources"]):
            tops = [path for path in some if path.exists()]
            below = [path for top in tops for path in ([top] if top.is_file() else top.rglob("*"))]
            yield sorted(path for path in below if path.is_file())


def make_inputs(home: Path) -> list[Input]:
    """Make a sound input of every kind below a folder."""
    made = []
    for name in (*_GOLDENS, "surveys"):
        folder = home / name
        unpack(name, folder)
        given = [line for line in CASES[name] if "|" not in line]
        if name == "surveys":
            made += [Input(name, folder, one, 0.1) for one in given if one.startswith("prepare")]
        else:
            made += [Input(name, folder, one, 0.5) for one in given]
            checks = ["check " + one.split(" ", 2)[2].partition(" --reader")[0] for one in given]
            made += [Input(name, folder, one, 0.3) for one in checks]
    folder = home / "canonical-reconstruction"
    for path in _clouds(folder):
        command = f"eval reconstruction {path} --protocol made-reconstruction"
        made.append(Input("clouds-reconstruction", folder, command, 0.4))
    return [*made, *_results(home), _published(home / "audit")]


def _clouds(folder: Path) -> list[str]:
    """Write a cloud of a scene in every format, each in a folder of its own."""
    columns = clouds.made(40)
    rows = clouds.text_rows({name: columns[name] for name in ("x", "y", "z", *clouds.COLOURS)})
    quads = {"faces_header": meshes.QUAD_HEADER, "faces": meshes.BINARY_QUADS["<"]}
    writers: dict[str, Callable[[Path], object]] = {
        name: partial(write, columns=columns) for name, write in clouds.WRITERS.items()
    }
    writers |= {
        "a.obj": lambda path: path.write_text(meshes.OBJ),
        "a.glb": lambda path: meshes.write_glb(path, meshes.DOCUMENT),
        "mesh.ply": lambda path: clouds.write_ply(path, meshes.COLUMNS, **quads),
        "a.csv": lambda path: path.write_text("x,y,z,r,g,b\n" + rows.replace(" ", ",")),
    }
    made = []
    for name, write in writers.items():
        path = folder / "formats" / name / f"yard{Path(name).suffix}"
        path.parent.mkdir(parents=True)
        write(path)
        made.append(path.relative_to(folder).as_posix())
    return made


def _results(home: Path) -> list[Input]:
    source, folder = home / "canonical-retrieval", home / "results"
    folder.mkdir()
    for name in "AB":
        command = f"eval retrieval ranked.npz --out {folder / name} --method {name}"
        code, said = run(command, source)
        assert code == 0, said
    return [Input("results", folder, one, 0.2) for one in _RESULTS]


def _published(folder: Path) -> Input:
    folder.mkdir()
    lines = PUBLISHED.read_text("utf-8").splitlines(keepends=True)
    (folder / "long.csv").write_text("".join(lines[:40]), encoding="utf-8")
    return Input("audit", folder, "audit long.csv")


def spoilt(one: Input, random: Random, folder: Path) -> list[str]:
    """Write a case into a folder, and return the words of its command."""
    shutil.copytree(one.folder, folder, dirs_exist_ok=True, symlinks=True)
    named, others = Input(one.name, folder, one.command).files()
    some = others if others and (not named or random.random() < 0.25) else named
    path = some[int(random.integers(len(some)))]
    before = sha256_of(path)
    path.write_bytes(_spoil(path, random))
    if random.random() < 0.9:
        _write_checksums(folder, path, before)
    words = shlex.split(one.command)
    return [*words, "--untrusted"] if words[0] in ("eval", "check") else words


def _spoil(path: Path, random: Random) -> bytes:
    content = path.read_bytes()
    if path.suffix == ".npz":
        return spoil_arrays(random, content)
    if path.suffix == ".parquet" and random.random() < 0.6:
        return _spoil_table(random, content)
    if path.suffix in _TEXTS or content[:200].isascii():
        return spoil_text(random, content)
    return spoil_bytes(random, content)


def _spoil_table(random: Random, content: bytes) -> bytes:
    """Change values and types of a column of a parquet table."""
    table = pd.read_parquet(io.BytesIO(content))
    name, other = random.choice(table.columns.to_numpy(), 2)
    odd = np.array([np.nan, 1e308, -1e308, np.inf, -0.0])
    changes: tuple[Callable[[], pd.DataFrame], ...] = (
        lambda: table.drop(columns=name),
        lambda: table.assign(**{name: table[name].astype(str)}),
        lambda: table.assign(**{name: random.choice(odd, len(table))}),
        lambda: table.assign(**{name: table[other].to_numpy()}),
        lambda: table.iloc[random.integers(0, len(table), len(table))],
    )
    out = io.BytesIO()
    changes[int(random.integers(5))]().to_parquet(out, index=False)
    return out.getvalue()


def _write_checksums(folder: Path, path: Path, before: str) -> None:
    """Put right the hashes of a changed file, as somebody who made the input by hand would."""
    after = sha256_of(path)
    for toml in folder.glob("data/*/benchmark.toml"):
        toml.write_bytes(toml.read_bytes().replace(before.encode(), after.encode()))
    stated = path.parent / "result.json"
    if stated.is_file():
        with suppress(ValidationError, ValueError, TypeError, AttributeError):
            values = json.loads(stated.read_bytes().replace(before.encode(), after.encode()))
            result = Result.model_validate_json(json.dumps(values)).with_checksum()
            stated.write_text(result.model_dump_json(by_alias=True))


# --- how a file is spoilt ---

WORDS = (
    *("0", "-0.0", "-1", "1", "1.5", "5e-324", "1e308", "-1e308", "1e400", "nan", "inf", "-inf"),
    "",
    *(str(2**31), str(2**63), str(-(2**63) - 1), "9" * 400, "0x10", "1_000", "1,5", "٣", "½"),
    *("true", "null", "None", "[]", "{}", "[[1]]", '"', "'", "[", "]", "#", "=", ",", "\t", "\r\n"),
    *("=cmd|' /C calc'!A0", "+1+1", "@SUM(A1)", "-2+3", "<script>alert(1)</script>", "&amp;", "\\"),
    *("\\input{/etc/passwd}", "$x_1^2$", "%", "{", "}", "~", "../../etc/passwd", "/dev/zero", "."),
    *("\u202eabc", "\u200fשלום", "\u2066x\u2069", "\u0000", "\u001b[31m", "\u2028", "\ufeff", "é"),
    *("a" * 300, "x" * 70_000, "City/DJI_0001.JPG", "east/q00000", "🙂", "\ud7ff", "\U0010ffff"),
)
NUMBERS = (
    *(0.0, -0.0, 5e-324, -5e-324, 2.2e-308, 1e308, -1e308, np.inf, -np.inf, np.nan, 1e-300, 1e300),
    *(1e9, -1e9, 1.0, -1.0, 0.5, 2.0**31, 2.0**63, 2.0**53 + 2, 1e18, 1e154, 1e155),
    struct.unpack("<d", struct.pack("<Q", 0x7FF8DEADBEEF0001))[0],
    struct.unpack("<d", struct.pack("<Q", 0xFFF0000000000001))[0],
)
_DTYPES = (
    *("f2", "f4", "f8", ">f8", "i1", "i2", "i4", "i8", "u1", "u8", "?", "c16", "S8", "U8", "U1"),
)
_HEADERS = (
    "{'descr': '<f8', 'fortran_order': False, 'shape': (4611686018427387904,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (0, 9223372036854775807), }",
    "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
    "{'descr': [('a', '<f8'), ('b', '|O')], 'fortran_order': True, 'shape': (), }",
    "{'descr': '<U0', 'fortran_order': False, 'shape': (5,), }",
    "{'descr': '<U1000000000', 'fortran_order': False, 'shape': (1,), }",
    "{'descr': '<f16', 'fortran_order': 1, 'shape': (3, 3, 3, 3, 3, 3, 3, 3, 3), }",
    "{" * 5000,
    "[" * 300 + "]" * 300,
)


def spoil_bytes(random: Random, content: bytes) -> bytes:
    """Flip, cut, repeat, drop, exchange or overwrite a few bytes."""
    data = bytearray(content)
    for _ in range(int(random.choice((1, 1, 1, 2, 4, 16)))):
        if not data:
            return bytes(random.integers(0, 256, 7, np.uint8))
        place, other = (int(random.integers(len(data))) for _ in range(2))
        end = place + int(random.choice((1, 2, 4, 8, 64)))
        match int(random.integers(8)):
            case 0:
                data[place] ^= 1 << int(random.integers(8))
            case 1:
                del data[place:]
            case 2:
                del data[place:end]
            case 3:
                data[other:other] = data[place:end]
            case 4:
                data[place:end] = data[other : other + end - place]
            case _:
                part = _odd_bytes(random, end - place)
                data[place : place + len(part)] = part
    return bytes(data)


def _odd_bytes(random: Random, count: int) -> bytes:
    value = np.array([random.choice(NUMBERS)])
    with np.errstate(all="ignore"):
        kinds = [value.astype(kind).tobytes() for kind in ("<f4", "<f8", ">f8", "<i4", "<i8")]
    noise = random.integers(0, 256, count, np.uint8).tobytes()
    parts = [bytes(count), b"\xff" * count, noise, *kinds]
    return parts[int(random.integers(len(parts)))]


def spoil_text(random: Random, content: bytes) -> bytes:
    """Replace, exchange, drop or repeat words and lines; sometimes spoil bytes."""
    if random.random() < 0.15:
        return spoil_bytes(random, content)
    text = content.decode("utf-8", "surrogateescape")
    for _ in range(int(random.choice((1, 1, 1, 2, 3)))):
        parts = re.split(r"([\s,;:|&=\[\]{}\"]+)", text)
        places = [i for i in range(0, len(parts), 2) if parts[i]] or [0]
        place = int(random.choice(places))
        lines = text.splitlines(keepends=True) or [""]
        line = int(random.integers(len(lines)))
        match int(random.integers(7)):
            case 0 | 1 | 2:
                parts[place] = str(random.choice(np.array(WORDS, object)))
            case 3:
                other = int(random.choice(places))
                parts[place], parts[other] = parts[other], parts[place]
            case 4:
                parts = lines[:line] + lines[line + 1 :]
            case 5:
                parts = [*lines[:line], lines[int(random.integers(len(lines)))], *lines[line:]]
            case _:
                parts[place] = repr(float(random.choice(NUMBERS)))
        text = "".join(parts)
    return text.encode("utf-8", "surrogateescape")


def spoil_arrays(random: Random, content: bytes) -> bytes:
    """Change an npz by its arrays; sometimes spoil its bytes."""
    if random.random() < 0.25:
        return spoil_bytes(random, content)
    try:
        with np.load(io.BytesIO(content)) as file:
            fields = {name: file[name] for name in file.files}
    except ValueError:  # a pickle, which is refused as it stands
        return spoil_bytes(random, content)
    raw: dict[str, bytes] = {}
    for _ in range(int(random.choice((1, 1, 2)))):
        if not fields:
            break
        name = str(random.choice(list(fields)))
        with np.errstate(all="ignore"):
            _spoil_field(random, fields, raw, name)
    out, method = io.BytesIO(), int(random.choice((0, 0, 0, 8)))  # mostly stored
    for name, array in fields.items():
        stream = io.BytesIO()
        np.lib.format.write_array(stream, np.asanyarray(array), allow_pickle=False)
        raw[name] = stream.getvalue()
    with zipfile.ZipFile(out, "w") as archive:
        for name, body in raw.items():
            member = zipfile.ZipInfo("x")  # whose first argument would end at a NUL
            member.filename, member.compress_type = f"{name}.npy", method
            archive.writestr(member, body)
    return out.getvalue()


def _spoil_field(random: Random, fields: dict[str, Any], raw: dict[str, bytes], name: str) -> None:
    array = fields[name]
    match int(random.integers(8)):
        case 0:
            fields[str(random.choice(list(fields)))] = array
        case 1:
            word = str(random.choice(np.array(WORDS, object)))[:40].replace("/", "_")
            fields[word] = fields.pop(name)
        case 2:
            with suppress(ValueError, TypeError):  # words that are no numbers stay
                fields[name] = array.astype(str(random.choice(_DTYPES)))
        case 3:
            fields[name] = _reshaped(random, array)
        case 4:
            header = str(random.choice(np.array(_HEADERS, object))).encode() + b"\n"
            raw[name] = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header) & 0xFFFF) + header
            del fields[name]
        case _:
            fields[name] = _with_odd_values(random, array)


def _reshaped(random: Random, array: Any) -> Any:
    changes: tuple[Callable[[], Any], ...] = (
        lambda: array[None],
        lambda: array[..., None],
        lambda: array.reshape(-1),
        lambda: array.T,
        lambda: array[:0],
        lambda: np.concatenate([array, array]),
        lambda: np.asfortranarray(array),
        lambda: array[: int(random.integers(len(array) + 1))],
        lambda: array[random.integers(0, len(array), len(array))],
        lambda: array.reshape(-1)[0],
    )
    with suppress(ValueError, IndexError, TypeError):
        return changes[int(random.integers(len(changes)))]()
    return array


def _with_odd_values(random: Random, array: Any) -> Any:
    if not array.size:
        return array
    changed = array.copy()
    rows = random.integers(0, array.size, int(random.choice((1, 1, 3, array.size))))
    if array.dtype.kind == "U":
        words = [str(random.choice(np.array(WORDS, object)))[:300] for _ in rows[:3]]
        changed = changed.astype(f"U{max(int(array.dtype.itemsize // 4), *map(len, words))}")
        changed.reshape(-1)[rows[:3]] = words
    elif array.dtype.kind == "f":
        changed.reshape(-1)[rows] = random.choice(NUMBERS, len(rows))
    elif array.dtype.kind in "iu":
        bounds = np.iinfo(array.dtype)
        values = (0, 1, 2, bounds.max, bounds.min, bounds.max // 2)
        changed.reshape(-1)[rows] = [values[int(random.integers(6))] for _ in rows]
    return changed
