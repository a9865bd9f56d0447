"""A table of poses as a dataset of `prepare`."""

from __future__ import annotations

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.surveys.options import PoseTableOptions
from airzoo_bench.datasets.surveys.survey import WITHOUT_TRUTH, Survey, given

__all__ = ["POSES", "PoseTables"]


class PoseTables(Survey[PoseTableOptions]):
    """Photos whose poses stand in a table."""

    about = About(
        title="Table of poses",
        page="docs/benchmarks.md",
        licence="your own data",
        assumptions=(
            "Yaw is relative to true north, kappa to the grid's (--north).",
            "Tables with the column Label (Metashape) or imagename (Pix4D) have yaw, pitch, roll "
            "of a camera that looks straight down at 0, 0, 0 (--angles).",
            "Without cx, cy the principal point is the middle of the photo; without k1 ... there "
            "is no lens distortion.",
            "Heights are those of the surface model.",
        ),
        unverified=("Whether Metashape's angles are relative to true north in every version.",),
    )
    summary = (
        "Make a benchmark folder out of photos and a table of their poses.\n\n"
        "Columns go by their names, as Metashape, Pix4D and DJI Terra write them: image, latitude, "
        "longitude (or easting, northing and --crs), height, and yaw, pitch, roll or omega, phi, "
        "kappa."
    )
    example = (
        "poses --source poses.csv --images photos --dom dom.tif --dsm dsm.tif --camera camera.json "
        "--angles gimbal"
    )
    options = PoseTableOptions
    without_truth = WITHOUT_TRUTH
    needs = ("images", "dom")
    needs_ground = True

    def read(self, options: PoseTableOptions, scene: str, progress: Progress) -> NativeScene:
        """Read the table, and what the photos' metadata say."""
        from airzoo_bench.datasets.photos import FoundPhotos, posed_scene
        from airzoo_bench.datasets.sources import photo_sizes
        from airzoo_bench.datasets.surveys.crs import map_crs, stated_crs
        from airzoo_bench.datasets.surveys.table_angles import AngleSettings
        from airzoo_bench.datasets.surveys.table_poses import read_table_poses

        images = given(options.images, "images")
        sizes = photo_sizes(images, progress)
        stated = stated_crs(options)
        angles = AngleSettings(options.angles, options.angle_unit, options.north)
        crs = map_crs(options) if stated is None else stated
        read = read_table_poses(options.source, images, sizes, crs, stated, angles, options.camera)
        found = FoundPhotos(
            images,
            sizes,
            read.photos,
            options.source,
            options.dom,
            options.dsm,
            read.notes,
        )
        return posed_scene(options, scene, found, progress)


POSES = PoseTables()
