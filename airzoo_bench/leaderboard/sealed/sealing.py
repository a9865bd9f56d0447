"""Sealing a benchmark folder: a public folder without the truth, and an archive with it."""

from __future__ import annotations

import hashlib
import os
import secrets
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.manifest import SealedTruth, write_benchmark_file
from airzoo_bench.benchmark.queries import POSE_COLUMNS, PRIOR_COLUMNS
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError, UsageError, first_of
from airzoo_bench.core.files import (
    atomic_entries,
    check_new_folder,
    check_output_file,
    sha256_of,
)
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.evaluation.opening import read_truths
from airzoo_bench.leaderboard.sealed.archive import Member, pieces_of, write_archive
from airzoo_bench.leaderboard.sealed.contents import MANIFEST, Contents, SealedFile, commitment
from airzoo_bench.leaderboard.sealed.parts import (
    Kind,
    Part,
    public_entry,
    public_parts,
    public_table,
)
from airzoo_bench.leaderboard.sealed.photos import (
    cuts_of,
    is_tiff,
    pixels_alone,
    refuse_leftovers,
)
from airzoo_bench.protocol.lookup import load_protocol

__all__ = ["Sealed", "seal"]

# All files of a public folder have one time: that of files on the host's disk tells when a photo
# was taken or a scene was made.
_TIME = 315_532_800  # 1980-01-01
_SAME_M, _SAME_ROTATION = 1e-3, 1e-6


@dataclass(frozen=True)
class Sealed:
    """What was sealed: how many files are public, sealed, or cut, and the commitment."""

    commitment: str
    counts: Counter[str]


def _new_salt() -> str:
    """Return 256 random bits, in hexadecimal."""
    return secrets.token_hex(32)


def seal(
    folder: Path,
    public: Path,
    archive: Path,
    to: Any,
    *,
    replace: bool = False,
    make_salt: Callable[[], str] = _new_salt,
    progress: Progress = silent,
) -> Sealed:
    """Write a public folder without the truth, and an archive of the truth, both or neither."""
    _check_places(folder, public, archive, replace=replace)
    benchmark = Benchmark.open(folder, sealed=True)
    if benchmark.is_sealed:
        raise UsageError(
            "is sealed already", where=folder, fix="seal the folder that it was made of"
        )
    _refuse_told(benchmark)
    parts = public_parts(benchmark)
    names = sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if _is_file(path)
    )
    with atomic_entries(archive.parent, (public.name, archive.name)) as staged:
        target = staged / public.name
        files = {
            name: _publish(folder, target, name, parts.get(name))
            for name in progress(names, "files", len(names))
        }
        contents = Contents(format=1, salt=make_salt(), files=files)
        _write_benchmark(benchmark, target, commitment(contents))
        _check_public(target)
        with (staged / archive.name).open("wb") as stream:
            write_archive(stream, _members(folder, contents), to)
        _set_times(target)
    return Sealed(commitment(contents), Counter(file.how for file in files.values()))


def _check_places(folder: Path, public: Path, archive: Path, *, replace: bool) -> None:
    source, out, file = (path.resolve() for path in (folder, public, archive))
    if not (folder / "benchmark.toml").is_file():
        raise UsageError(
            "no benchmark folder here",
            where=folder,
            expected="a folder with benchmark.toml, as `airzoo-bench prepare` writes it",
            fix="give its path: what is sealed is not looked for in the data root",
        )
    if out.parent != file.parent:
        raise UsageError(
            f"{public} and {archive} lie in two folders",
            where="--out, --archive",
            expected="both in one folder, so that they appear in one step",
        )
    if source in (out, *out.parents) or out in source.parents:
        raise UsageError("lies in the folder that is sealed, or around it", where=public)
    check_new_folder(public, replace=replace)
    check_output_file(archive)
    if archive.exists() and not replace:
        raise UsageError(
            "the archive exists already", where=archive, fix="name another, or --force"
        )


def _is_file(path: Path) -> bool:
    if path.is_dir():
        return False
    if not path.is_file():
        raise BenchmarkError("no file, and so not to be sealed", where=path, fix="remove it")
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise BenchmarkError(
            "the file's name is no text", where=repr(path), fix="rename it"
        ) from None
    return True


def _refuse_told(benchmark: Benchmark) -> None:
    """Refuse a benchmark whose public parts are the truth by themselves."""
    prior = benchmark.file.tracks.get("matching", {}).get("prior", {}).get("source", "metadata")
    if prior != "metadata":
        raise BenchmarkError(
            f"its methods are given the truth: prior.source is {prior!r}",
            where=benchmark.folder,
            expected="priors from metadata, where poses are to be sealed",
        )
    columns = (*POSE_COLUMNS, *PRIOR_COLUMNS)
    for scene in benchmark.file.scenes:
        path = benchmark.scene_folder(scene.id) / "queries.csv"
        photos = read_table(path, ("id",))
        if not set(columns) <= set(photos.columns):
            continue
        pose, given = np.split(photos[list(columns)].to_numpy(np.float64), 2, axis=1)
        near = np.linalg.norm(pose[:, 4:] - given[:, 4:], axis=1) < _SAME_M
        near &= np.abs((pose[:, :4] * given[:, :4]).sum(axis=1)) > 1 - _SAME_ROTATION
        if near.any():
            raise BenchmarkError(
                f"priors equal the true pose: {first_of(photos['id'][near], len(photos))}",
                where=path,
                expected="priors that are measured apart from the truth",
            )


def _publish(folder: Path, target: Path, name: str, part: Part | None) -> SealedFile:
    """Write the public version of a file, if it has one, and say where the original is."""
    source = folder / name
    size, digest = source.stat().st_size, sha256_of(source)
    if part is None:
        return SealedFile(sha256=digest, size=size, how="sealed")
    place = target / name
    place.parent.mkdir(parents=True, exist_ok=True)
    if part.kind is Kind.PHOTO:
        _write_photo(source, place)
    elif part.kind is Kind.TABLE:
        place.write_bytes(public_table(source, part.columns))
    else:
        _copy(source, place)
    if sha256_of(place) == digest:
        return SealedFile(sha256=digest, size=size, how="public")
    if part.kind is Kind.PHOTO:
        return SealedFile(sha256=digest, size=size, how="cut")
    return SealedFile(sha256=digest, size=size, how="sealed")


def _copy(source: Path, place: Path) -> None:
    with place.open("wb") as stream:
        for piece in pieces_of(source):
            stream.write(piece)


def _write_photo(source: Path, place: Path) -> None:
    """Write a photo without metadata."""
    data = source.read_bytes()
    if is_tiff(data):
        place.write_bytes(pixels_alone(source))
    else:
        place.write_bytes(b"".join(_between(data, cuts_of(data, source))))
    refuse_leftovers(place)


def _between(data: bytes, cuts: list[tuple[int, int]]) -> Iterator[bytes]:
    done = 0
    for offset, length in cuts:
        yield data[done:offset]
        done = offset + length
    yield data[done:]


def _write_benchmark(benchmark: Benchmark, target: Path, committed: str) -> None:
    tracks = tuple(benchmark.file.tracks)
    scenes = tuple(public_entry(scene, tracks) for scene in benchmark.file.scenes)
    sealed = SealedTruth(commitment=committed)
    update = {"scenes": scenes, "checksums": {}, "sealed": sealed}
    write_benchmark_file(target, benchmark.file.model_copy(update=update))


def _check_public(target: Path) -> None:
    """Hold the public folder to what submitters do with it: every protocol's questions are read."""
    for path in sorted((target / "protocols").glob("*.toml")):
        protocol = load_protocol(path)
        read_truths(protocol, target, sealed=True)


def _members(folder: Path, contents: Contents) -> Iterator[Member]:
    text = contents.model_dump_json().encode()
    yield Member(MANIFEST, len(text), lambda: iter([text]))
    for name, file in contents.files.items():
        if file.how == "sealed":
            yield Member(f"files/{name}", file.size, _checked(folder / name, file.sha256))


def _checked(path: Path, expected: str) -> Callable[[], Iterator[bytes]]:
    def pieces() -> Iterator[bytes]:
        digest = hashlib.sha256()
        for piece in pieces_of(path):
            digest.update(piece)
            yield piece
        if digest.hexdigest() != expected:
            raise BenchmarkError("was changed while it was sealed", where=path, fix="seal again")

    return pieces


def _set_times(folder: Path) -> None:
    for path in (*folder.rglob("*"), folder):
        os.utime(path, (_TIME, _TIME))
