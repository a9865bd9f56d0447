"""What is checked: cameras and poses of a scene, from a benchmark folder or from a pose file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import cameras_of, poses_of, read_queries
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.places import data_root
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.folder_facts import check_scene_entry
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses

if TYPE_CHECKING:
    from airzoo_bench.benchmark.manifest import SceneFile
    from airzoo_bench.datasets.scene_facts import SceneFacts

__all__ = ["PosedScene", "open_benchmark", "scene_from_poses", "scenes_of_benchmark"]


@dataclass(frozen=True, eq=False)
class PosedScene:
    """The N photos of a scene, sorted by id.

    Attributes
    ----------
    name : str
    ids : tuple of str
    images : tuple of str
        File names, relative to `folder`.
    cameras : Cameras
    poses : Poses
        In `crs`.
    crs : str or None
        Projected CRS in metres; None where nobody has named it.
    folder : Path
        Of the photos.
    plane_height_m : float or None
        Of the ground, where the dataset says.
    benchmark : Benchmark or None
        That the scene is of.
    """

    name: str
    ids: tuple[str, ...]
    images: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    crs: str | None
    folder: Path
    plane_height_m: float | None = None
    benchmark: Benchmark | None = None

    def facts(self) -> SceneFacts | None:
        """Compare what the scene's folder holds; None for pose files, and without its maps.

        Raises
        ------
        UserError
            See `datasets.folder_facts.folder_facts`.
        """
        from airzoo_bench.datasets.folder_facts import folder_facts

        return None if self.benchmark is None else folder_facts(self.benchmark, self.name)


def open_benchmark(place: Path) -> Benchmark:
    """Open a benchmark folder, named by its path or by its name in the data root.

    Raises
    ------
    BenchmarkError
        See `Benchmark.open`.
    """
    named = data_root() / place
    return Benchmark.open(named if not place.exists() and named.is_dir() else place)


def scenes_of_benchmark(benchmark: Benchmark, only: str | None = None) -> list[PosedScene]:
    """Read the scenes of a benchmark, or one of them: all photos, queries of a track or not.

    Raises
    ------
    UsageError
        There is no scene `only`.
    BenchmarkError
        A photo lacks its camera or pose, or benchmark.toml does not say of the scene what the
        files do that it was prepared from.
    """
    scenes = [scene for scene in benchmark.file.scenes if only in (None, scene.id)]
    if not scenes:
        raise UsageError(
            f"there is no scene {only!r}",
            where=benchmark.folder,
            expected="one of " + ", ".join(scene.id for scene in benchmark.file.scenes),
        )
    return [_scene(benchmark, scene) for scene in scenes]


def scene_from_poses(
    poses: Path, images: Path, crs: str | None, progress: Progress = silent
) -> PosedScene:
    """Read a scene from a pose file and the folder of its photos, as `prepare photos` does.

    Parameters
    ----------
    poses : Path
        A JSON file (docs/benchmark-folder.md describes it), or the folder of a COLMAP model.
    images : Path
    crs : str or None
        CRS of the poses; None for what their file says.
    progress : Progress

    Raises
    ------
    UserError
        See `datasets.sources.photo_sizes` and `datasets.poses.read_poses`.
    """
    from airzoo_bench.datasets.poses import read_poses
    from airzoo_bench.datasets.sources import photo_sizes

    photos = read_poses(poses, photo_sizes(images, progress))
    return PosedScene(
        images.resolve().name,
        photos.names,
        photos.names,
        photos.cameras,
        photos.poses,
        crs or photos.crs,
        images,
    )


def _scene(benchmark: Benchmark, scene: SceneFile) -> PosedScene:
    import pandas as pd

    nothing_left_out = pd.DataFrame({"id": []})
    photos = read_queries(benchmark.scene_folder(scene.id), nothing_left_out)
    check_scene_entry(benchmark, scene, photos)
    return PosedScene(
        scene.id,
        tuple(photos["id"]),
        tuple(photos["image"]),
        cameras_of(photos),
        poses_of(photos),
        scene.crs,
        benchmark.resolve(scene.images),
        scene.plane_height_m,
        benchmark,
    )
