"""A COLMAP model as a dataset: in a projected CRS, or brought there by a similarity."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import BenchmarkError, UsageError, counted, readable
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.content import photo_sizes
from airzoo_bench.datasets.metadata import read_prior
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos
from airzoo_bench.datasets.settings import ColmapOptions
from airzoo_bench.datasets.surveys.survey import Survey, map_crs, posed_scene, stated_crs
from airzoo_bench.datasets.tables import read_native_text
from airzoo_bench.geometry.crs import from_lonlat
from airzoo_bench.geometry.poses import check_rotations
from airzoo_bench.reconstruction import alignment
from airzoo_bench.reconstruction.alignment import PosedCameras, Similarity

_INLIER_M, _LEAST_AGREEING = 5.0, 0.5
_LEAST_POSITIONS = 4  # three are always met
_TOLERANCE = 1e-4


class _ColmapModels(Survey[ColmapOptions]):
    """Photos registered by COLMAP."""

    about = load_about("colmap")
    options = ColmapOptions
    needs = ("images", "dom")
    needs_ground = True

    def read(self, options: ColmapOptions, scene: str, progress: Progress) -> NativeScene:
        images, source = options.images or Path(), options.source
        sizes = photo_sizes(images, progress)
        photos, notes, left = _placed(options, images, read_poses(source, sizes))
        parts = (scene, images, sizes, photos, source, progress)
        return posed_scene(options, *parts, notes=notes, truth_accuracy_m=left)


def _placed(
    options: ColmapOptions, images: Path, photos: PosedPhotos
) -> tuple[PosedPhotos, tuple[str, ...], float | None]:
    """Bring the photos to a projected CRS; return notes too, and what remains of the fit."""
    stated, file = stated_crs(options), options.georeference
    if (file is not None and options.from_exif) or not (file or options.from_exif or stated):
        raise UsageError(
            "where the model is, is not known, or said twice",
            where=options.source,
            fix="give --from-exif, or --georeference FILE, or --crs alone if the model is in it",
        )
    crs = stated or map_crs(options.dsm, options.dom)
    photos = photos._replace(crs=crs.to_string())
    transform, notes, left = None, tuple[str, ...](), None
    if file is not None:
        transform = read_similarity(file)
    elif options.from_exif:
        transform, notes, left = _fitted(photos, images, crs)
    if transform is not None:
        photos = photos._replace(poses=transform.apply_poses(photos.poses))
    return photos, notes, left


def read_similarity(path: Path) -> Similarity:
    """Read a turn, a scale and a shift: four lines of four numbers, the last 0 0 0 1."""
    expected, fix = "four lines of four numbers, the last of them 0 0 0 1", "register without shear"
    lines = (line.split("#")[0] for line in read_native_text(path).splitlines())
    rows = [line.replace(",", " ").split() for line in lines if line.strip()]
    with readable(path, "holds no similarity", kind=BenchmarkError, expected=expected, fix=fix):
        matrix = np.array(rows, dtype=np.float64).reshape(4, 4)
        linear = matrix[:3, :3]
        squared = np.trace(linear @ linear.T) / 3.0
        sheared = np.abs(linear @ linear.T - squared * np.eye(3)).max() > _TOLERANCE * squared
        scale = float(np.cbrt(np.linalg.det(linear)))
        if sheared or not scale > 0.0 or not np.array_equal(matrix[3], (0.0, 0.0, 0.0, 1.0)):
            raise ValueError("it shears, mirrors or flattens, or its last line is another")
    turn = check_rotations([linear / scale], ["the matrix"], where=path)[0]
    return Similarity(scale, turn, matrix[:3, 3])


def _fitted(
    photos: PosedPhotos, images: Path, crs: CRS
) -> tuple[Similarity, tuple[str, ...], float | None]:
    """Fit the model to EXIF positions; return notes too, and what remains (root mean square)."""
    found = {name: read_prior(images / name) for name in photos.names}
    whole = {n: p for n, p in found.items() if p.lon is not None and p.altitude_m is not None}
    rows = [(p.lon, p.lat, p.altitude_m) for p in whole.values()]
    places = np.array(rows, dtype=np.float64).reshape(-1, 3)
    places[:, :2] = from_lonlat(crs, places[:, :2])
    model = PosedCameras(photos.names, photos.poses.centres, photos.poses.rotation)
    truth = PosedCameras(tuple(whole), places)
    fault = BenchmarkError(
        f"{counted(len(places), 'position')} do not place the model to {_INLIER_M:g} m",
        where=images,
        expected=f"at least {_LEAST_POSITIONS} that span an area, half of which agree",
        fix="look at the positions, or give a 4 x 4 matrix (--georeference)",
    )
    if len(places) < _LEAST_POSITIONS:
        raise fault
    try:
        fit = alignment.align(model, truth, alignment.shipped_alignment(inlier_below_m=_INLIER_M))
    except alignment.AlignmentError as error:
        raise fault from error
    left = fit.inlier_centres
    if left is None or not fit.robust or fit.inliers < _LEAST_AGREEING * fit.cameras:
        raise fault
    note = (
        f"a similarity of scale {fit.transform.scale:.6g} places the model by {fit.inliers} "
        f"of {counted(fit.cameras, 'position')}: {left['rms']:.3f} m remain (root mean square), "
        f"{left['largest']:.3f} m at most; no truth is better than these positions"
    )
    return fit.transform, (note,), round(left["rms"], 4) or None


COLMAP = _ColmapModels()
