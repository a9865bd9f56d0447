"""What is spoilt: the inputs of the goldens, clouds of every format, results, published numbers.

A kind of input is a folder and a command; a case spoils a copy of one file that the command reads.
"""

from __future__ import annotations

import io
import json
import shlex
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic import ValidationError

from airzoo_bench.core.files import sha256_of
from airzoo_bench.results.result import Result
from tests.formats import cloud_support as clouds
from tests.formats import test_meshes as meshes
from tests.goldens.run import CASES, run, unpack
from tests.hostile.mutations import Random, spoil_arrays, spoil_bytes, spoil_text
from tests.support import PUBLISHED

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
    coloured = {name: columns[name] for name in ("x", "y", "z", *clouds.COLOURS)}
    rows = clouds.text_rows(coloured)
    quads = {"faces_header": meshes.QUAD_HEADER, "faces": meshes.BINARY_QUADS["<"]}
    points = clouds.points_of(columns)
    writers = {
        **{
            f"ply{n}.ply": lambda p, o=o: clouds.write_ply(p, columns, o)
            for n, o in zip("abc", ("", "<", ">"), strict=True)
        },
        **{
            f"{data}.pcd": lambda p, d=data: clouds.write_pcd(p, columns, d)
            for data in ("ascii", "binary", "binary_compressed")
        },
        **{
            f"{kind}{end}": lambda p, k=kind: clouds.write_las(p, columns, k)
            for kind in (0, 3, 7)
            for end in (".las", ".laz")
        },
        "a.npz": lambda p: np.savez(p, points=points, confidence=np.ones(40)),
        "a.npy": lambda p: np.save(p, np.hstack((points, points))),
        "a.obj": lambda p: p.write_text(meshes.OBJ),
        "a.glb": lambda p: meshes.write_glb(p, meshes.DOCUMENT),
        "mesh.ply": lambda p: clouds.write_ply(p, meshes.COLUMNS, **quads),
        "a.xyz": lambda p: p.write_text(rows),
        "a.csv": lambda p: p.write_text("x,y,z,r,g,b\n" + clouds.text_rows(coloured, ",")),
        "a.pts": lambda p: p.write_text("40\n" + rows),
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
    match int(random.integers(5)):
        case 0:
            table = table.drop(columns=name)
        case 1:
            table[name] = table[name].astype(str)
        case 2:
            table[name] = random.choice(odd, len(table))
        case 3:
            table = table.iloc[random.integers(0, len(table), len(table))]
        case _:
            table[name] = table[other].to_numpy()
    out = io.BytesIO()
    table.to_parquet(out, index=False)
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
