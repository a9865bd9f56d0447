"""Pickles as vismatch, LoFTR and hloc write them."""

from __future__ import annotations

import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from tests.matching.world import World
from tests.readers.samples.matchers import pairs

READER = "vismatch"


def write(folder: Path, world: World) -> Path:
    """Write vismatch's `.torch`, as far as it can be without torch: a zip with a pickle."""
    home = folder / "outputs" / "sift-lightglue"
    home.mkdir(parents=True)
    for number, (stem, first, second) in enumerate(shrunk(world, (512, 512))):
        result = {
            "num_inliers": 7,
            "H": None,
            "matched_kpts0": first,
            "matched_kpts1": second,
            "img0_path": Path(f"photos/{stem}.png"),
            "img1_path": Path(f"crops/{stem}_dom.tif"),
            "matcher": ["sift-lightglue"],
        }
        with zipfile.ZipFile(home / f"output_{number}_result.torch", "w") as archive:
            archive.writestr("archive/data.pkl", pickle.dumps(result))
    return home


def load(path: str, **options: Any) -> Any:
    """Stand in for `torch.load`."""
    assert options == {"weights_only": False}
    with zipfile.ZipFile(path) as archive:
        return pickle.loads(archive.read("archive/data.pkl"))  # noqa: S301 - written above


def write_loftr_dump(folder: Path, world: World) -> Path:
    dumps = [
        {
            "pair_names": (f"photos/{stem}.png", f"crops/{stem}_dom.tif"),
            "identifier": f"{stem}#{stem}_dom",
            "mkpts0_f": first,
            "mkpts1_f": second,
            "mconf": np.ones(len(first)),
        }
        for stem, first, second in shrunk(world, (640, 480))
    ]
    path = folder / "LoFTR_pred_eval.npy"
    np.save(path, dumps)  # type: ignore[arg-type]
    return path


def write_hloc_logs(folder: Path, world: World) -> Path:
    path = folder / "results.txt_logs.pkl"
    log = {"db": [1], "PnP_ret": None, "keypoints_query": np.zeros((3, 2))}
    path.write_bytes(pickle.dumps({"loc": dict.fromkeys(world.ids, log)}))
    return path


def shrunk(world: World, size: tuple[int, int]) -> list[tuple[str, Any, Any]]:
    found = []
    for pair in pairs(world):
        sides = zip((pair.query_xy, pair.map_xy), pair.sizes, strict=True)
        found.append((pair.stem, *(xy * np.divide(size, one) - 0.5 for xy, one in sides)))
    return found
