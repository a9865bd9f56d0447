"""Sealing a benchmark folder: a public folder without the truth, and an archive with it.

Public is an allow list, of tables their known columns; everything else is sealed. The archive is a
tar in age: a manifest with a salt and the checksum of every file, then the files that are not
public as they were.
"""

from __future__ import annotations

import hashlib
import importlib
import io
import os
import re
import secrets
import shutil
import tarfile
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import AfterValidator, Field, ValidationError

from airzoo_bench.benchmark.folder import Benchmark, SceneFile, SealedTruth, write_benchmark_file
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    IDENTITY_COLUMNS,
    POSE_COLUMNS,
    PRIOR_COLUMNS,
)
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError, UsageError, UserError, first_of
from airzoo_bench.core.files import (
    atomic_entries,
    canonical_json,
    check_new_folder,
    check_output_file,
    sha256_of,
    temporary_folder,
)
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.validation import Strict
from airzoo_bench.geometry.rasters import raster_files
from airzoo_bench.matching.truth import photo_maps
from airzoo_bench.retrieval.truth import IMAGE_COLUMNS

KEY_VARIABLE = "AIRZOO_BENCH_KEY"
"""The variable of the environment that holds a key."""
MANIFEST = "manifest.json"
"""The first member of an archive; the files of the folder stand below `files/`."""

_MEMORY = Path("/dev/shm")  # files in memory, on Linux
_SECRET = "AGE-SECRET-KEY-1"
# Below a scene's folder; `queries.csv` is cut to columns.
_PUBLIC = (
    *("retrieval/tiles.parquet", "retrieval/dropped_tiles.csv", "retrieval/tiles/tiles.csv"),
    *("matching/crops.csv", "matching/maps.csv", "matching/crops/crops.csv", "matching/map.json"),
    *("reconstruction/photos.csv", "retrieval/tiles/**/*.png", "matching/crops/**/*_d[os]m.tif"),
)
_QUERIES = (*IDENTITY_COLUMNS, *CAMERA_COLUMNS, *PRIOR_COLUMNS)
_TIME = 315_532_800  # 1980-01-01: that of files on the host's disk tells when a photo was taken
_SAME_M, _SAME_ROTATION = 1e-3, 1e-6

How = Literal["copy", "photo", "queries"]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


# --- keys: X25519, in files as age-keygen writes them ---


def load_pyrage() -> Any:
    """Import pyrage and return the module."""
    try:
        return importlib.import_module("pyrage")
    except ImportError:
        fix = "pip install 'airzoo-bench[leaderboard]'"
        raise UsageError("sealed truth needs pyrage, which is not installed", fix=fix) from None


def read_key() -> Any:
    """Read the key that opens an archive from the environment."""
    pyrage = load_pyrage()
    try:
        [line] = re.findall(rf"(?m)^{_SECRET}.*$", os.environ.get(KEY_VARIABLE, ""))
        return pyrage.x25519.Identity.from_str(line.strip())
    except (ValueError, pyrage.IdentityError):
        # Neither the key nor the library's words on it are repeated.
        expected = f"one line that begins with {_SECRET}, as age-keygen writes it"
        raise UsageError("holds no key", where=f"${KEY_VARIABLE}", expected=expected) from None


def recipient(text: str) -> Any:
    """Return the public key that an archive is sealed to."""
    pyrage = load_pyrage()
    try:
        return pyrage.x25519.Recipient.from_str(text.strip())
    except pyrage.RecipientError:  # the text may be the secret key
        expected = "a public key as age-keygen prints it, which begins with age1"
        raise UsageError("no public key", where="--to", expected=expected) from None


# --- the archive ---


def _inside(name: str) -> str:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not path.parts or "\0" in name:
        raise ValueError(f"{name!r} is no file of a folder")
    return name


class SealedFile(Strict):
    """A file of the folder: public as it was, in the archive, or public without its metadata."""

    sha256: Sha256
    size: Annotated[int, Field(ge=0, le=1 << 50)]
    how: Literal["public", "sealed", "cut"]


class Contents(Strict):
    """The manifest of an archive."""

    format: Literal[1]
    salt: Sha256
    files: dict[Annotated[str, AfterValidator(_inside)], SealedFile]


def commitment(contents: Contents) -> str:
    """Return SHA-256 over the salt and the checksums of all files of the sealed folder."""
    sums = {name: file.sha256 for name, file in contents.files.items()}
    return hashlib.sha256(bytes.fromhex(contents.salt) + canonical_json(sums).encode()).hexdigest()


def seal(
    folder: Path,
    public: Path,
    archive: Path,
    to: Any,
    *,
    replace: bool = False,
    progress: Progress = silent,
) -> tuple[str, Counter[str]]:
    """Write the public folder and the archive, both or neither.

    Return the commitment, and how many files are public, sealed and cut.
    """
    source, out = folder.resolve(), public.resolve()
    if out.parent != archive.resolve().parent or out.is_relative_to(source):
        expected = "both in one folder, which is not the one that is sealed"
        raise UsageError("a wrong place", where="--out, --archive", expected=expected)
    check_new_folder(public, replace=replace)
    check_output_file(archive)
    if archive.exists() and not replace:
        raise UsageError("exists already", where=archive, fix="name another, or --force")
    benchmark = Benchmark.open(folder)
    _refuse_known_truth(benchmark)
    given = public_files(benchmark)
    names = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if not p.is_dir())
    with atomic_entries(archive.parent, (public.name, archive.name)) as staged:
        target = staged / public.name
        files = {
            name: _publish(folder / name, target / name, given.get(name))
            for name in progress(names, "files", len(names))
        }
        contents = Contents(format=1, salt=secrets.token_hex(32), files=files)
        update = {
            "scenes": tuple(_public_entry(scene, benchmark) for scene in benchmark.file.scenes),
            "checksums": {},
            "sealed": SealedTruth(commitment=commitment(contents)),
        }
        write_benchmark_file(target, benchmark.file.model_copy(update=update))
        _write_archive(folder, contents, staged / archive.name, to)
        for path in (*target.rglob("*"), target):
            os.utime(path, (_TIME, _TIME))
    return commitment(contents), Counter(file.how for file in files.values())


def _refuse_known_truth(benchmark: Benchmark) -> None:
    """Refuse a benchmark if its public parts are the truth by themselves."""
    prior = benchmark.file.tracks.get("matching", {}).get("prior", {}).get("source", "metadata")
    if prior != "metadata":
        what = f"its methods are given the truth: prior.source is {prior!r}"
        raise BenchmarkError(what, where=benchmark.folder, expected="priors from metadata")
    for scene in benchmark.file.scenes:
        path = benchmark.scene_folder(scene.id) / "queries.csv"
        photos = read_table(path, ("id",))
        if {*POSE_COLUMNS, *PRIOR_COLUMNS} <= {*photos.columns}:
            pose, given = (photos[[*names]].to_numpy() for names in (POSE_COLUMNS, PRIOR_COLUMNS))
            near = np.linalg.norm(pose[:, 4:] - given[:, 4:], axis=1) < _SAME_M
            near &= np.abs((pose[:, :4] * given[:, :4]).sum(axis=1)) > 1 - _SAME_ROTATION
            if near.any():
                what = f"priors equal the true pose: {first_of(photos['id'][near], len(photos))}"
                raise BenchmarkError(what, where=path, expected="priors that were measured apart")


# --- the public folder ---


def public_files(benchmark: Benchmark) -> dict[str, How]:
    """Name the public files of a folder except benchmark.toml, by path below the folder."""
    folder = benchmark.folder
    found: dict[Path, How] = dict.fromkeys((folder / "protocols").glob("*.toml"), "copy")
    for scene in benchmark.file.scenes:
        for place in (scene.images, scene.dom, scene.dsm, scene.gallery, scene.maps, scene.cloud):
            _below(folder, benchmark.resolve(place or "."))
        home = benchmark.scene_folder(scene.id)
        found |= {path: "copy" for pattern in _PUBLIC for path in home.glob(pattern)}
        found |= {home / "queries.csv": "queries", **dict(_data_files(benchmark, scene, home))}
    return {_below(folder, path): how for path, how in found.items() if path.is_file()}


def _public_entry(scene: SceneFile, benchmark: Benchmark) -> SceneFile:
    """Return what benchmark.toml says of a scene in public."""
    sealed = ["cloud", "cloud_sha256", "truth_accuracy_m"]
    if "matching" not in benchmark.file.tracks:  # whose methods are given the surface model
        sealed += ["dsm", "dsm_sha256", "plane_height_m", "maps"]
    return scene.model_copy(update=dict.fromkeys(sealed))


def _data_files(benchmark: Benchmark, scene: SceneFile, home: Path) -> Iterator[tuple[Path, How]]:
    """Yield the photos that there are ids of, and the maps that methods are given."""
    photos = read_table(home / "queries.csv", IDENTITY_COLUMNS)
    for name in photos["image"]:
        yield benchmark.resolve(scene.images) / name, "photo"
    given = _public_entry(scene, benchmark)
    rasters = [benchmark.resolve(named) for named in (given.dom, given.dsm) if named is not None]
    gallery = None if given.gallery is None else benchmark.resolve(given.gallery)
    if gallery is not None and gallery.is_file():
        rasters.append(gallery)
    elif gallery is not None:
        for name in ("tiles.parquet", "dropped_tiles.csv"):
            for image in read_table(home / "retrieval" / name, IMAGE_COLUMNS)["image"]:
                yield gallery / image, "photo"
    for raster in rasters:
        yield from ((path, "copy") for path in raster_files(raster))
    if given.maps is not None:
        for photo in photos["id"]:
            yield from ((path, "copy") for path in photo_maps(benchmark.resolve(given.maps), photo))


def _below(folder: Path, path: Path) -> str:
    """Return a path within the folder that is sealed, which has to hold all its data."""
    found = os.path.relpath(path, folder)
    if found.startswith(".."):
        what = f"data outside the folder: {path}"
        raise BenchmarkError(what, where=folder, fix="prepare it again with --copy")
    return Path(found).as_posix()


# --- writing ---


def _publish(source: Path, place: Path, how: How | None) -> SealedFile:
    """Write the public version of a file, if it has one, and say where the original is."""
    kind: Literal["public", "sealed", "cut"] = "sealed" if how in (None, "queries") else "public"
    if how is not None:
        place.parent.mkdir(parents=True, exist_ok=True)
    if how == "copy":
        shutil.copyfile(source, place)
    elif how == "photo":
        content = source.read_bytes()
        place.write_bytes(bare := bare_photo(content, source))
        kind = "public" if bare == content else "cut"
    elif how == "queries":  # digits as they are
        table = pd.read_csv(source, dtype=str, keep_default_na=False, encoding="utf-8-sig")
        public = table[[name for name in table.columns if name in _QUERIES]].sort_values("id")
        public.to_csv(place, index=False, lineterminator="\n")
    return SealedFile(sha256=sha256_of(source), size=source.stat().st_size, how=kind)


def _write_archive(folder: Path, contents: Contents, archive: Path, to: Any) -> None:
    """Write the sealed files into a tar that tells neither times nor owners, and encrypt it."""
    with tempfile.TemporaryFile() as plain, archive.open("wb") as stream:
        with tarfile.open(fileobj=plain, mode="w", format=tarfile.PAX_FORMAT) as tar:
            text, member = contents.model_dump_json().encode(), tarfile.TarInfo(MANIFEST)
            member.size = len(text)
            tar.addfile(member, io.BytesIO(text))
            for name, file in contents.files.items():
                if file.how == "sealed":
                    member = tarfile.TarInfo(f"files/{name}")
                    member.size = file.size
                    with (folder / name).open("rb") as source:
                        tar.addfile(member, source)
        plain.seek(0)
        load_pyrage().encrypt_io(plain, stream, [to])


def commitment_of(public: Benchmark) -> str:
    """Return SHA-256 over a sealed truth and its salt, which lies in the archive."""
    return "" if public.file.sealed is None else public.file.sealed.commitment


# --- opening ---


@contextmanager
def opened_truth(public: Path, archive: Path, key: Any) -> Iterator[Path]:
    """Open as much of the folder that was sealed as scoring needs, in memory where that can be.

    The folder holds the truth, and links to public files. Photos may be missing.
    """
    home = _MEMORY if os.access(_MEMORY, os.W_OK | os.X_OK) else Path(tempfile.gettempdir())
    committed = commitment_of(Benchmark.open(public, sealed=True))
    with temporary_folder(home, "airzoo-truth") as folder:
        for name in _extract(archive, key, committed, folder):
            if not (public / name).is_file():
                what = "a file of the public folder is missing"
                raise BenchmarkError(what, where=public / name, fix="copy the folder again")
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).symlink_to((public / name).resolve())
        yield folder


def _extract(archive: Path, key: Any, committed: str, target: Path) -> list[str]:
    """Write the sealed files of an archive, each held to its checksum; return the public ones."""
    pyrage, plain = load_pyrage(), tempfile.TemporaryFile(dir=target)  # noqa: SIM115
    try:
        with plain, archive.open("rb") as stream:
            pyrage.decrypt_io(stream, plain, [key])
            plain.seek(0)
            with tarfile.open(fileobj=plain, mode="r:") as tar:
                member = tar.extractfile(MANIFEST)
                contents = Contents.model_validate_json(member.read() if member else b"")
                if commitment(contents) != committed:
                    raise _wrong_archive(archive, "belongs to another public folder")
                for name, file in contents.files.items():
                    if file.how == "sealed":  # the manifest keeps its name inside the folder
                        member, path = tar.extractfile(f"files/{name}"), target / name
                        path.parent.mkdir(parents=True, exist_ok=True)
                        with path.open("wb") as out:
                            shutil.copyfileobj(member or io.BytesIO(), out)
                        if sha256_of(path) != file.sha256:
                            raise _wrong_archive(archive, f"holds {name} otherwise than sealed")
    except (pyrage.DecryptError, tarfile.TarError, KeyError, ValidationError, OSError) as error:
        # Of a damaged archive, pyrage raises an OSError without a number.
        if isinstance(error, OSError) and error.errno:
            raise UserError(f"the truth cannot be opened: {error}", where=archive) from error
        said = "was sealed to another key" if "No matching keys" in str(error) else "is damaged"
        raise _wrong_archive(archive, said) from None
    return [name for name, file in contents.files.items() if file.how == "public"]


def _wrong_archive(archive: Path, what: str) -> BenchmarkError:
    expected = "the archive, and its key, of the run of `airzoo-bench seal` that made the folder"
    return BenchmarkError(what, where=archive, expected=expected, fix="copy the archive again")


# --- photos without metadata: cut, not encoded again ---

_JPEG, _PNG = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"
_END, _SCAN, _JFIF, _ADOBE = 0xD9, 0xDA, 0xE0, 0xEE
# Frames (except hierarchical ones), tables of Huffman, arithmetic and quantisation, DNL, DRI.
_JPEG_KEPT = frozenset((*range(0xC0, 0xC5), *range(0xC9, 0xCD), 0xDB, 0xDC, 0xDD, _END, _SCAN))
_JPEG_ALONE = frozenset((0x01, *range(0xD0, 0xD8), _END))
# A scan, with its coded data: up to a marker that is no stuffed byte and no restart.
_CODED = re.compile(rb"(?:[^\xff]|\xff[\x00\xd0-\xd7])*+", re.DOTALL)
_PNG_KEPT = frozenset((b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"))


def bare_photo(data: bytes, where: Path) -> bytes:
    """Return the parts of a JPEG or PNG that make the picture."""
    try:
        for mark, parts in ((_JPEG, _jpeg_parts), (_PNG, _png_parts)):
            if data.startswith(mark):
                return b"".join(parts(data))
    except (IndexError, ValueError):
        pass
    raise BenchmarkError(
        "its metadata cannot be taken out",
        where=where,
        expected="a complete JPEG or PNG",
        fix="write the photo again as one of these, and prepare the benchmark anew",
    )


def _jpeg_parts(data: bytes) -> Iterator[bytes]:
    """Yield the parts that stay; a scan has its coded data with it."""
    yield data[:2]
    place, code = 2, 0
    while code != _END:
        if data[place] != 0xFF:
            raise ValueError("no marker")
        while data[place + 1] == 0xFF:  # fill bytes
            place += 1
        code, end = data[place + 1], place + 2
        if code not in _JPEG_ALONE:
            end += int.from_bytes(data[end : end + 2], "big")
            if end > len(data) or end < place + 4:
                raise ValueError("a segment without an end")
        body = data[place + 4 : end]
        # JFIF without a preview, and how the colours are coded.
        plain = len(body) == 14 and body.startswith(b"JFIF\0") and body[12:] == b"\0\0"
        plain = plain if code == _JFIF else len(body) == 12 and body.startswith(b"Adobe")
        if code == _SCAN and (coded := _CODED.match(data, end)):
            end = coded.end()
        if code in _JPEG_KEPT or (code in (_JFIF, _ADOBE) and plain):
            yield data[place:end]
        place = end


def _png_parts(data: bytes) -> Iterator[bytes]:
    yield _PNG
    place, kind = len(_PNG), b""
    while kind != b"IEND":
        kind = data[place + 4 : place + 8]
        end = place + 12 + int.from_bytes(data[place : place + 4], "big")
        if len(kind) < 4 or end > len(data):
            raise ValueError("a chunk without an end")
        if kind in _PNG_KEPT:
            yield data[place:end]
        place = end
