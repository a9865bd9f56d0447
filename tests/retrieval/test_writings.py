"""The same answer scores the same in every writing that a user may choose."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import airzoo_bench as ab
from tests.readers.retrieval_support import PROTOCOL, made_scenes
from tests.readers.samples import vpr
from tests.support import MadeScene, made_protocol, write_benchmark

SCENE = made_scenes()[0]
WHOLE = ["b1", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f2", "f4", ">f8"]
Change = Callable[[Any], Any]


def lists() -> dict[str, Any]:
    """Return lists of six of twelve tiles with scores, some of which tie."""
    random = np.random.default_rng(0)
    ranked = [random.permutation(SCENE.tile_ids)[:6] for _ in SCENE.query_ids]
    scores = -np.sort(-random.integers(0, 9, (6, 6)), axis=1)
    return {
        "query_ids": np.array(SCENE.query_ids),
        "ranked_ids": np.array(ranked),
        "scores": scores,
    }


def descriptors() -> dict[str, Any]:
    """Return descriptors of zeros and ones."""
    random = np.random.default_rng(0)
    return {
        "query_ids": np.array(SCENE.query_ids),
        "gallery_ids": np.array(SCENE.tile_ids),
        "query_descriptors": random.integers(0, 2, (6, 16)).astype(float),
        "gallery_descriptors": random.integers(0, 2, (12, 16)).astype(float),
    }


def npz(arrays: dict[str, Any], path: Path, change: Change = np.asarray, **options: Any) -> Path:
    """Write a file whose numbers are changed first."""
    own = {one: change(rows) if rows.dtype.kind != "U" else rows for one, rows in arrays.items()}
    save = np.savez_compressed if options else np.savez
    save(path.with_suffix(".npz"), protocol=PROTOCOL, **own)
    return path.with_suffix(".npz")


def parquet(path: Path, change: Change = np.asarray, index: Any = None) -> Path:
    own = lists()
    table = pd.DataFrame(
        {
            "query_ids": own["query_ids"],
            "ranked_ids": own["ranked_ids"].tolist(),
            "scores": list(change(own["scores"])),
        },
        index=index,
    )
    table.to_parquet(path.with_suffix(".parquet"))
    return path.with_suffix(".parquet")


def log(path: Path, change: Change) -> Path:
    """Write a log folder of VPR-methods-evaluation."""
    vpr.write_log(path, SCENE)
    for ours, theirs in (("query", "queries"), ("gallery", "database")):
        np.save(path / f"{theirs}_descriptors.npy", change(descriptors()[f"{ours}_descriptors"]))
    return path


def typed(dtype: str) -> Change:
    return lambda rows: rows.astype(dtype)


WRITINGS: dict[str, tuple[dict[str, Any], Callable[[Path], Path]]] = {
    **{f"scores {t}": (lists(), lambda path, t=t: npz(lists(), path, typed(t))) for t in WHOLE[1:]},
    **{
        f"descriptors {t}": (descriptors(), lambda path, t=t: npz(descriptors(), path, typed(t)))
        for t in WHOLE
    },
    "descriptors columns first": (
        descriptors(),
        lambda path: npz(descriptors(), path, np.asfortranarray),
    ),
    "descriptors compressed": (
        descriptors(),
        lambda path: npz(descriptors(), path, typed("u1"), compressed=True),
    ),
    "parquet": (lists(), parquet),
    "parquet with an index": (lists(), lambda path: parquet(path, index=list("fedcba"))),
    "parquet of int16": (lists(), lambda path: parquet(path, typed("i2"))),
    "npy columns first": (descriptors(), lambda path: log(path, np.asfortranarray)),
    "npy of uint8": (descriptors(), lambda path: log(path, typed("u1"))),
    "npy of bool": (descriptors(), lambda path: log(path, typed("?"))),
}


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenes: list[MadeScene] = [SCENE]
    folder = tmp_path_factory.mktemp("data")
    write_benchmark(folder / "made", made_protocol(scenes), scenes)
    return folder


@pytest.mark.parametrize("writing", WRITINGS)
def test_every_writing_scores_alike(writing: str, one: Path, tmp_path: Path) -> None:
    plain, write = WRITINGS[writing]
    records = [
        ab.evaluate(path, protocol=PROTOCOL, data=one).records
        for path in (npz(plain, tmp_path / "plain", typed("f8")), write(tmp_path / "written"))
    ]
    assert 0 < records[0]["map"].mean() < 1
    assert records[1].equals(records[0])
