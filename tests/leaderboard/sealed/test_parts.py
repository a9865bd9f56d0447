"""Which files are public: a table over everything that `prepare` writes."""

from __future__ import annotations

import csv
import json
import shutil
from fnmatch import fnmatchcase
from pathlib import Path

import pandas as pd
import pytest

from airzoo_bench.benchmark.queries import POSE_COLUMNS
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.leaderboard.sealing import recipient, seal
from tests.api.place import NAME, TILES
from tests.leaderboard.sealed.conftest import SALT, TRUE_PLACE, SealedField

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
    files = [path for path in sealed.folder.rglob("*") if path.is_file()]
    seen = set()
    for path in files:
        name = path.relative_to(sealed.folder).as_posix()
        there = sealed.public / name
        same = there.is_file() and there.read_bytes() == path.read_bytes()
        found = "same" if same else "rewritten" if there.is_file() else "sealed"
        assert found == expected(name), name
        seen.add(name)
    assert {
        p.relative_to(sealed.public).as_posix() for p in sealed.public.rglob("*") if p.is_file()
    } <= seen
    # All tracks are looked at: another one's files are sealed until somebody thinks about them.
    assert {name.split("/")[2] for name in seen if name.count("/") > 2} >= set(TRACKS.names())


def test_queries_have_no_pose_and_nothing_made_of_one(sealed: SealedField) -> None:
    path = f"scenes/{NAME}/queries.csv"
    whole, public = (pd.read_csv(of / path, dtype=str) for of in (sealed.folder, sealed.public))
    assert not set(POSE_COLUMNS) & set(public.columns)
    assert {"altitude_m", "pitch_deg"} <= set(whole.columns) - set(public.columns)
    # The digits are those of the file, not of a number that was read.
    assert public.equals(whole[list(public.columns)])


def test_no_true_number_and_no_metadata_is_anywhere(sealed: SealedField) -> None:
    with (sealed.folder / f"scenes/{NAME}/queries.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    secrets = {row[name] for row in rows for name in ("x", "y", "z", "qw", "altitude_m")}
    secrets = {text.encode() for text in secrets if len(text) > 5}
    secrets |= {TRUE_PLACE.encode(), b"PK\x03\x04", SALT.encode(), bytes.fromhex(SALT)}
    assert len(secrets) > 20
    for path in (*sealed.public.rglob("*"), sealed.archive):
        if path.is_file():
            content = path.read_bytes()
            assert not [secret for secret in secrets if secret in content], path


def test_no_hash_of_what_is_sealed(sealed: SealedField) -> None:
    from airzoo_bench.core.files import sha256_of

    text = (sealed.public / "benchmark.toml").read_text()
    hidden = [p for p in sealed.folder.rglob("*") if p.is_file()]
    names = [p for p in hidden if expected(p.relative_to(sealed.folder).as_posix()) != "same"]
    assert len(names) > 7
    assert not [path for path in names if sha256_of(path) in text]
    assert "cloud" not in text.split("[checksums]")[0].split("[[scenes]]")[1]


def copied(field: Path, root: Path) -> Path:
    return Path(shutil.copytree(field, root / NAME))


def sealed_again(folder: Path, key: str) -> Path:
    public = folder.parent / "public"
    seal(folder, public, folder.parent / "truth.age", recipient(key), salt=SALT)
    return public


def rewritten_checksums(folder: Path) -> None:
    from airzoo_bench.benchmark.folder import BenchmarkFile, write_benchmark_file
    from airzoo_bench.core.validation import read_toml

    values = read_toml(folder / "benchmark.toml", BenchmarkError, "benchmark file")
    write_benchmark_file(folder, BenchmarkFile.model_validate(values))


def test_columns_rows_and_keys_by_hand_are_sealed(
    field: Path, sealed: SealedField, tmp_path: Path
) -> None:
    """A folder made by hand may say more in its tables, and in another order."""
    folder = copied(field, tmp_path)
    home = folder / "scenes" / NAME
    tiles = pd.read_parquet(home / "retrieval" / "tiles.parquet").assign(answers="field/a")
    tiles.attrs["note"] = "answers field/a"
    tiles.to_parquet(home / "retrieval" / "tiles.parquet", index=False)
    crops = pd.read_csv(home / "matching" / "crops.csv").assign(error_m=0.125)[::-1]
    crops.to_csv(home / "matching" / "crops.csv", index=False, lineterminator="\n")
    rewritten_checksums(folder)
    public = sealed_again(folder, str(sealed.key.to_public()))
    read = pd.read_parquet(public / "scenes" / NAME / "retrieval" / "tiles.parquet")
    assert "answers" not in read.columns
    assert set(TILES) & set(read["id"])
    assert b"answers" not in (public / "scenes" / NAME / "retrieval" / "tiles.parquet").read_bytes()
    written = pd.read_csv(public / "scenes" / NAME / "matching" / "crops.csv")
    assert "error_m" not in written
    assert list(written["id"]) == sorted(written["id"])  # an order that tells is gone


def test_the_surface_model_is_sealed_where_nobody_is_given_it(
    field: Path, sealed: SealedField, tmp_path: Path
) -> None:
    folder = copied(field, tmp_path)
    shutil.rmtree(folder / "scenes" / NAME / "matching")
    (folder / "protocols" / f"{NAME}-matching.toml").unlink()
    text = (folder / "benchmark.toml").read_text()
    start = text.index("[tracks.matching.crop]")
    (folder / "benchmark.toml").write_text(text[:start] + text[text.index("[tracks.recon") :])
    rewritten_checksums(folder)
    public = sealed_again(folder, str(sealed.key.to_public()))
    assert not (public / "data" / NAME / "dsm.tif").exists()
    assert "dsm" not in (public / "benchmark.toml").read_text().split("[[scenes]]")[1]
    assert "plane_height_m" not in (public / "benchmark.toml").read_text()


def test_priors_that_are_the_truth_are_refused(
    field: Path, sealed: SealedField, tmp_path: Path
) -> None:
    folder = copied(field, tmp_path)
    path = folder / "scenes" / NAME / "queries.csv"
    table = pd.read_csv(path)
    for name in POSE_COLUMNS:
        table.loc[2, f"prior_{name}"] = table.loc[2, name]
    table.to_csv(path, index=False, lineterminator="\n")
    rewritten_checksums(folder)
    with pytest.raises(BenchmarkError, match="priors equal the true pose: 1 of 5"):
        sealed_again(folder, str(sealed.key.to_public()))


def test_data_outside_the_folder_are_refused(
    field: Path, sealed: SealedField, tmp_path: Path
) -> None:
    folder = copied(field, tmp_path)
    text = (folder / "benchmark.toml").read_text()
    moved = text.replace(f'"data/{NAME}/images"', json.dumps(str(field / "data" / NAME / "images")))
    (folder / "benchmark.toml").write_text(moved)
    with pytest.raises(BenchmarkError, match="data outside the folder"):
        sealed_again(folder, str(sealed.key.to_public()))
