"""Own photos, their poses, a map and a surface model as a dataset of `prepare`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.content import photo_sizes
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.scenes import NativeScene
from airzoo_bench.datasets.surveys.survey import SceneOptions, Survey, posed_scene


@dataclass(frozen=True)
class PhotoOptions(SceneOptions):
    """Where the parts of a scene lie."""

    name: str
    images: Path
    poses: Path
    dom: Path


class Photos(Survey[PhotoOptions]):
    """A scene of own photos."""

    about = about_of("photos")
    options = PhotoOptions
    needs_ground = True

    def read(self, options: PhotoOptions, scene: str, progress: Progress) -> NativeScene:
        """Read the poses of own photos, and what the photos' metadata say."""
        images, poses = options.images, options.poses
        sizes = photo_sizes(images, progress)
        photos, crs_from = read_poses(poses, sizes), f"{poses}, key 'crs'"
        if options.crs is None and photos.crs is None:
            raise UsageError(
                "the CRS of the poses is not known",
                where=poses,
                expected="a projected CRS in metres",
                fix="add the key 'crs' to the file, or give --crs EPSG:...",
            )
        parts = (scene, images, sizes, photos, poses, progress)
        return posed_scene(options, *parts, crs_from=crs_from)


PHOTOS = Photos()
