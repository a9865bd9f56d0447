"""A sealed truth: what is public, how coarse the answer is, keys and archives, and CI's steps."""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
import socket
import struct
import tarfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, PngImagePlugin

from airzoo_bench.benchmark.folder import Benchmark, BenchmarkFile, write_benchmark_file
from airzoo_bench.benchmark.queries import POSE_COLUMNS
from airzoo_bench.core.errors import BenchmarkError, PredictionError, UsageError, UserError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.validation import read_toml
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard import checks
from airzoo_bench.leaderboard.answers import Answer
from airzoo_bench.leaderboard.board import Limits
from airzoo_bench.leaderboard.checks import CheckedSubmission
from airzoo_bench.leaderboard.data_branch import DataBranch, Try, check_tries
from airzoo_bench.leaderboard.pull_request import RefusedError
from airzoo_bench.leaderboard.sealed_scoring import opened_truth, round_score, score_sealed
from airzoo_bench.leaderboard.sealing import (
    KEY_VARIABLE,
    bare_photo,
    load_pyrage,
    read_key,
    recipient,
    seal,
)
from airzoo_bench.results.result import ScoreColumn
from tests.api.place import NAME, make_field
from tests.leaderboard.made import BOARD, Board, Hosted, files_of, git, submission
from tests.shared import made_once
from tests.statistics.support import ERROR, HIT
from tests.support import run_main, write_raster

SALT = "5a" * 32
TRUE_PLACE = "401234.5 3120234.5"
KEY = load_pyrage().x25519.Identity.generate()


@dataclass(frozen=True)
class SealedField:
    """A folder with its truth, and what was made of it."""

    folder: Path
    public: Path
    archive: Path


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a benchmark of every track with all files that `prepare` can write."""

    def make(root: Path) -> None:
        with mock.patch.dict("os.environ", {"AIRZOO_BENCH_DATA": str(root / "data")}):
            folder = make_field(root, "--copy", "--tiles", "files", "--crops", "files")
        path = folder / "data" / NAME / "images" / "a.png"
        notes = PngImagePlugin.PngInfo()
        notes.add_text("place", TRUE_PLACE)
        with Image.open(path) as image:
            exif = image.getexif()
            exif[0x010E] = TRUE_PLACE
            image.save(path, pnginfo=notes, exif=exif)
        with path.open("ab") as stream:
            stream.write(b"PK\x03\x04" + TRUE_PLACE.encode())

    return made_once(tmp_path_factory, "host", make) / "data" / NAME


@pytest.fixture(scope="module")
def sealed(field: Path, tmp_path_factory: pytest.TempPathFactory) -> SealedField:
    root = tmp_path_factory.mktemp("sealed")
    found = SealedField(field, root / NAME, root / "truth.age")
    with mock.patch("secrets.token_hex", return_value=SALT):
        seal(field, found.public, found.archive, KEY.to_public())
    return found


# --- the public folder ---

# File, whether it is in public, and whether it is there as it was.
TABLE = {
    "benchmark.toml": "rewritten",
    "prepared.json": "sealed",
    "protocols/*.toml": "same",
    "scenes/*/queries.csv": "rewritten",
    "scenes/*/retrieval/positives.npz": "sealed",
    "scenes/*/retrieval/overlaps.npz": "sealed",
    "scenes/*/retrieval/footprints.csv": "sealed",
    "scenes/*/retrieval/excluded.csv": "sealed",
    "scenes/*/retrieval/tiles.parquet": "same",
    "scenes/*/retrieval/dropped_tiles.csv": "same",
    "scenes/*/retrieval/tiles/tiles.csv": "same",
    "scenes/*/retrieval/tiles/*.png": "same",
    "scenes/*/matching/crops.csv": "same",
    "scenes/*/matching/map.json": "same",
    "scenes/*/matching/excluded.csv": "sealed",
    "scenes/*/matching/crops/crops.csv": "same",
    "scenes/*/matching/crops/*.tif": "same",
    "scenes/*/reconstruction/photos.csv": "same",
    "scenes/*/reconstruction/excluded.csv": "sealed",
    "data/*/images/a.png": "rewritten",  # it has metadata
    "data/*/images/*.png": "same",
    "data/*/dom.tif": "same",
    "data/*/dsm.tif": "same",
    "data/*/cloud.ply": "sealed",
}


def expected(name: str) -> str:
    """Return what becomes of a file; one that is not in the table fails the test."""
    return next(what for pattern, what in TABLE.items() if fnmatchcase(name, pattern))


def test_every_file_that_prepare_writes(sealed: SealedField) -> None:
    whole, public = files_of(sealed.folder), files_of(sealed.public)
    for name, content in whole.items():
        there = "same" if public.get(name) == content else "rewritten" if name in public else ""
        assert (there or "sealed") == expected(name), name
    assert public.keys() <= whole.keys()
    # All tracks are looked at: another one's files are sealed until somebody thinks about them.
    parts = {name.split("/")[2] for name in whole if name.count("/") > 2}
    assert parts >= set(TRACKS.names())


def test_no_true_number_and_no_metadata_is_anywhere(sealed: SealedField) -> None:
    path = f"scenes/{NAME}/queries.csv"
    whole, public = (pd.read_csv(of / path, dtype=str) for of in (sealed.folder, sealed.public))
    assert not {*POSE_COLUMNS, "altitude_m", "pitch_deg"} & set(public.columns)
    # The digits are those of the file, not of a number that was read.
    assert public.equals(whole[list(public.columns)])
    with (sealed.folder / path).open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    secrets = {row[name] for row in rows for name in ("x", "y", "z", "qw", "altitude_m")}
    texts = {text for text in secrets if len(text) > 5} | {TRUE_PLACE, SALT}
    # No hash of a sealed file either.
    texts |= {sha256_of(sealed.folder / name) for name in files_of(sealed.folder)
              if expected(name) != "same"}  # fmt: skip
    hidden = [*map(str.encode, texts), b"PK\x03\x04", bytes.fromhex(SALT)]
    assert len(hidden) > 30
    for name, content in files_of(sealed.public.parent).items():
        assert not [secret for secret in hidden if secret in content], name
    text = (sealed.public / "benchmark.toml").read_text()
    assert "cloud" not in text.split("[checksums]")[0].split("[[scenes]]")[1]


def _prior_is_true(folder: Path) -> None:
    path = folder / "scenes" / NAME / "queries.csv"
    table = pd.read_csv(path)
    for name in POSE_COLUMNS:
        table.loc[2, f"prior_{name}"] = table.loc[2, name]
    table.to_csv(path, index=False, lineterminator="\n")


def _outside(folder: Path) -> None:
    path, images = folder / "benchmark.toml", f'"data/{NAME}/images"'
    moved = shutil.copytree(folder / f"data/{NAME}/images", folder.parent / "images")
    path.write_text(path.read_text().replace(images, json.dumps(str(moved))))


@pytest.mark.parametrize(
    ("change", "said"),
    [(_prior_is_true, "priors equal the true pose: 1 of 5"), (_outside, "data outside the folder")],
)
def test_a_folder_that_cannot_be_sealed(
    field: Path, tmp_path: Path, change: Callable[[Path], None], said: str
) -> None:
    folder = Path(shutil.copytree(field, tmp_path / NAME))
    change(folder)
    values = read_toml(folder / "benchmark.toml", BenchmarkError, "benchmark file")
    write_benchmark_file(folder, BenchmarkFile.model_validate(values))
    with pytest.raises(BenchmarkError, match=said):
        seal(folder, tmp_path / "public", tmp_path / "truth.age", KEY.to_public())


# --- photos lose all that is no picture, and no pixel ---

SECRET = b"lat 47.123456 lon 8.654321"
XMP = b'http://ns.adobe.com/xap/1.0/\0<x:xmpmeta drone-dji:GpsLatitude="' + SECRET + b'"/>'
EXIF = b"Exif\0\0II*\0\x08\0\0\0\0\0" + SECRET


def picture(mode: str = "RGB") -> Image.Image:
    grey = np.random.default_rng(5).integers(0, 255, (24, 40)).astype(np.uint8)
    return Image.fromarray(np.kron(grey, np.ones((8, 8), np.uint8))).convert(mode)


def jpeg(mode: str = "RGB", **options: Any) -> bytes:
    stream = BytesIO()
    picture(mode).save(stream, "JPEG", **options)
    return stream.getvalue()


def png() -> bytes:
    stream, notes = BytesIO(), PngImagePlugin.PngInfo()
    notes.add_text("c", SECRET.decode())
    notes.add_itxt("i", SECRET.decode())
    notes.add_text("z", SECRET.decode(), zip=True)
    picture().save(stream, "PNG", pnginfo=notes, dpi=(72, 72), icc_profile=SECRET)
    return stream.getvalue()


def segment(code: int, body: bytes) -> bytes:
    return bytes((0xFF, code)) + struct.pack(">H", len(body) + 2) + body


def with_segments(data: bytes, *segments: bytes) -> bytes:
    return data[:2] + b"".join(segments) + data[2:]


def with_chunk(kind: bytes, body: bytes) -> bytes:
    found = struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    return png()[:33] + found + png()[33:]


APPS = [segment(code, SECRET) for code in range(0xE0, 0xF0)]
PREVIEW = segment(0xE0, b"JFIF\0\x01\x01\0\0\x01\0\x01\x01\x01" + SECRET[:3])
JFXX = segment(0xE0, b"JFXX\0\x10" + jpeg())
ZIP = b"PK\x03\x04" + SECRET
A_XMP = segment(0xE1, XMP)
PHOTOS: dict[str, Callable[[], bytes]] = {
    "exif": lambda: with_segments(jpeg(), segment(0xE1, EXIF)),
    "icc": lambda: jpeg(icc_profile=SECRET * 9000),
    "comment": lambda: with_segments(jpeg(), b"\xff" * 7 + segment(0xFE, SECRET)),
    "every application": lambda: with_segments(jpeg(), *APPS),
    "previews": lambda: with_segments(jpeg(), PREVIEW, JFXX),
    "a second picture": lambda: jpeg() + with_segments(jpeg(), A_XMP) + ZIP,
    "restarts": lambda: with_segments(jpeg(restart_marker_blocks=1), A_XMP),
    "grey": lambda: with_segments(jpeg("L"), A_XMP),
    "four colours": lambda: with_segments(jpeg("CMYK"), A_XMP),
    "between scans": lambda: jpeg(progressive=True).replace(
        b"\xff\xda", segment(0xE2, SECRET) + b"\xff\xda"
    ),
    "texts and profile": png,
    "exif chunk": lambda: with_chunk(b"eXIf", EXIF) + ZIP,
}


KNOWN = {"jfif", "jfif_version", "jfif_unit", "jfif_density", "adobe", "adobe_transform"}
KNOWN |= {"dpi", "progressive", "progression"}
PLAIN = {("APP0", 14, b"JFIF\0"), ("APP14", 12, b"Adobe")}


@pytest.mark.parametrize("name", PHOTOS)
def test_nothing_but_the_picture_is_left(name: str) -> None:
    before = PHOTOS[name]()
    after = bare_photo(before, Path("photo"))
    assert after != before
    for secret in (SECRET, b"Exif", b"xmp", b"ICC_PROFILE", b"JFXX", b"PK\x03\x04"):
        assert secret not in after
    with Image.open(BytesIO(before)) as one, Image.open(BytesIO(after)) as other:
        assert other.mode == one.mode
        assert np.array_equal(np.asarray(one), np.asarray(other))
        assert not {*other.info} - KNOWN  # as another reader sees it
        assert not {(n, len(body), body[:5]) for n, body in getattr(other, "applist", [])} - PLAIN
        assert not other.getexif()


DAMAGED = [b"", b"GIF89a", b"II*\0", jpeg()[:-2], jpeg()[:300], jpeg()[:20] + b"\0" + jpeg()[20:]]


@pytest.mark.parametrize("data", [*DAMAGED, png()[:-12]], ids=range(7))
def test_what_cannot_be_freed_of_metadata_is_refused(data: bytes) -> None:
    with pytest.raises(BenchmarkError, match="metadata cannot be taken out"):
        bare_photo(data, Path("photo.jpg"))


_SEGMENTS = st.lists(st.tuples(st.sampled_from(range(0xE0, 0xFF)), st.binary(max_size=40)))


@given(_SEGMENTS, st.binary(max_size=400))
def test_any_segments_go_and_any_bytes_are_cut_or_refused(
    segments: list[tuple[int, bytes]], data: bytes
) -> None:
    made = [segment(code, body) for code, body in segments if code != 0xEE]
    assert bare_photo(with_segments(jpeg(), *made) + data, Path("photo")) == jpeg()
    for head in (b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"):
        with suppress(BenchmarkError):
            assert bare_photo(head + data, Path("photo")).startswith(head[:2])


# --- keys and archives ---


def opened(public: Path, archive: Path, key: Any = KEY) -> dict[str, bytes]:
    with opened_truth(public, archive, key) as truth:
        assert truth.stat().st_mode & 0o077 == 0
        Benchmark.open(truth)
        return files_of(truth)


def test_opened_is_what_was_sealed_and_goes(sealed: SealedField) -> None:
    whole, found = files_of(sealed.folder), opened(sealed.public, sealed.archive)
    assert found.items() <= whole.items()
    assert whole.keys() - found.keys() == {f"data/{NAME}/images/a.png"}  # it had metadata
    for error in (UserError("x"), KeyboardInterrupt(), SystemExit(143)):
        with suppress(type(error)), opened_truth(sealed.public, sealed.archive, KEY) as truth:
            raise error
        assert not truth.exists()


@pytest.mark.parametrize("place", [3, -1, -40_000])
def test_a_damaged_archive_opens_nothing(place: int, sealed: SealedField, tmp_path: Path) -> None:
    data = bytearray(sealed.archive.read_bytes())
    data[place] ^= 1
    (tmp_path / "x.age").write_bytes(data)
    with pytest.raises(BenchmarkError, match="is damaged"):
        opened(sealed.public, tmp_path / "x.age")


def test_another_key_another_run_and_a_missing_file(sealed: SealedField, tmp_path: Path) -> None:
    other = load_pyrage().x25519.Identity.generate()
    with pytest.raises(BenchmarkError, match="sealed to another key"):
        opened(sealed.public, sealed.archive, other)
    seal(sealed.folder, tmp_path / "p", tmp_path / "x.age", KEY.to_public())
    with pytest.raises(BenchmarkError, match="belongs to another public folder"):
        opened(sealed.public, tmp_path / "x.age")
    public = Path(shutil.copytree(sealed.public, tmp_path / NAME))
    (public / "data" / NAME / "images" / "b.png").unlink()
    with pytest.raises(BenchmarkError, match=r"b\.png: a file of the public folder is missing"):
        opened(public, sealed.archive)


@pytest.mark.parametrize("name", ["/etc/x", "a/../../x"])
def test_an_archive_that_anybody_could_have_sealed_writes_nowhere_else(
    name: str, sealed: SealedField, tmp_path: Path
) -> None:
    """The public key is public: members are held to a manifest whose names stay in the folder."""
    file = {"sha256": SALT, "size": 1, "how": "sealed"}
    manifest = {"format": 1, "salt": SALT, "files": {name: file}}
    plain, path = BytesIO(), tmp_path / "x.age"
    with tarfile.open(fileobj=plain, mode="w") as tar:
        for member, text in (("manifest.json", json.dumps(manifest)), (f"files/{name}", "x")):
            entry = tarfile.TarInfo(member)
            entry.size = len(text)
            tar.addfile(entry, BytesIO(text.encode()))
    path.write_bytes(load_pyrage().encrypt(plain.getvalue(), [KEY.to_public()]))
    with pytest.raises(BenchmarkError, match=r"is damaged|another public"):
        opened(sealed.public, path)


@pytest.mark.parametrize("text", ["", "KEY\nKEY\n", "KEY!"])
def test_faults_of_keys_repeat_no_key(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, text.replace("KEY", str(KEY)))
    with pytest.raises(UsageError, match=KEY_VARIABLE) as caught:
        read_key()
    assert str(KEY)[20:40] not in str(caught.value)
    monkeypatch.setenv(KEY_VARIABLE, f"# a comment\n{KEY}\n")
    assert str(read_key()) == str(KEY)
    with pytest.raises(UsageError, match="no public key") as caught:
        recipient(str(KEY))
    assert str(KEY)[20:40] not in str(caught.value)


def test_the_command_and_places_that_it_refuses(
    sealed: SealedField, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    to, inside = str(KEY.to_public()), sealed.folder / "public"
    out, archive = tmp_path / "p/m", tmp_path / "p/a.age"
    for folder, public, file, key, said in (
        (sealed.folder, out, archive, "me", "no public key"),
        (sealed.folder, inside, inside.with_name("a.age"), to, "a wrong place"),
        (sealed.public, out, archive, to, "is sealed"),
        (sealed.folder, out, archive, to, ""),
        (sealed.folder, out, archive, to, "exists already"),
    ):
        call = ("seal", folder, "--out", public, "--archive", file, "--to", key)
        assert run_main(*call) == (2 if said else 0), said
        found = capsys.readouterr().err
        assert said in found
        assert found.count("airzoo-bench: ") == bool(said)
    assert run_main(*call, "--force") == 0
    assert run_main("template", f"{NAME}-matching", "--data", out, "--out", out / "t.npz") == 0


# --- the answer ---

MEAN = ERROR.model_copy(update={"average": "mean"})
COLUMNS = {"share": HIT, "median": ERROR, "mean": MEAN}


@pytest.mark.parametrize("track", ["retrieval", "matching", "reconstruction"])
def test_only_rounded_overall_scores_are_told(
    track: str, sealed: SealedField, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / NAME / track / "m"
    path = folder / ("preds" if track == "reconstruction" else "preds.npz")
    folder.mkdir(parents=True)
    call = ("template", f"{NAME}-{track}", "--data", sealed.public, "--out", path)
    assert run_main(*call) == 0
    data = sealed.public.parent
    checked = CheckedSubmission(folder, submission(protocol=f"{NAME}-{track}"), path)
    answer = score_sealed(checked, "7" * 64, sealed.archive, KEY, data, Run())
    whole = evaluate(path, data=sealed.folder, method="M")
    shown = [column for column in whole.result.columns if column.headline]
    assert set(answer.row.scores) == {column.key for column in shown}
    of_scene = whole.records["scene"].to_numpy(str)
    for column in shown:
        true, told = whole.result.overall[column.key], answer.row.scores[column.key].value
        values = whole.records[column.key].to_numpy(float)
        scenes = [values[of_scene == scene] for scene in whole.result.scenes]
        step = round_score(true, scenes, column, whole.result.unit)[2]
        assert told is not None
        assert told == true or abs(told - true) <= step / 2 + 1e-12 or told == 1
    text = answer.model_dump_json()
    assert not [secret for secret in (whole.result.truth.fingerprint, SALT) if secret in text]
    assert not {*answer.row.notes, *answer.row.scenes, *answer.row.conditions, *answer.floors}
    assert Answer.model_validate_json(text) == answer


@pytest.mark.parametrize("kind", COLUMNS)
@pytest.mark.parametrize("count", [20, 60, 300])
def test_errors_are_those_of_repeated_samples(kind: str, count: int) -> None:
    column, draws = COLUMNS[kind], np.random.default_rng(1).random((2000, 2, count))
    values = (draws < 0.4).astype(float) if column is HIT else -np.log1p(-draws)
    means = (np.median if column is ERROR else np.mean)(values, axis=2).mean(axis=1)
    found = [
        round_score(float(mean), [*row], column) for mean, row in zip(means, values, strict=True)
    ]
    stated = np.array([error for _, error, _ in found], float)
    # Order statistics of few queries are careful, and digits are rounded upward.
    assert 0.9 < np.sqrt(np.mean(stated**2)) / np.std(means) < 2


def test_steps_by_hand() -> None:
    """Two scenes of 60: an error of up to 0.0645 each, 0.0456 of both, upward 0.05; half is 0.025.

    But 4 queries of a scene move the mean by 4 / 60 / 2 = 0.0333, upward 0.034: 15 such steps are
    0.51. The rate with 4 more queries in a scene is (0.51 x 60 + 2) / 64 = 0.509; its error is
    (0.509 x 0.491 / 60) ** 0.5 = 0.0645, of both 0.0456: 0.05.
    """
    half = np.repeat((0.0, 1.0), 30)
    assert round_score(0.5, [half, half], HIT) == (0.51, 0.05, 0.034)
    assert round_score(0.5, [np.repeat((0.0, 1.0), 5000)], HIT) == (0.5, 0.005, 0.0025)
    for value in (0.0, 1.0):
        assert round_score(value, [np.full(100, value)], HIT)[:2] == (value, 0.02)
    values = np.array([1.0, 2.0, 3.0, *[math.inf] * 5])
    assert round_score(math.inf, [values], ERROR) == (math.inf, None, 0.0)
    some = np.array([*range(1, 12), *[math.inf] * 9], float)
    value, error, step = round_score(float(np.median(some)), [some], ERROR)
    assert math.isfinite(value)
    assert (error, step > 0) == (None, True)


@pytest.mark.parametrize("column", [HIT, ERROR], ids=["share", "median"])
def test_one_query_mostly_changes_nothing(column: ScoreColumn) -> None:
    random, same = np.random.default_rng(3), 0
    for _ in range(400):
        values = random.exponential(1.0, 60)
        if column is HIT:
            values = (random.random(60) < random.uniform(0.1, 0.9)).astype(float)
        other, place = values.copy(), random.integers(60)
        other[place] = 1.0 - other[place] if column is HIT else random.exponential(1.0)
        average = np.median if column is ERROR else np.mean
        one, two = (round_score(float(average(v)), [v], column) for v in (values, other))
        same += one == two
    assert same >= 400 * 0.7


def test_a_scene_of_one_query_is_not_read_off_the_mean() -> None:
    random = np.random.default_rng(3)
    others = [(random.random(200) < 0.5).astype(float) for _ in range(10)]
    both = [[*others, np.array([hit])] for hit in (0.0, 1.0)]
    told = {round_score(float(np.mean([one.mean() for one in s])), s, HIT)[0] for s in both}
    assert len(told) == 1


# --- tries ---

TWO_TRIES = Limits(tries=2, days=30)


def line(head: str, day: int, outcome: str = "started", account: int = 7) -> Try:
    return Try(str(account), "made", head, outcome, f"2026-11-{day:02}T00:00:00Z")


@pytest.mark.parametrize(
    ("tries", "refused"),
    [
        ([line("a", 1)], False),
        ([line("a", 1), line("b", 2)], True),
        ([line("a", 1), line("b", 2, account=8)], False),
        ([line("a", 1), line("a", 2), line("a", 2, "scored")], False),  # one commit is one try
        ([line("a", 1), line("b", 2), line("b", 3, "failed")], False),
        ([line("a", 1), line("b", 2), line("c", 2)], True),  # c itself was begun: a fourth job
    ],
)
def test_a_try_beyond_the_limit_is_refused(tries: list[Try], refused: bool) -> None:
    if not refused:
        check_tries(tries, line("c", 5), TWO_TRIES)
        return
    with pytest.raises(RefusedError, match="has had 2 tries on made within 30 days"):
        check_tries(tries, line("c", 5), TWO_TRIES)
    check_tries(tries[:2], Try("7", "made", "d", "started", "2026-12-01T00:00:01Z"), TWO_TRIES)


def test_two_jobs_at_once_cannot_both_have_the_last_try(tmp_path: Path) -> None:
    hosted = Hosted(tmp_path / "hosted.git", {".keep": b""})
    first, second = (DataBranch(tmp_path / name, str(hosted.folder)) for name in "ab")
    limits = Limits(tries=1, days=30)
    first.add_try(line("a", 1), limits)
    with pytest.raises(RefusedError, match="has had 1 try"):
        second.add_try(line("b", 1), limits)
    second.add_try(line("b", 1, account=8), limits)
    again = DataBranch(tmp_path / "c", str(hosted.folder))
    assert [one.head for one in again.tries()] == ["a", "b"]


# --- the steps of CI ---


@pytest.fixture
def sealed_board(board: Board, data: Path, monkeypatch: pytest.MonkeyPatch) -> Board:
    """Return a board of the made benchmark whose truth is sealed."""
    public, archive = board.home / "public", board.home / "public/made.age"
    write_raster(data / "made/dom.tif", np.full((3, 64, 64), 90, np.uint8))
    (data / "made/images").mkdir()
    for number in range(6):
        image = Image.new("RGB", (32, 24), (number, 90, 30))
        image.save(data / f"made/images/q{number:05d}.jpg")
    to = KEY.to_public()
    board.run("seal", data / "made", "--out", public / "made", "--archive", archive, "--to", to)
    archive.replace(board.main / "made.age")
    monkeypatch.setenv(KEY_VARIABLE, str(KEY))
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(public))
    monkeypatch.setattr(socket, "if_nameindex", lambda: [(1, "lo")])
    limits = BOARD.replace("[[", "[limits]\ntries = 1\ndays = 30\n[[", 1)
    (board.main / "leaderboard.toml").write_text(f'{limits}sealed = "made.age"\n')
    board.push_main("A sealed board")
    return board


def checked(board: Board, fork: Path, number: int = 1) -> Path:
    """Play the job that checks a submission, and return the folder of its files."""
    work = board.score(number, board.propose(fork, number))
    assert json.loads((work / "found-score.json").read_text())["kind"] == "sealed"
    return work


def open_truth(board: Board, work: Path, code: int = 0) -> Any:
    return board.run(
        "leaderboard", "score", "--sealed", work / "found-score.json", "--work",
        work / "work", "--root", board.main, "--out", work / "found-sealed.json", code=code,
    )  # fmt: skip


def test_a_sealed_submission_from_pull_request_to_board(
    sealed_board: Board, perfect: dict[str, list[Any]]
) -> None:
    board, fork = sealed_board, sealed_board.clone("ada")
    board.submit(fork, perfect, "Salad")
    work = checked(board, fork)
    head = git(fork, "rev-parse", "HEAD")
    board.step("keep", work / "found-score.json", "--started", "--out", work / "try.json")
    open_truth(board, work)
    artifacts = [work / name for name in ("found-score.json", "try.json", "found-sealed.json")]
    board.step("keep", artifacts[2])
    comment = board.comment(*artifacts)
    assert "Rounded to half a standard error" in comment
    assert "| `average` | 10 |" in comment
    assert "records_sha256" not in artifacts[2].read_text()

    # One try within 30 days: the next commit has none, and its truth is not opened.
    board.submit(fork, perfect, "Salad", "--force", "--set", "summary=Other words.")
    work, refused = checked(board, fork), board.home / "refused.json"
    options = ("--started", "--out", refused)
    done = board.step("keep", work / "found-score.json", *options, code=1)
    assert "this account has had 1 try on made within 30 days" in done.stderr
    assert "this account has had 1 try" in board.comment(refused)

    # What was pushed after the scoring is not what is merged: the board says so.
    board.merge(1, git(fork, "rev-parse", "HEAD"))
    board.rescore(code=1, said="were not scored against the sealed truth before they were merged")
    git(board.main, "revert", "--no-edit", "HEAD")
    git(board.main, "push", "--quiet", "origin", "HEAD:main")

    # The commit that was scored gets its answer on the board, without the key.
    board.hosted.pull(1, head)
    board.merge(1, head)
    data = board.rescore()
    run = data / "runs/made/retrieval/salad/1"
    answer = json.loads((run / "run.json").read_text())
    names = ["run.json", "submission.toml"]
    assert sorted(path.name for path in run.iterdir()) == names

    # An answer from before the truth was sealed anew would make that one's table the newest.
    public = Path(os.environ["AIRZOO_BENCH_DATA"]) / "made" / "benchmark.toml"
    public.write_text(public.read_text().replace(answer["head"]["truth"], "0" * 64))
    board.rescore(code=1, said="scored against an earlier truth")

    # One that is on the board stays where it is, and the log says how it comes to the new truth.
    board.step("keep", data)
    data = board.rescore(said="not scored again")
    assert [path.name for path in data.glob("runs/made/retrieval/salad/*")] == ["1"]


def test_what_only_the_truth_shows_is_a_try_and_a_failed_job_is_none(
    sealed_board: Board, perfect: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Were it given back, whoever finds such a fault could ask the truth without end."""
    board, fork, score = sealed_board, sealed_board.clone("ada"), checks.evaluate
    board.submit(fork, perfect, "Salad")
    work = checked(board, fork)
    found = work / "found-score.json"
    for started in (["--started"], [], ["--started"], []):  # the job failed: it comes back
        board.step("keep", found, *started)
    assert "This does not count as a try" in board.comment(found)

    def fail(*_: Any, **__: Any) -> None:
        raise PredictionError("45.1 degrees off the truth")

    def near(*arguments: Any, **options: Any) -> Any:
        scored = score(*arguments, **options)
        counts = {scene: one | {"near_prior": 1} for scene, one in scored.result.counts.items()}
        return replace(scored, result=scored.result.model_copy(update={"counts": counts}))

    board.step("keep", found, "--started")
    for evaluation, said in ((near, "the photo's own prior"), (fail, "not told")):
        monkeypatch.setattr(checks, "evaluate", evaluation)
        open_truth(board, work, code=1)
        comment = board.comment(work / "found-sealed.json")
        assert said in comment
        assert "The truth was opened" in comment
        assert "45.1" not in comment
    board.step("keep", work / "found-sealed.json", code=1)
    assert ",scored," in board.data_file("tries.csv").splitlines()[-1]


def test_changed_files_and_a_network_keep_the_truth_closed(
    sealed_board: Board, perfect: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    board, fork = sealed_board, sealed_board.clone("ada")
    board.submit(fork, perfect, "Salad")
    work = checked(board, fork)
    [toml] = (work / "work").rglob("submission.toml")
    text = toml.read_text()
    monkeypatch.setattr("airzoo_bench.leaderboard.scoring.score_sealed", None)
    toml.write_text(text.replace("CC-BY-4.0", "MIT"))
    assert "not the files" in str(open_truth(board, work, code=1).exception)
    monkeypatch.setattr(socket, "if_nameindex", lambda: [(1, "lo"), (2, "eth0")])
    assert "while there is a network (eth0)" in str(open_truth(board, work, code=1).exception)
    assert not (work / "found-sealed.json").exists()
