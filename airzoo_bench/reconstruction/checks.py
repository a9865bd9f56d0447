"""Checks for mistakes that users make and cannot see, a function each.

A check raises an error where the prediction cannot be meant as it is, or returns a note, a
sentence for whoever reads the numbers, where it may be. `scene_notes` collects those of a scene.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.validation import nearest
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from airzoo_bench.geometry.precision import rounding_errors
from airzoo_bench.reconstruction.alignment import (
    LEAST_CAMERAS,
    Alignment,
    AlignmentError,
    PosedCameras,
    Similarity,
    fit_sim3,
    pair_cameras,
)
from airzoo_bench.reconstruction.fusion import DepthMaps, PointMaps
from airzoo_bench.reconstruction.metrics import angle_deg, relative_poses

if TYPE_CHECKING:
    from airzoo_bench.reconstruction.clouds import PreparedCloud
    from airzoo_bench.reconstruction.predictions import ImagePoses, ScenePrediction
    from airzoo_bench.reconstruction.settings import ReconstructionProtocol
    from airzoo_bench.reconstruction.track import CloudComparison
    from airzoo_bench.reconstruction.truth import ReconstructionTruth


_MOST_CAMERAS = 64
_SURE_CAMERAS, _LINE_SHARE = 5, 0.05  # fewer, or cameras on a line, are noted, not refused
_ORDER_FITS_DEG = 15.0
_OPENGL = np.diag((1.0, -1.0, -1.0))
_FACTOR = 80.0  # a little below a hundred, so that outliers do not hide centimetres
_FOOT_M = 0.3048
_UNDULATIONS_M = 5.0, 110.0  # between the ellipsoid and the sea; below 5 m it may be an error
_LOOKED_AT, _TRIED = 1 << 22, 2000
_LARGEST = 1e30
_PHOTOS = (
    "give the photos of scenes/SCENE/reconstruction/photos.csv, and no others, named as there; a "
    "reader takes them in order from a list, a line each: --reader NAME --names LIST"
)


def scene_notes(
    prediction: ScenePrediction, comparison: CloudComparison, protocol: ReconstructionProtocol
) -> list[str]:
    """Collect the notes on a prediction: oddities, points left out, the alignment."""
    geometry, images, scores = prediction.geometry, prediction.images, protocol.scores
    (cloud, true), transform = comparison.clouds, comparison.alignment.transform
    finest, notes = scores.finest_m / 20.0, [*prediction.notes]
    if not isinstance(geometry, FileCloud) and images is not None and not images.has_names:
        notes.append("has no image_names: its views are the photos in the order of their names")
    if isinstance(geometry, DepthMaps):
        most_m = protocol.fusion.max_depth_m
        notes += depth_notes(prediction, geometry, transform.scale, most_m, finest)
    least = min(finest, 0.01)
    if images is not None and images.posed.any():
        error = float(np.median(images.errors[images.posed])) * transform.scale
        notes += digits_notes("extrinsics (C = -R^T t, and t is long)", error, least)
    notes += digits_notes("coordinates", rounding_error(geometry) * transform.scale, least)
    notes += alignment_notes(comparison.alignment, protocol.alignment.method)
    samples = cloud.sample, true.sample
    if all(map(len, samples)):
        bounds = [np.percentile(one, (1.0, 99.0), axis=0) for one in samples]
        odd = check_bounds(*bounds) or check_mirror(*samples, transform, scores.f1_below_m)
        odd = odd or check_datum(*bounds)
        notes += [odd] if odd else []
    return [*notes, *left_out_notes(cloud)]


# --- names ---


def match_cameras(
    images: ImagePoses | None, truth: ReconstructionTruth, where: str
) -> tuple[PosedCameras | None, list[str]]:
    """Name the cameras of a prediction as the truth does, NaN without a pose; return notes too."""
    if images is None:
        return None, []
    name_images = true_names if images.has_names else _ordered_names
    names = name_images(images, truth, where)
    rotation = np.where(images.posed[:, None, None], images.poses.rotation, np.nan)
    centres = np.where(images.posed[:, None], images.poses.centres, np.nan)
    cameras = PosedCameras(tuple(names), centres, rotation)
    rows, true_rows = pair_cameras(cameras, truth.posed)
    note = check_inversion(images.poses.take(rows), truth.poses.take(true_rows), where)
    check_names(cameras, truth.posed, where)
    return cameras, [note] if note else []


def _ordered_names(images: ImagePoses, truth: ReconstructionTruth, where: str) -> list[str]:
    """Take views without names for the photos in the order of their names, where cameras agree."""
    photos, views = sorted(truth.photos["image"]), len(images.names)
    rows, why = np.flatnonzero(images.posed), ""
    if views != len(photos):
        why = f"{counted(views, 'view')} for {counted(len(photos), 'photo')} of the scene"
    elif len(rows) < LEAST_CAMERAS:
        raise AlignmentError("has no image_names, and too few poses to tell which view is which")
    else:
        order = np.argsort(truth.photos["image"].to_numpy(str))
        given = images.poses.take(rows), truth.poses.take(order[rows])
        off = relative_misfit_deg(*given)
        if off > _ORDER_FITS_DEG:
            why = f"cameras do not fit the photos in the order of their names, by {off:.0f} degrees"
            why = check_inversion(*given, where) or why
    if why:
        raise PredictionError(f"has no image_names, and {why}", where=where, fix=_PHOTOS)
    return photos


def true_names(images: ImagePoses, truth: ReconstructionTruth, where: str) -> list[str]:
    """Return the truth's names of images; an ending may be left out."""
    names, photos = images.names.tolist(), truth.photos["image"].tolist()
    stems = [PurePosixPath(name).with_suffix("").as_posix() for name in photos]
    times = Counter(stems)
    known = {stem: name for stem, name in zip(stems, photos, strict=True) if times[stem] == 1}
    known |= {name: name for name in photos}
    odd = [name for name in names if name not in known]
    if odd:
        # A mistyped name means no image that is there already.
        missing = sorted(set(photos) - {known[name] for name in names if name in known})
        shown = [repr(name[:80]) + nearest(name, missing, 1) for name in odd[:3]]
        raise PredictionError(
            f"image names of no photo of the scene: {first_of([*shown, *odd[3:]], len(names))}",
            where=f"{where}, field 'image_names'",
            expected=f"names such as {photos[0]!r}, with or without their ending",
            fix=_PHOTOS,
        )
    return [known[name] for name in names]


def check_names(given: PosedCameras, truth: PosedCameras, where: str) -> None:
    """Refuse names of photos that are one off: other photos leave a tenth of the misfit."""
    true = truth.centres[np.argsort(truth.names)]
    at = np.searchsorted(sorted(truth.names), given.names) if given.names else np.zeros(0, int)
    spacing = float(np.median(np.linalg.norm(np.diff(true, axis=0), axis=1)))
    for aligned in (False, True):
        here, *others = (_misfit_m(given.centres, true, at + step, aligned) for step in (0, 1, -1))
        if 0.2 * spacing < here < np.inf and min(others) < 0.1 * here:
            which = "next" if others[0] < others[1] else "previous"
            raise PredictionError(
                f"names of photos look one off: centres are {here:.3g} m from the photos they are "
                f"named for, and {min(others):.3g} m from the {which} ones in the order of names",
                where=where,
            )


def _misfit_m(centres: Floats, true: Floats, rows: Ints, aligned: bool) -> float:
    """Return the median distance of centres (N, 3) to rows of the truth, infinite for too few."""
    there = (rows >= 0) & (rows < len(true)) & np.isfinite(centres).all(axis=1)
    source, target = centres[there], true[rows[there]]
    if len(source) < _SURE_CAMERAS:
        return float("inf")
    if aligned:
        source = fit_sim3(source[None], target[None])[0][0].apply(source)
    return float(np.median(np.linalg.norm(source - target, axis=1)))


# --- cameras ---


def relative_misfit_deg(given: Poses, truth: Poses) -> float:
    """Return the median error of the relative poses of at most 64 cameras, in degrees."""
    rows = np.unique(np.linspace(0, len(truth) - 1, _MOST_CAMERAS).astype(int))
    pairs = np.triu_indices(len(rows), 1)
    turn, sight = relative_poses(given.take(rows), *pairs)
    true_turn, true_sight = relative_poses(truth.take(rows), *pairs)
    turned, off = rotation_angle_deg(turn, true_turn), angle_deg(sight, true_sight)
    return float(np.median(np.maximum(turned, off)))


def check_inversion(given: Poses, truth: Poses, where: str) -> str | None:
    """Look for camera-to-world poses, in OpenCV's or OpenGL's axes, read as world-to-camera.

    Names in reverse order look the same along a line: there it is a note.
    """
    if len(given) < LEAST_CAMERAS:
        return None
    inverse = Poses(rotation=np.swapaxes(given.rotation, 1, 2), centres=given.translation)
    opengl = Poses(rotation=_OPENGL @ inverse.rotation, centres=inverse.centres)
    as_given = relative_misfit_deg(given, truth)
    inverted, axes = min(
        (relative_misfit_deg(inverse, truth), ""),
        (relative_misfit_deg(opengl, truth), ", both with diag(1, -1, -1) from the left"),
    )
    said = (
        "the extrinsics look inverted (camera-to-world for world-to-camera): between two cameras "
        f"they are {as_given:.1f} degrees off the truth, {inverted:.1f} once inverted"
    )
    spread = np.linalg.svd(truth.centres - truth.centres.mean(axis=0), compute_uv=False)
    is_sure = as_given > 20.0 and inverted < min(20.0, as_given / 3)
    if is_sure and len(given) >= _SURE_CAMERAS and spread[1] > _LINE_SHARE * spread[0]:
        raise PredictionError(said, where=where, fix=f"invert them: R.T and -R.T @ t{axes}")
    return said + axes if as_given > 5.0 and inverted < 0.5 * as_given else None


def alignment_notes(alignment: Alignment, method: str) -> list[str]:
    """Say how cameras were aligned where it is not the usual way, and how many agree."""
    agree, aligned = 2 * alignment.inliers >= alignment.cameras, alignment.method != "none"
    lost, cameras = alignment.cameras_missing, counted(alignment.cameras, "camera")
    photos = counted(alignment.cameras + lost, "photo")
    turned = (alignment.rotations_deg or {}).get("median", 0.0)
    notes = {
        f"holds no cameras: taken as it is, without alignment by {method}": alignment.centres
        is None
        and not lost
        and method != "none",
        "camera centres lie on a line: aligned by the cameras' orientations too": (
            alignment.used_orientations
        ),
        f"cameras are turned by {turned:.0f} degrees (median), though their centres fit: are the "
        "extrinsics in OpenGL axes (y up, z back), or the image names of a strip in reverse "
        "order?": turned > 150.0 and agree,
        "fewer than 3 cameras agree: aligned to all of them": not alignment.robust,
        f"only {alignment.inliers} of {cameras} within {alignment.inlier_limit_m or 0:.3g} m: the "
        "alignment may be that of a part": alignment.robust and aligned and not agree,
        f"{alignment.icp_failure}: aligned by cameras only": alignment.icp_failure is not None,
        f"{lost} of {photos} without a pose in the prediction": aligned and lost > 0,
    }
    return [note for note, holds in notes.items() if holds]


# --- views ---


def check_resolution(cameras: Cameras, names: Sequence[str] | None, where: str) -> None:
    """Refuse intrinsics of images of another size than the maps, which the cameras have.

    A factor is clear from 1.5 on, or from 1.1 on in all cameras: photos of 640 px and maps of 504.
    Maps whose rows and columns are exchanged have the other side's centre on each axis.
    """
    size = np.stack((cameras.width, cameras.height), axis=-1)
    off, apart = cameras.principal_point / size[:, ::-1] - 0.5, np.ptp(np.log(size), axis=1)
    if len(size) and np.abs(off).max() < 0.02 and apart.min() > 0.2:
        what = "principal points are the centres of maps with height and width exchanged"
        raise PredictionError(what, where=where, fix="write maps as (views, height, width)")
    ratio = cameras.principal_point / (size / 2.0)
    logs = np.log(np.where(ratio > 0.0, ratio, 1.0))
    apart, factor = np.abs(logs[:, 0] - logs[:, 1]), np.abs(logs).min(axis=1)
    shift = np.abs(cameras.principal_point - size / 2.0).min(axis=1)
    slight = (apart <= 0.03) & (factor > np.log(1.1)) & (shift > 1.0)
    other = (apart <= 0.1) & (factor > np.log(1.5)) | slight.all()
    normalised = (np.abs(cameras.principal_point) <= 1.0).all(axis=1) & (size > 4).all(axis=1)
    rows = np.flatnonzero(other | normalised)
    if not len(rows):
        return
    labels = names or [f"camera {row}" for row in range(len(cameras))]
    typical = float(np.median(ratio[rows].mean(axis=1)))
    likely = "of images of about {} x {}".format(*np.rint(typical * size[0]).astype(int))
    raise PredictionError(
        f"the principal point is {typical:.3g} times the centre of the maps in "
        f"{first_of([labels[row] for row in rows.tolist()], len(cameras))}: the intrinsics look "
        f"{'normalised to 0..1' if normalised.any() else likely}",
        where=where,
        expected=f"intrinsics of the maps' own size, {size[0, 0]} x {size[0, 1]}",
    )


def depth_notes(
    prediction: ScenePrediction, maps: DepthMaps, scale: float, most_m: float, tolerance_m: float
) -> list[str]:
    """Look for millimetres; ask for the field `pixel_centres` where its absence moves points."""
    views = range(min(len(maps.values), max(1, _LOOKED_AT // max(maps.values[0].size, 1))))
    some = np.stack([maps.values[row] for row in views])
    seen = some[np.isfinite(some) & (some > 0)]
    depth, notes = float(np.median(seen)) * scale if seen.size else 0.0, []
    if depth > most_m:
        notes.append(f"depths are {depth:g} m as aligned (median): are they in millimetres?")
    error = float(np.hypot(*(0.5 / np.median(maps.cameras.focal, axis=0)))) * depth
    images = prediction.images
    if prediction.pixel_centres is None and images is not None and error > tolerance_m:
        notes.append(
            f"pixel centres of K are taken as {'half' if images.has_names else 'integer'}: if that "
            f"is wrong, points are {error:.2g} m off; add pixel_centres = 'integer' (as networks "
            "have them) or 'half'"
        )
    return notes


# --- the cloud ---


def digits_notes(what: str, error_m: float, tolerance_m: float) -> list[str]:
    """Say where numbers were rounded, to single precision or to few digits."""
    if not tolerance_m < error_m < np.inf:
        return []
    fix = "store float64, or subtract an origin first"
    return [f"{what} lost digits: an error of {error_m:.2g} m is to be expected; {fix}"]


def rounding_error(geometry: FileCloud | DepthMaps | PointMaps) -> float:
    """Return by how much the rounding of stored coordinates moves points; 0 for depth maps."""
    points = np.zeros((0, 3))
    if isinstance(geometry, FileCloud):
        points = next((piece.points for piece in geometry.pieces(_TRIED)), points)
    elif isinstance(geometry, PointMaps):
        every = geometry.values[0].reshape(-1, 3)
        points = np.asarray(every[:: max(1, len(every) // _TRIED)], np.float64)
    points = points[np.abs(points).max(axis=1, initial=0.0) < _LARGEST]
    return float(np.sqrt(3.0 * np.append(rounding_errors(points) ** 2, 0.0).mean()))


def left_out_notes(cloud: PreparedCloud) -> list[str]:
    """Say how many points were left out of a cloud, and where none is left."""
    left = cloud.source.count
    share = cloud.outside / max(left + cloud.thinned + cloud.outside, 1)
    lost, odd = counted(cloud.distrusted, "point"), counted(cloud.not_finite, "point")
    empty = not left + cloud.outside + cloud.not_finite + cloud.distrusted
    notes = {
        f"left out: {lost} of too little confidence": cloud.distrusted > 0,
        f"left out: {odd}, NaN, infinite or too large": cloud.not_finite > 0,
        f"{share:.0%} of the prediction lies outside the scored region, uncounted": share >= 0.005,
        "the prediction holds no point, or no depth within the protocol's range": empty,
        "no point is left to compare: it scores 0 and infinite distances": not left,
    }
    return [note for note, holds in notes.items() if holds]


def check_bounds(cloud: Floats, truth: Floats) -> str | None:
    """Guess from bounds (2, 3) in which other coordinates a cloud may be."""
    span, true_span = np.ptp(cloud, axis=0), np.ptp(truth, axis=0)
    size, true_size = (max(float(np.linalg.norm(one)), 1e-300) for one in (span, true_span))
    flat, ratio, overlap = span[:2].max(), size / true_size, _overlap(cloud, truth)
    away = float(np.linalg.norm(cloud.mean(axis=0) - truth.mean(axis=0)))
    in_degrees = 0.0 < flat < 5.0 and (np.abs(cloud[:, :2]) <= 180.0).all()
    upright = 0.1 * true_span[2] < span[2] < 10.0 * true_span[2]
    spans = "it spans {}, the truth {}".format(
        *(" x ".join(f"{side:.4g}" for side in one) for one in (span, true_span))
    )
    if in_degrees and flat * _FACTOR < true_span[:2].max() and upright:
        return f"the cloud looks like longitude and latitude in degrees: {spans}"
    if not overlap and (np.abs(cloud[:, :2] * _FOOT_M - truth[:, :2]) < true_span[:2]).all():
        return "the cloud looks like feet: in metres it would lie on the truth"
    if not 1 / _FACTOR < ratio < _FACTOR and min(span.max(), true_span.max()) > 0.0:
        unit = "millimetres" if 500.0 < ratio < 2000.0 else "another unit"
        return f"the cloud looks like {unit}: {spans}"
    if not overlap and _overlap(cloud[:, [1, 0, 2]], truth):
        return "the cloud has x and y exchanged: with easting first it would lie on the truth"
    if away > _FACTOR * max(size, true_size):
        system = "another coordinate system, or a local origin that was subtracted"
        return f"the cloud lies {away:.6g} away from the truth: {system}"
    return None


def check_datum(cloud: Floats, truth: Floats) -> str | None:
    """Look for ellipsoidal heights where the truth has heights above the sea, or the reverse."""
    apart = float(np.mean(cloud[:, 2]) - np.mean(truth[:, 2]))
    elsewhere = not _overlap(cloud[:, :2], truth[:, :2]) or _overlap(cloud[:, 2:], truth[:, 2:])
    if elsewhere or not _UNDULATIONS_M[0] < abs(apart) < _UNDULATIONS_M[1]:
        return None
    said = f"{abs(apart):.3g} m {'above' if apart > 0 else 'below'} the truth"
    return f"the cloud lies {said}: are its heights of another datum?"


def _overlap(one: Floats, other: Floats) -> bool:
    return bool((one[0] <= other[1]).all() and (other[0] <= one[1]).all())


def check_mirror(
    cloud: Floats, truth: Floats, transform: Similarity, near: Sequence[float]
) -> str | None:
    """Say where a cloud (N, 3) fits the truth (M, 3) once axes of its own frame are swapped.

    Most of it has to lie nearer than one of some distances then, and not now.
    """
    some = cloud[:: max(1, len(cloud) // _TRIED)]
    tree, own, limits = cKDTree(truth - truth[0]), transform.inverse().apply(some), np.sort(near)

    def shares(points: Floats) -> Floats:
        """Return the share of points nearer than each distance."""
        away, _ = tree.query(points - truth[0], distance_upper_bound=limits[-1])
        return np.asarray((away[:, None] < limits).mean(axis=0))

    now = shares(some)
    if now[0] > 0.5:  # as for nearly every cloud
        return None
    orders, signs = itertools.permutations(range(3)), itertools.product((1, -1), repeat=3)
    axes = [*itertools.product(orders, signs)]
    turned = np.stack([shares(transform.apply(own[:, order] * sign)) for order, sign in axes])
    for limit, before, after in zip(limits, now, turned.T, strict=True):
        if before <= 0.5 and after.max() >= max(0.6, 2 * before):
            order, sign = axes[after.argmax()]
            words = ", ".join("+-"[sign[n] < 0] + "xyz"[order[n]] for n in range(3))
            return (
                f"the cloud looks mirrored or turned over: {before:.0%} of it is within {limit:g} "
                f"m of the truth, {after.max():.0%} with ({words}) for (+x, +y, +z) in its frame"
            )
    return None
