"""What small files make a run hold, measured in processes of their own."""

from __future__ import annotations

import gzip
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.hostile.peak import Ended, run
from tests.reconstruction import world as reconstruction
from tests.support import MadeScene, made_protocol, write_benchmark

LIMIT = 48 << 20
# Of the libraries that are loaded, and buffers of one size whatever the limit.
ROOM = 200 << 20
IDS = [f"east/q{q:05d}" for q in range(6)]


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a data root with a benchmark of each kind that the files below are for."""
    root = tmp_path_factory.mktemp("data")
    scenes = [MadeScene("east", [[q, q + 1] for q in range(6)], 12)]
    write_benchmark(root / "made-retrieval", made_protocol(scenes, "made-retrieval"), scenes)
    reconstruction.make_world(root)
    return root


def packed(path: Path, method: int = zipfile.ZIP_DEFLATED, **fields: Any) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, array in fields.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, np.asanyarray(array), allow_pickle=False)
    return path


def many_fields(path: Path) -> Path:
    """Fields that are each below the limit and compress to almost nothing."""
    wide = np.zeros((6, (LIMIT - 1000) // 12), np.float16)
    return packed(
        path / "a.npz",
        zipfile.ZIP_DEFLATED,
        query_ids=IDS,
        query_descriptors=wide,
        gallery_ids=IDS,
        gallery_descriptors=wide,
    )


def many_ranks(path: Path) -> Path:
    ranks = np.tile(np.array([f"east/t{t:07d}" for t in range(1000)]), (6, 140))
    return packed(path / "a.npz", query_ids=IDS, ranked_ids=ranks)


def one_long_list(path: Path) -> Path:
    """A list of 100 million ids in a kilobyte."""
    coded = pa.DictionaryArray.from_arrays(
        pa.array(np.zeros(10**8, np.int8)), pa.array(["east/t0"])
    )
    lists = pa.ListArray.from_arrays(pa.array([0, 10**8], pa.int32()), coded)
    table = pa.table({"query_ids": pa.array(IDS[:1]), "ranked_ids": lists})
    pq.write_table(table, path / "a.parquet", compression="zstd")
    return path / "a.parquet"


def one_long_page(path: Path) -> Path:
    table = pa.table({"query_ids": pa.array(["east/q00000" * 40] * 1_000_000)})
    pq.write_table(
        table, path / "a.parquet", compression="zstd", use_dictionary=False, data_page_size=1 << 30
    )
    return path / "a.parquet"


@pytest.mark.parametrize(
    "make",
    [
        many_fields,
        pytest.param(many_ranks, marks=pytest.mark.slow),
        pytest.param(one_long_list, marks=pytest.mark.slow),
        one_long_page,
    ],
)
def test_retrieval_files_stay_below_the_limit(
    make: Callable[[Path], Path], home: Path, tmp_path: Path
) -> None:
    path = make(tmp_path)
    assert path.stat().st_size < 3_000_000
    protocol = ("--protocol", "made-retrieval-retrieval")
    done = run(
        "eval", "retrieval", path, *protocol, "--max-memory", "48M", "--untrusted", data=home
    )
    _small(done)


def extended_headers(path: Path) -> Path:
    """A tar archive whose first header is half a gigabyte of text about the second."""
    info = tarfile.TarInfo("x")
    info.type, info.size = tarfile.XHDTYPE, 1 << 29
    with gzip.open(path / "a.tar.gz", "wb", compresslevel=1) as stream:
        stream.write(info.tobuf(tarfile.USTAR_FORMAT))
        for _ in range(1 << 9):
            stream.write(bytes(1 << 20))
    return path / "a.tar.gz"


def sparse_map(path: Path) -> Path:
    """A tar archive with a file of which a list of holes is all, in the PAX 1.0 way."""
    info = tarfile.TarInfo("yard.ply")
    info.pax_headers = {"GNU.sparse.major": "1", "GNU.sparse.minor": "0"}
    info.size = 1 << 28
    with gzip.open(path / "a.tar.gz", "wb", compresslevel=1) as stream:
        stream.write(info.tobuf(tarfile.PAX_FORMAT))
        stream.write(b"99999999\n" + b"0\n" * (1 << 27))
    return path / "a.tar.gz"


def views(path: Path) -> Path:
    """Depth maps that are small as they stand and large while they are fused."""
    world = reconstruction.World(path)
    fields = world.views("yard", depth=np.ones((6, 1000, 3000), np.float16))
    (path / "p").mkdir()
    packed(path / "p" / "yard.npz", **fields)
    return path / "p"


@pytest.mark.parametrize(
    "make", [extended_headers, pytest.param(sparse_map, marks=pytest.mark.slow), views]
)
def test_reconstructions_stay_below_the_limit(
    make: Callable[[Path], Path], home: Path, tmp_path: Path
) -> None:
    path = make(tmp_path)
    protocol = ("--protocol", reconstruction.PROTOCOL, "--max-memory", "48M")
    done = run("eval", "reconstruction", path, *protocol, "--untrusted", data=home)
    _small(done)


def _small(done: Ended) -> None:
    assert done.code == 2, done.said
    assert done.peak < LIMIT + ROOM, f"{done.peak / 1e6:.0f} MB: {done.said}"
