"""Pickles of matchers: recognised, never loaded, and answered with the lines that mend them."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import first_bytes
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions

_HEAD_BYTES = 1 << 16
_MOST_FILES = 1000


class PickledMatches(Reader):
    """Files of one kind that only running them would read.

    `suffix` is that of the files, or of those in a folder; `mark` stands near the beginning of the
    pickle; `lines` are what the user runs where the files were written, and trusts them.
    """

    track = "matching"

    def __init__(
        self, title: str, layout: str, methods: tuple[str, ...], suffix: str, mark: str, lines: str
    ) -> None:
        self.title, self.layout, self.methods = title, layout, methods  # type: ignore[misc]
        self.suffix, self.mark, self.lines = suffix, mark.encode(), lines

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        found = islice(path.iterdir(), _MOST_FILES) if path.is_dir() else [path]
        first = next((one for one in found if one.suffix == self.suffix and one.is_file()), None)
        # The zip of torch.save begins with its pickle, not compressed.
        return 0.9 * (first is not None and self.mark in first_bytes(first, _HEAD_BYTES))

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`; it refuses."""
        lines = "\n            ".join(self.lines.strip().splitlines())
        what = f"is {self.title}: a Python pickle, which would run whatever it says, never loaded"
        fix = f"where you made these files and trust them:\n            {lines}"
        raise PredictionError(what, where=path, expected="arrays that numpy.savez wrote", fix=fix)


VISMATCH = PickledMatches(
    "results of vismatch",
    "*.torch: what torch.save made of a dictionary with matched_kpts0",
    ("vismatch", "image-matching-models"),
    ".torch",
    "matched_kpts0",
    """
import glob, numpy as np, pathlib, torch
pathlib.Path("matches").mkdir()
for f in glob.glob("outputs/*/*.torch"):
    r = torch.load(f, weights_only=False)
    size = [512, 512]  # --im-size: both pictures are stretched to this square
    np.savez(f"matches/{pathlib.Path(r['img0_path']).stem}.npz", mkpts0_f=r["matched_kpts0"],
             mkpts1_f=r["matched_kpts1"], image_size0=size, image_size1=size)
airzoo-bench eval matching matches --protocol NAME
""",
)
LOFTR_DUMP = PickledMatches(
    "LoFTR's dump of an evaluation",
    "LoFTR_pred_eval.npy: an array of dictionaries with mkpts0_f",
    ("LoFTR",),
    ".npy",
    "mkpts0_f",
    """
import numpy as np, pathlib
pathlib.Path("matches").mkdir()
for r in np.load("LoFTR_pred_eval.npy", allow_pickle=True):
    size0 = size1 = [640, 480]  # width and height of what the model was given
    np.savez(f"matches/{pathlib.Path(r['pair_names'][0]).stem}.npz", mkpts0_f=r["mkpts0_f"],
             mkpts1_f=r["mkpts1_f"], image_size0=size0, image_size1=size1)
airzoo-bench eval matching matches --protocol NAME
""",
)
HLOC_LOGS = PickledMatches(
    "hloc's logs of a localisation",
    "*_logs.pkl: a dictionary with the PnP of each query",
    ("hloc",),
    ".pkl",
    "keypoints_query",
    """
the poses stand in the text beside it, whose name lacks _logs.pkl:
airzoo-bench eval matching RESULTS.txt --protocol NAME
""",
)
