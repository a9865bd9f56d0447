"""The most memory that small files make a run take."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from airzoo_bench.core.files import write_npz
from tests.reconstruction import world as reconstruction
from tests.support import HANGS_S, MadeScene, made_protocol, write_benchmark

_DRIVER = """
import re, sys
from airzoo_bench.cli.main import main
try:
    main()
except SystemExit as done:
    code = int(done.code or 0)
else:
    code = 0
status = open("/proc/self/status").read()
sys.stderr.write("\\npeak " + re.search(r"VmHWM:\\s+(\\d+)", status)[1])
sys.exit(code)
"""
"""Of a child, `ru_maxrss` counts what its parent held when it was forked; VmHWM does not."""


def run(*arguments: object, data: Path) -> tuple[int, int, str]:
    """Run the command line; return its exit code, the peak of its memory in bytes, its words."""
    done = subprocess.run(
        [sys.executable, "-c", _DRIVER, *map(str, arguments)],
        env=os.environ | {"AIRZOO_BENCH_DATA": str(data), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=HANGS_S,
        check=False,
    )
    said, _, peak = done.stderr.rpartition("\npeak ")
    assert peak, f"ended with {done.returncode}: {done.stderr[-2000:]}"
    return done.returncode, int(peak) * 1024, said


LIMIT = 24 << 20
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
    fields = reconstruction.World(folder).views("yard")
    fields["depth"] = np.ones((6, 700, 3000), np.float16)
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
def test_small_files_stay_below_the_limit(make, of, home, tmp_path) -> None:
    track, protocol = of
    options = ("--protocol", protocol, "--max-memory", "24M", "--untrusted")
    code, peak, said = run("eval", track, make(tmp_path), *options, data=home)
    assert code == 2, said
    assert peak < LIMIT + ROOM, f"{peak / 1e6:.0f} MB: {said}"
