"""A COLMAP model as a dataset of `prepare`."""

from __future__ import annotations

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.surveys.options import ColmapOptions
from airzoo_bench.datasets.surveys.survey import WITHOUT_TRUTH, Survey, given

__all__ = ["COLMAP", "ColmapModels"]


class ColmapModels(Survey[ColmapOptions]):
    """Photos registered by COLMAP, in a projected CRS or brought there."""

    about = About(
        title="COLMAP model",
        page="https://colmap.github.io/format.html",
        licence="your own data",
        assumptions=(
            "Without --georeference and --from-exif the model is in the CRS of --crs, in metres.",
            "A similarity fits the model to positions; those farther than --inlier-m count not. "
            "What remains (root mean square) is the accuracy of the truth, unless --truth-accuracy "
            "says it.",
        ),
    )
    summary = (
        "Make a benchmark folder out of a COLMAP model.\n\n"
        "It is in --crs already, or is brought there by a similarity: one that is given, or one "
        "fitted to positions (--georeference), such as those of the photos (--from-exif)."
    )
    example = (
        "colmap --source sparse/0 --images photos --dom dom.tif --dsm dsm.tif --from-exif "
        "--name park"
    )
    options = ColmapOptions
    without_truth = WITHOUT_TRUTH
    needs = ("images", "dom")
    needs_ground = True

    def read(self, options: ColmapOptions, scene: str, progress: Progress) -> NativeScene:
        """Read the model, and place it."""
        from airzoo_bench.datasets.photos import FoundPhotos, posed_scene
        from airzoo_bench.datasets.poses import read_poses
        from airzoo_bench.datasets.sources import photo_sizes
        from airzoo_bench.datasets.surveys.georeference import georeferenced

        images = given(options.images, "images")
        sizes = photo_sizes(images, progress)
        placed = georeferenced(options, read_poses(options.source, sizes))
        found = FoundPhotos(
            images,
            sizes,
            placed.photos,
            options.source,
            options.dom,
            options.dsm,
            placed.notes,
            placed.accuracy_m,
        )
        return posed_scene(options, scene, found, progress)


COLMAP = ColmapModels()
