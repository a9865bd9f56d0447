"""Sealed truth: a public folder, an archive with the truth, and how coarse the answers from it are.

Public is an allow list of files, of columns of tables and of parts of photos; everything else is
sealed. The archive is a tar in age with all files that are not public as they were, photos
excepted. The commitment is the SHA-256 of the tar, which holds a salt.

Told are the headline scores over all scenes, in steps of half their standard error: that of a mean
of independent scenes. Within a scene it is, of **shares**, that of a rate with two more queries at
0 and two at 1 (Agresti and Coull 1998), of the told score; steps are those of the largest error
that so many queries can have, and not smaller than what `FLIPS` queries of the smallest scene move.
Of **means of errors** it is that of the sample; of **medians** a quarter of the width of the
binomial 95 % interval of order statistics. Where its upper end is a failure the error is not known,
and the lower half decides the step. Errors are rounded upward to one digit; of medians and means of
errors to 1, 2 or 5. Reconstruction has one record a scene: shares are told to a hundredth,
distances to two digits.
"""

from __future__ import annotations

import importlib
import math
import os
import re
import secrets
import shutil
import tarfile
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from decimal import ROUND_CEILING, Context, Decimal
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from airzoo_bench.benchmark import folder as folders
from airzoo_bench.benchmark.folder import Benchmark, SceneFile, SealedTruth
from airzoo_bench.benchmark.queries import CAMERA_COLUMNS, POSE_COLUMNS, PRIOR_COLUMNS, poses_of
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core import files
from airzoo_bench.core.errors import BenchmarkError, SubmissionError, UsageError, UserError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.metadata import bare_photo
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import raster_files
from airzoo_bench.leaderboard.answers import Answer, Row, Score, head_of, now
from airzoo_bench.leaderboard.checks import CheckedSubmission
from airzoo_bench.matching.metrics import count_near
from airzoo_bench.matching.truth import CROP_COLUMNS, photo_maps
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.retrieval.truth import IMAGE_COLUMNS, POSITION_COLUMNS, TILE_COLUMNS

KEY_VARIABLE = "AIRZOO_BENCH_KEY"  # of the environment

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

# Steps are at least as large as what so many queries of the smallest scene can move a share.
FLIPS = 4
_Z95 = 1.959964
_LEAST_SHARE_OF_VALUE = 0.01

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
    """Read the key that opens an archive from the environment."""
    lines = re.findall(rf"(?m)^{_SECRET}.*$", os.environ.get(KEY_VARIABLE, ""))
    return _parse_key("Identity", "\n".join(lines), f"${KEY_VARIABLE}", f"one line, {_SECRET}...")


def recipient(text: str) -> Any:
    """Return the public key that an archive is sealed to."""
    return _parse_key("Recipient", text, "--to", "the public key, age1...")


def _parse_key(kind: str, text: str, where: str, expected: str) -> Any:
    """Return a key of pyrage; no message repeats the text, which may be the secret one."""
    pyrage = load_pyrage()
    try:
        return getattr(pyrage.x25519, kind).from_str(text.strip())
    except (pyrage.IdentityError, pyrage.RecipientError):
        raise UsageError("holds no key", where=where, expected=expected) from None


# --- sealing ---


def seal(folder: Path, public: Path, to: Any, progress: Progress = silent) -> tuple[Path, str]:
    """Write public folder and archive, both or neither; return the archive and the commitment."""
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
        folders.write_benchmark_file(target, benchmark.file.model_copy(update=update))
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
    sealed = ["cloud", "cloud_sha256", "truth_accuracy_m", "warnings"]
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
        with tempfile.NamedTemporaryFile(dir=folder) as plain, archive.open("rb") as stream:
            try:
                load_pyrage().decrypt_io(stream, plain, [key])
                plain.flush()
            except (load_pyrage().DecryptError, OSError) as error:
                if isinstance(error, OSError) and error.errno:  # pyrage's has no number
                    raise
            committed = commitment_of(Benchmark.open(public, sealed=True))
            if files.sha256_of(Path(plain.name)) != committed:
                what, fix = "is damaged, or not of this public folder and key", "copy it again"
                raise BenchmarkError(what, where=archive, fix=f"{fix}, from the run of `seal`")
            with tarfile.open(plain.name) as tar:
                tar.extractall(folder, filter="data")
        for path in (path for path in public.rglob("*") if path.is_file()):
            link = folder / path.relative_to(public)
            if not link.exists():
                link.parent.mkdir(parents=True, exist_ok=True)
                link.symlink_to(path.resolve())
        yield folder


# --- the answer ---


class OpenedTruthError(SubmissionError):
    """Why predictions are refused once the truth is open: that too is an answer, and a try."""


def score_sealed(
    checked: CheckedSubmission, tree: str, archive: Path, key: Any, data: Path, run: Run
) -> Answer:
    """Score a checked submission, and tell of it what does not tell the truth."""
    public = folders.find_benchmark(checked.folder.resolve().parts[-3], data, sealed=True)
    with opened_truth(public.folder, archive, key) as truth:
        try:
            evaluation = checked.score(truth, run)
        except SubmissionError as error:  # of its pipeline
            raise OpenedTruthError(error.what, fix=error.fix) from None
        except UserError:  # its message may come from the truth
            what = "cannot be scored, for a reason that only the truth shows, and that is not told"
            fix = "ask the host, who has the truth and can score it by `airzoo-bench eval`"
            raise OpenedTruthError(what, fix=fix) from None
    result, records = evaluation.result, evaluation.records
    of_scene = records["scene"].to_numpy(str)
    columns, scores = tuple(column for column in result.columns if column.headline), {}
    for column in columns:
        values = records[column.key].to_numpy(np.float64)
        scenes = [values[of_scene == scene] for scene in result.scenes]
        value, spread, _ = round_score(result.overall[column.key], scenes, column, result.unit)
        low = high = None
        if spread is not None and math.isfinite(value):
            most = 1.0 if column.unit == "share" else math.inf
            low, high = max(0.0, value - _Z95 * spread), min(most, value + _Z95 * spread)
        scores[column.key] = Score(value=value, low=low, high=high, standard_error=spread)
    truth_of = {"benchmark_version": None, "truth": commitment_of(public), "sealed": True}
    return Answer(
        tree=tree,
        scored=now(),
        version=result.versions["airzoo-bench"],
        head=head_of(result).model_copy(update=truth_of | {"unit": "query"}),
        columns=columns,
        row=Row(kind="sealed", method=result.predictions.method, scores=scores),
        about_intervals="95 % intervals: the rounded score and 1.96 rounded standard errors.",
    )


def round_score(
    value: float, scenes: Sequence[Floats], column: ScoreColumn, unit: str = "query"
) -> tuple[float, float | None, float]:
    """Round the mean over scenes of a score, made of the values of their queries.

    Return it, its standard error if it is known, and the step of which it is a multiple.
    """
    if math.isinf(value):
        return value, None, 0.0
    count, sizes = len(scenes), np.array([len(values) for values in scenes])
    error: float | None = None
    if unit == "scene":
        digits = Decimal(1).scaleb(Decimal(value).adjusted() - 1 if value else -2)
        step = Decimal("0.01") if column.unit == "share" else digits
        shown, values = _nearest(value, step), np.concatenate(scenes)
        if count > 1 and np.isfinite(values).all():
            error = float(values.std(ddof=1)) / math.sqrt(count)
    elif column.unit == "share" and column.average == "mean":
        width = _up(math.hypot(*(0.5 / np.sqrt(sizes))) / count)
        step = max(width / 2, _up(FLIPS / float(sizes.min()) / count, 2))
        shown = min(_nearest(value, step), 1.0)
        rates = (shown * sizes + 2) / (sizes + 4)
        error = math.hypot(*np.sqrt(rates * (1 - rates) / sizes)) / count
    else:
        spreads = [_spread(values, column) for values in scenes]
        width = _up(math.hypot(*(wide for _, wide in spreads)) / count)
        unit_of = Decimal(1).scaleb(width.adjusted())
        # 1, 2, 5 or 10: steps are mostly those of a similar sample.
        step = next(unit_of * digit for digit in (1, 2, 5, 10) if width <= unit_of * digit) / 2
        shown = _nearest(value, step)
        known = [error for error, _ in spreads if error is not None]
        error = math.hypot(*known) / count if len(known) == count else None
    return shown, None if error is None else float(_up(error)), float(step)


def _spread(values: Floats, column: ScoreColumn) -> tuple[float | None, float]:
    """Return the standard error of a scene's score, if it is known, and a width for steps."""
    count = len(values)
    value = float(np.median(values) if column.average == "median" else values.mean())
    least = _LEAST_SHARE_OF_VALUE * abs(value)
    if column.average == "median":
        ranked, reach = np.sort(values), _Z95 * math.sqrt(count) / 2
        low = float(ranked[max(0, math.floor(count / 2 - reach))])
        high = float(ranked[min(count - 1, math.ceil(count / 2 + reach))])
        if math.isinf(high):
            return None, max((value - low) / _Z95, least)
        error = max((high - low) / (2 * _Z95), least)
    elif count < 2:
        return None, abs(value)
    else:
        error = max(float(values.std(ddof=1)) / math.sqrt(count), least)
    return error, error


def _up(number: float, digits: int = 1) -> Decimal:
    return Context(digits, ROUND_CEILING).create_decimal(repr(float(number)))


def _nearest(value: float, step: Decimal) -> float:
    return float(round(Decimal(repr(value)) / step) * step) if step else value
