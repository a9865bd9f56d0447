"""What small files make a run hold, measured in processes of their own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from airzoo_bench.core.files import write_npz
from tests.hostile.peak import run
from tests.reconstruction import world as reconstruction
from tests.support import MadeScene, made_protocol, write_benchmark

LIMIT = 48 << 20
# Of the libraries that are loaded, and buffers of one size whatever the limit.
ROOM = 200 << 20
IDS = [f"east/q{q:05d}" for q in range(6)]
RETRIEVAL = ("retrieval", "made-retrieval-retrieval")
RECONSTRUCTION = ("reconstruction", reconstruction.PROTOCOL)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a data root with a benchmark of each kind that the files below are for."""
    root = tmp_path_factory.mktemp("data")
    scenes = [MadeScene("east", [[q, q + 1] for q in range(6)], 12)]
    write_benchmark(root / "made-retrieval", made_protocol(scenes, "made-retrieval"), scenes)
    reconstruction.make_world(root)
    return root


def many_fields(folder: Path) -> Path:
    """Write fields that are each below the limit and compress to almost nothing."""
    wide = np.zeros((6, (LIMIT - 1000) // 12), np.float16)
    ids = np.array(IDS)
    fields = {"query_ids": ids, "query_descriptors": wide}
    fields |= {"gallery_ids": ids, "gallery_descriptors": wide}
    write_npz(folder / "a.npz", fields, compress=True)
    return folder / "a.npz"


def one_long_list(folder: Path) -> Path:
    """Write a list of 100 million ids in a kilobyte."""
    coded = pa.DictionaryArray.from_arrays(
        pa.array(np.zeros(10**8, np.int8)), pa.array(["east/t0"])
    )
    lists = pa.ListArray.from_arrays(pa.array([0, 10**8], pa.int32()), coded)
    table = pa.table({"query_ids": pa.array(IDS[:1]), "ranked_ids": lists})
    pq.write_table(table, folder / "a.parquet", compression="zstd")
    return folder / "a.parquet"


def views(folder: Path) -> Path:
    """Write depth maps that are small as they stand and large while they are fused."""
    fields = reconstruction.World(folder).views("yard", depth=np.ones((6, 700, 3000), np.float16))
    (folder / "p").mkdir()
    write_npz(folder / "p" / "yard.npz", fields, compress=True)
    return folder / "p"


@pytest.mark.parametrize(
    ("make", "of"),
    [
        (many_fields, RETRIEVAL),
        pytest.param(one_long_list, RETRIEVAL, marks=pytest.mark.slow),
        pytest.param(views, RECONSTRUCTION, marks=pytest.mark.slow),
    ],
)
def test_small_files_stay_below_the_limit(
    make: Callable[[Path], Path], of: tuple[str, str], home: Path, tmp_path: Path
) -> None:
    track, protocol = of
    options = ("--protocol", protocol, "--max-memory", "48M", "--untrusted")
    done = run("eval", track, make(tmp_path), *options, data=home)
    assert done.code == 2, done.said
    assert done.peak < LIMIT + ROOM, f"{done.peak / 1e6:.0f} MB: {done.said}"
