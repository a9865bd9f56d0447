"""VPR-methods-evaluation: `main.py` with `--save_descriptors`, as of April 2026."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.readers.retrieval_support import Place, photo_file, tile_file
from tests.support import MadeScene

FOLDERS = "/data/made"


def write_log(folder: Path, scene: MadeScene, home: str = FOLDERS, **changes: Any) -> None:
    """Write info.log, with the arguments as Python prints them."""
    counts = changes.pop("counts", (len(scene.positives), scene.n_tiles))
    arguments: dict[str, Any] = {
        "positive_dist_threshold": 25,
        "method": "salad",
        "backbone": "DINOv2",
        "descriptors_dimension": 8448,
        "database_folder": str(Path(tile_file(home, scene, 0)).parent),
        "queries_folder": str(Path(photo_file(home, scene, 0)).parent),
        "save_only_wrong_preds": False,
        "use_labels": False,
    } | changes
    said = ", ".join(f"{key}={value!r}" for key, value in arguments.items())
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "info.log").write_text(
        "2026-11-22 19:00:00 main.py --method salad --save_descriptors\n"
        f"2026-11-22 19:00:00 Arguments: Namespace({said})\n"
        f"2026-11-22 19:00:01 Testing on < #queries: {counts[0]}; #database: {counts[1]} >\n"
    )


def write_images(home: str, scene: MadeScene) -> None:
    """Write the folders that the log names, with empty files for images."""
    for number in range(scene.n_tiles):
        one = Path(tile_file(home, scene, number))
        one.parent.mkdir(parents=True, exist_ok=True)
        one.touch()
    for number in range(len(scene.positives)):
        one = Path(photo_file(home, scene, number))
        one.parent.mkdir(parents=True, exist_ok=True)
        one.touch()


def write_descriptors(folder: Path, place: Place, scene: MadeScene) -> None:
    queries, tiles = place.descriptors(scene)
    np.save(folder / "queries_descriptors.npy", queries)
    np.save(folder / "database_descriptors.npy", tiles)


def write_lists(
    folder: Path, place: Place, scene: MadeScene, home: str = FOLDERS, *, labels: bool = False
) -> None:
    """Write preds/NNN.txt as `visualizations.save_file_with_paths` does."""
    (folder / "preds").mkdir(parents=True)
    order, _ = place.ranked(scene)
    change = labelled if labels else str
    for query, tiles in enumerate(order.tolist()):
        photo = change(photo_file(home, scene, query))
        content = ["Query path:", photo + "\n", "Predictions paths:"]
        content.append("\n".join(change(tile_file(home, scene, one)) for one in tiles[:8]) + "\n")
        if labels:
            content += ["Positives paths:", change(tile_file(home, scene, 0)) + "\n"]
        (folder / "preds" / f"{query:03d}.txt").write_text("\n".join(content))


def labelled(path: str) -> str:
    """Put a position before the name of an image, falling from image to image."""
    place = Path(path)
    east = 600_000 - int(place.stem[1:])
    return str(place.with_name(f"@{east}.00@3100000.00@{place.stem}@{place.suffix}"))


def write(folder: Path, place: Place) -> Path:
    """Write a log folder for each scene."""
    for scene in place.scenes:
        log = folder / "logs" / scene.id / "2026-11-22_19-00-00"
        write_log(log, scene)
        write_descriptors(log, place, scene)
    return folder / "logs"
