"""Pickles of matchers: recognised, never loaded, and answered with the lines that mend them."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import ClassVar

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import first_bytes
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions

_HEAD_BYTES = 1 << 16
_MOST_FILES = 1000
_DAMAGE = (EOFError, NotImplementedError, OSError, RuntimeError, ValueError)


class PickledMatches(Reader):
    """Files of one kind that only running them would read.

    `suffix` is that of the files, or of those in a folder; `mark` stands near the beginning of the
    pickle; `lines` are what the user runs where the files were written, and trusts them.
    """

    track = "matching"
    suffix: ClassVar[str]
    mark: ClassVar[bytes]
    lines: ClassVar[str]

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        first = next(self._files(path), None)
        return 0.9 * (first is not None and self.mark in _head(first))

    def _files(self, path: Path) -> Iterator[Path]:
        found = islice(path.iterdir(), _MOST_FILES) if path.is_dir() else iter([path])
        return (one for one in found if one.suffix == self.suffix and one.is_file())

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`; it refuses."""
        lines = "\n            ".join(self.lines.strip().splitlines())
        raise PredictionError(
            f"is {self.title}: a Python pickle, which would run whatever it says, and is never "
            "loaded",
            where=path,
            expected="arrays that numpy.savez wrote",
            fix=f"where you made these files and trust them:\n            {lines}",
        )


def _head(path: Path) -> bytes:
    """Return the first bytes of a pickle, alone or in the zip of torch.save."""
    head = first_bytes(path, _HEAD_BYTES)
    if not head.startswith(b"PK"):
        return head
    try:
        with zipfile.ZipFile(path) as archive:
            name = next(one for one in archive.namelist() if one.endswith("/data.pkl"))
            with archive.open(name) as stream:
                return stream.read(_HEAD_BYTES)
    except (*_DAMAGE, StopIteration, zipfile.BadZipFile, zlib.error):
        return b""


class _Vismatch(PickledMatches):
    title = "results of vismatch"
    layout = "*.torch: what torch.save made of a dictionary with matched_kpts0"
    methods = ("vismatch", "image-matching-models")
    suffix, mark = ".torch", b"matched_kpts0"
    lines = """
import glob, numpy as np, pathlib, torch
pathlib.Path("matches").mkdir()
for f in glob.glob("outputs/*/*.torch"):
    r = torch.load(f, weights_only=False)
    size = [512, 512]  # --im-size: both pictures are stretched to this square
    np.savez(f"matches/{pathlib.Path(r['img0_path']).stem}.npz", mkpts0_f=r["matched_kpts0"],
             mkpts1_f=r["matched_kpts1"], image_size0=size, image_size1=size)
airzoo-bench eval matching matches --protocol NAME
"""


class _LoftrDump(PickledMatches):
    title = "LoFTR's dump of an evaluation"
    layout = "LoFTR_pred_eval.npy: an array of dictionaries with mkpts0_f"
    methods = ("LoFTR",)
    suffix, mark = ".npy", b"mkpts0_f"
    lines = """
import numpy as np, pathlib
pathlib.Path("matches").mkdir()
for r in np.load("LoFTR_pred_eval.npy", allow_pickle=True):
    size0 = size1 = [640, 480]  # width and height of what the model was given
    np.savez(f"matches/{pathlib.Path(r['pair_names'][0]).stem}.npz", mkpts0_f=r["mkpts0_f"],
             mkpts1_f=r["mkpts1_f"], image_size0=size0, image_size1=size1)
airzoo-bench eval matching matches --protocol NAME
"""


class _HlocLogs(PickledMatches):
    title = "hloc's logs of a localisation"
    layout = "*_logs.pkl: a dictionary with the PnP of each query"
    methods = ("hloc",)
    suffix, mark = ".pkl", b"keypoints_query"
    lines = """
the poses stand in the text beside it, whose name lacks _logs.pkl:
airzoo-bench eval matching RESULTS.txt --protocol NAME
"""


VISMATCH, LOFTR_DUMP, HLOC_LOGS = _Vismatch(), _LoftrDump(), _HlocLogs()
