"""Sealing a benchmark folder: a public folder without the truth, and an archive with it.

Public is an allow list of files, of columns of tables and of parts of photos; everything else is
sealed. The archive is a tar in age with all files that are not public as they were, photos
excepted. The commitment is the SHA-256 of the tar, which holds a salt.
"""

from __future__ import annotations

import importlib
import os
import re
import secrets
import shutil
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark, SceneFile, SealedTruth, write_benchmark_file
from airzoo_bench.benchmark.images import bare_photo
from airzoo_bench.benchmark.queries import CAMERA_COLUMNS, POSE_COLUMNS, PRIOR_COLUMNS, poses_of
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core import files
from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.geometry.rasters import raster_files
from airzoo_bench.matching.metrics import count_near
from airzoo_bench.matching.truth import CROP_COLUMNS, photo_maps
from airzoo_bench.retrieval.truth import IMAGE_COLUMNS, POSITION_COLUMNS, TILE_COLUMNS

KEY_VARIABLE = "AIRZOO_BENCH_KEY"
"""The variable of the environment that holds a key."""

_MEMORY = Path("/dev/shm")  # files in memory, on Linux
_SECRET = "AGE-SECRET-KEY-1"
_TILES = (*IMAGE_COLUMNS, *TILE_COLUMNS, *POSITION_COLUMNS[0], *POSITION_COLUMNS[1])
_WINDOW = ("x", "y", "width", "height", "a", "b", "c", "d", "e", "f", "crs")
# Below a scene's folder: the tables that methods get, and their public columns.
_TABLES = {
    "queries.csv": (*IMAGE_COLUMNS, *CAMERA_COLUMNS, *PRIOR_COLUMNS),
    "retrieval/tiles.parquet": _TILES,
    "retrieval/dropped_tiles.csv": _TILES,
    "retrieval/tiles/tiles.csv": (*_TILES, *_WINDOW, "file"),
    "matching/crops.csv": ("id", *CROP_COLUMNS),
    "matching/maps.csv": ("id", *_WINDOW, "dsm_sha256"),
    "matching/crops/crops.csv": ("id", "dom_file", "dsm_file", *_WINDOW),
    "reconstruction/photos.csv": IMAGE_COLUMNS,
}
_PUBLIC = ("matching/map.json", "retrieval/tiles/**/*.png", "matching/crops/**/*_d[os]m.tif")
_TIME = 315_532_800  # 1980-01-01: that of files on the host's disk tells when a photo was taken
_SAME_M, _SAME_DEG = 1e-3, 0.1

Kind = Literal["copy", "photo", "table"]


# --- keys: X25519, in files as age-keygen writes them ---


def load_pyrage() -> Any:
    """Import pyrage and return the module."""
    try:
        return importlib.import_module("pyrage")
    except ImportError:
        fix = "pip install 'airzoo-bench[leaderboard]'"
        raise UsageError("sealed truth needs pyrage, which is not installed", fix=fix) from None


def read_key() -> Any:
    """Read the key that opens an archive from the environment; no message repeats it."""
    pyrage = load_pyrage()
    try:
        [line] = re.findall(rf"(?m)^{_SECRET}.*$", os.environ.get(KEY_VARIABLE, ""))
        return pyrage.x25519.Identity.from_str(line.strip())
    except (ValueError, pyrage.IdentityError):
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


# --- sealing ---


def seal(folder: Path, public: Path, to: Any, progress: Progress = silent) -> tuple[Path, str]:
    """Write the public folder and, beside it, the archive, both or neither.

    Return the archive and the commitment.
    """
    archive = public.with_name(f"{public.name}.age")
    for path in (public, archive):
        if path.exists():
            raise UsageError("exists already", where=path, fix="name another, or move it away")
    benchmark = Benchmark.open(folder)
    _refuse_known_truth(benchmark)
    kinds = public_files(benchmark)
    paths = sorted(path for path in folder.rglob("*") if not path.is_dir())
    with (
        files.atomic_entries(archive.parent, (public.name, archive.name)) as staged,
        tempfile.NamedTemporaryFile() as plain,
    ):
        target = staged / public.name
        salt = {"comment": secrets.token_hex(32)}
        with tarfile.open(fileobj=plain, mode="w", pax_headers=salt) as tar:
            for path in progress(paths, "files", len(paths)):
                name = path.relative_to(folder).as_posix()
                kind = kinds.get(name)
                is_same = kind is not None and _publish(path, target / name, kind)
                if not is_same and kind != "photo":
                    member = tarfile.TarInfo(name)  # without time and owner
                    member.size = path.stat().st_size
                    with path.open("rb") as stream:
                        tar.addfile(member, stream)
        plain.flush()
        commitment = files.sha256_of(Path(plain.name))
        update = {
            "scenes": tuple(_public_entry(scene, benchmark) for scene in benchmark.file.scenes),
            "sealed": SealedTruth(commitment=commitment),
        }
        write_benchmark_file(target, benchmark.file.model_copy(update=update))
        plain.seek(0)
        with (staged / archive.name).open("wb") as stream:
            load_pyrage().encrypt_io(plain, stream, [to])
        for path in (*target.rglob("*"), target):
            os.utime(path, (_TIME, _TIME))
    return archive, commitment


def commitment_of(public: Benchmark) -> str:
    """Return the SHA-256 that a public folder states of its sealed truth."""
    return "" if public.file.sealed is None else public.file.sealed.commitment


def _refuse_known_truth(benchmark: Benchmark) -> None:
    """Refuse a benchmark if the priors that methods are given are the truth."""
    source = benchmark.file.tracks.get("matching", {}).get("prior", {}).get("source", "metadata")
    near = source != "metadata"
    for scene in benchmark.file.scenes:
        photos = read_table(benchmark.scene_folder(scene.id) / "queries.csv", ("id",))
        known = photos.reindex(columns=[*POSE_COLUMNS, *PRIOR_COLUMNS]).dropna()
        poses, priors = poses_of(known), poses_of(known, PRIOR_COLUMNS)
        near += count_near(poses, priors, _SAME_M, _SAME_DEG)
    if near:
        what = f"priors equal the true pose: {near}, and prior.source is {source!r}"
        raise BenchmarkError(what, where=benchmark.folder, expected="priors that were measured")


# --- the public folder ---


def public_files(benchmark: Benchmark) -> dict[str, Kind]:
    """Name the public files of a folder except benchmark.toml, by path below the folder."""
    folder = benchmark.folder
    found: dict[Path, Kind] = dict.fromkeys((folder / "protocols").glob("*.toml"), "copy")
    for scene in benchmark.file.scenes:
        for place in (scene.images, scene.dom, scene.dsm, scene.gallery, scene.maps, scene.cloud):
            _below(folder, benchmark.resolve(place or "."))
        home = benchmark.scene_folder(scene.id)
        found |= {path: "copy" for pattern in _PUBLIC for path in home.glob(pattern)}
        found |= {home / name: "table" for name in _TABLES}
        found |= dict(_data_files(benchmark, scene, home))
    return {_below(folder, path): kind for path, kind in found.items() if path.is_file()}


def _public_entry(scene: SceneFile, benchmark: Benchmark) -> SceneFile:
    """Return what benchmark.toml says of a scene in public."""
    sealed = ["cloud", "cloud_sha256", "truth_accuracy_m"]
    if "matching" not in benchmark.file.tracks:  # whose methods are given the surface model
        sealed += ["dsm", "dsm_sha256", "plane_height_m", "maps"]
    return scene.model_copy(update=dict.fromkeys(sealed))


def _data_files(benchmark: Benchmark, scene: SceneFile, home: Path) -> Iterator[tuple[Path, Kind]]:
    """Yield the photos that there are ids of, and the maps that methods are given."""
    photos = read_table(home / "queries.csv", IMAGE_COLUMNS)
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


def _publish(source: Path, target: Path, kind: Kind) -> bool:
    """Write the public version of a file, and return whether it is the same as the original."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if kind == "photo":
        content = source.read_bytes()
        target.write_bytes(bare := bare_photo(content, source))
        return bare == content
    if kind == "table":
        columns = next(names for name, names in _TABLES.items() if source.match(name))
        is_parquet = source.suffix == ".parquet"
        text: Any = {"dtype": str, "keep_default_na": False, "encoding": "utf-8-sig"}  # all digits
        table = pd.read_parquet(source) if is_parquet else pd.read_csv(source, **text)
        if not {*table.columns} <= {*columns}:
            table = table[[name for name in table.columns if name in columns]]
            if is_parquet:
                table.to_parquet(target, index=False)
            else:
                table.to_csv(target, index=False, lineterminator="\n")
            return False
    shutil.copyfile(source, target)
    return True


# --- opening ---


@contextmanager
def opened_truth(public: Path, archive: Path, key: Any) -> Iterator[Path]:
    """Open the folder that was sealed, in memory where that can be, with links to public files."""
    home = _MEMORY if os.access(_MEMORY, os.W_OK | os.X_OK) else Path(tempfile.gettempdir())
    with files.temporary_folder(home, "airzoo-truth") as folder:
        _extract(archive, key, commitment_of(Benchmark.open(public, sealed=True)), folder)
        for path in (path for path in public.rglob("*") if path.is_file()):
            link = folder / path.relative_to(public)
            if not link.exists():
                link.parent.mkdir(parents=True, exist_ok=True)
                link.symlink_to(path.resolve())
        yield folder


def _extract(archive: Path, key: Any, committed: str, target: Path) -> None:
    """Write the sealed files of the archive that was committed to."""
    pyrage = load_pyrage()
    with tempfile.NamedTemporaryFile(dir=target) as plain, archive.open("rb") as stream:
        try:
            pyrage.decrypt_io(stream, plain, [key])
            plain.flush()
        except (pyrage.DecryptError, OSError) as error:
            if isinstance(error, OSError) and error.errno:  # pyrage's has no number
                raise
        if files.sha256_of(Path(plain.name)) != committed:
            what = "is damaged, or not of this public folder and key"
            raise BenchmarkError(what, where=archive, fix="copy it again, from the run of `seal`")
        with tarfile.open(plain.name) as tar:
            tar.extractall(target, filter="data")
