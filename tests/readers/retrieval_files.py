"""A made place, and logs of VPR-methods-evaluation and files of test.py written from it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

import airzoo_bench as ab
from tests.support import MadeScene, made_protocol, write_benchmark

PROTOCOL = "made-retrieval"
FOLDERS = "/data/made"
_DIMENSIONS = 24


def made_scenes() -> list[MadeScene]:
    """Return two scenes: every query q has the tiles q and q + 1 as positives."""
    return [
        MadeScene("east", [[q, q + 1] for q in range(6)], 12),
        MadeScene("west", [[q, q + 1] for q in range(4)], 8),
    ]


@dataclass(frozen=True)
class Place:
    """Scenes with float32 descriptors of unit length, in the order of the ids.

    `noise` 0 makes every query most like its positives.
    """

    scenes: list[MadeScene] = field(default_factory=made_scenes)
    noise: float = 0.0

    def descriptors(self, scene: MadeScene) -> tuple[Any, Any]:
        """Return those of queries and of tiles."""
        random = np.random.default_rng(len(scene.id) + scene.n_tiles)
        square = random.standard_normal((_DIMENSIONS, _DIMENSIONS))
        tiles = np.linalg.qr(square)[0][: scene.n_tiles]
        queries = np.stack([tiles[found].sum(axis=0) for found in scene.positives])
        queries = queries + self.noise * random.standard_normal(queries.shape)
        queries /= np.linalg.norm(queries, axis=1, keepdims=True)
        return queries.astype(np.float32), tiles.astype(np.float32)

    def every_descriptor(self) -> tuple[Any, Any]:
        pairs = [self.descriptors(scene) for scene in self.scenes]
        return np.concatenate([one for one, _ in pairs]), np.concatenate([one for _, one in pairs])

    def ranked(self, scene: MadeScene) -> tuple[Any, Any]:
        """Return tile numbers, best first, and their similarities, of each query."""
        queries, tiles = (one.astype(np.float64) for one in self.descriptors(scene))
        scores = -((queries[:, None] - tiles[None]) ** 2).sum(axis=2)
        order = np.argsort(-scores, axis=1)
        return order, np.take_along_axis(scores, order, axis=1)

    def canonical(self, path: Path) -> Path:
        """Write the suite's own file of the same descriptors."""
        queries, tiles = self.every_descriptor()
        np.savez(
            path,
            protocol=np.array(PROTOCOL),
            query_ids=np.array([one for scene in self.scenes for one in scene.query_ids]),
            gallery_ids=np.array([one for scene in self.scenes for one in scene.tile_ids]),
            query_descriptors=queries,
            gallery_descriptors=tiles,
        )
        return path

    def prepare(self, root: Path) -> Path:
        """Write the benchmark folder below a data root."""
        write_benchmark(root / "made", made_protocol(self.scenes), self.scenes)
        return root


def tile_file(folder: str, scene: MadeScene, number: int) -> str:
    """Return where `prepare --tiles files` would have written a tile."""
    return f"{folder}/scenes/{scene.id}/retrieval/tiles/t{number:05d}.png"


def photo_file(folder: str, scene: MadeScene, number: int) -> str:
    return f"{folder}/{scene.id}/photos/q{number:05d}.jpg"


def scored(path: Path, data: Path, **given: Any) -> ab.Result:
    return ab.evaluate(path, protocol=PROTOCOL, data=data, **given)


def perfect(result: Any) -> bool:
    return bool(result.overall["recall@1"] == 1.0 and result.overall["map"] == 1.0)


# --- VPR-methods-evaluation: main.py with --save_descriptors, as of April 2026 ---


def write_log(folder: Path, scene: MadeScene, home: str = FOLDERS, **changes: Any) -> None:
    """Write info.log, with the arguments as Python prints them."""
    counts = changes.pop("counts", (len(scene.positives), scene.n_tiles))
    arguments: dict[str, Any] = {
        "method": "salad",
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
    files = [tile_file(home, scene, number) for number in range(scene.n_tiles)]
    files += [photo_file(home, scene, number) for number in range(len(scene.positives))]
    for file in map(Path, files):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()


def write_descriptors(folder: Path, place: Place, scene: MadeScene) -> None:
    queries, tiles = place.descriptors(scene)
    np.save(folder / "queries_descriptors.npy", queries)
    np.save(folder / "database_descriptors.npy", tiles)


def write_lists(folder: Path, place: Place, scene: MadeScene, *, labels: bool = False) -> None:
    """Write preds/NNN.txt as `visualizations.save_file_with_paths` does."""
    (folder / "preds").mkdir(parents=True)
    change = labelled if labels else str
    for query, tiles in enumerate(place.ranked(scene)[0].tolist()):
        photo = change(photo_file(FOLDERS, scene, query))
        found = "\n".join(change(tile_file(FOLDERS, scene, one)) for one in tiles[:8])
        content = ["Query path:", photo + "\n", "Predictions paths:", found + "\n"]
        if labels:
            content += ["Positives paths:", change(tile_file(FOLDERS, scene, 0)) + "\n"]
        (folder / "preds" / f"{query:03d}.txt").write_text("\n".join(content))


def labelled(path: str) -> str:
    """Put a position before the name of an image, falling from image to image."""
    place = Path(path)
    east = 600_000 - int(place.stem[1:])
    return str(place.with_name(f"@{east}.00@3100000.00@{place.stem}@{place.suffix}"))


def write_vpr(folder: Path, place: Place) -> Path:
    """Write a log folder for each scene."""
    for scene in place.scenes:
        log = folder / "logs" / scene.id / "2026-11-22_19-00-00"
        write_log(log, scene)
        write_descriptors(log, place, scene)
    return folder / "logs"


def save_mat(path: Path, queries: tuple[Any, list[str]], gallery: tuple[Any, list[str]]) -> Path:
    """Write the dictionary that test.py of University-1652 makes."""
    result: dict[str, Any] = {}
    for kind, (rows, paths) in (("gallery", gallery), ("query", queries)):
        result[f"{kind}_f"] = rows
        result[f"{kind}_label"] = [int(Path(one).parent.name) for one in paths]
        result[f"{kind}_path"] = paths
    scipy.io.savemat(path, result)
    return path
