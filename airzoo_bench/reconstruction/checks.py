"""Checks for mistakes that users make and cannot see, a function each.

A check raises an error where the prediction cannot be meant as it stands, or returns a note, a
sentence for whoever reads the numbers, where it may be. `scene_notes` collects them.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from airzoo_bench.core.errors import PredictionError, agreeing, counted, first_of
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from airzoo_bench.reconstruction.alignment import Alignment, PosedCameras, partners
from airzoo_bench.reconstruction.fusion import DepthMaps, PointMaps
from airzoo_bench.reconstruction.metrics import angle_deg, relative_poses
from airzoo_bench.reconstruction.similarity import Similarity, fit_many

if TYPE_CHECKING:
    from airzoo_bench.reconstruction.predictions import ScenePrediction
    from airzoo_bench.reconstruction.scoring import Comparison
    from airzoo_bench.reconstruction.settings import ReconstructionProtocol, ReconstructionScores
    from airzoo_bench.reconstruction.truth import ReconstructionTruth


_MOST_CAMERAS = 64
_LEAST_CAMERAS, _LINE_SHARE = 5, 0.05  # fewer, or cameras on a line, are noted, not refused
_OPENGL = np.diag((1.0, -1.0, -1.0))
_FACTOR = 80.0  # a little below a hundred, so that outliers do not hide centimetres
_UNITS = ((1000.0, "millimetres"), (100.0, "centimetres"), (0.001, "kilometres"))
_FOOT_M = 0.3048
_UNDULATIONS_M = 5.0, 110.0  # between the ellipsoid and the sea; below 5 m it may be an error
_PIECE, _LOOKED_AT, _TRIED = 1 << 14, 1 << 22, 2000
_FEWEST_DIGITS = 6  # what C's and C++'s streams write unless told otherwise


def scene_notes(
    prediction: ScenePrediction,
    cameras: PosedCameras | None,
    truth: ReconstructionTruth,
    found: Comparison,
    protocol: ReconstructionProtocol,
) -> list[str]:
    """Collect the notes on a prediction: oddities, points left out, the alignment."""
    scale = found.alignment.transform.scale
    notes = [
        *prediction.notes,
        *_check_views(prediction, truth, protocol, scale),
        *_check_cameras(cameras, truth, protocol),
        *_check_precision(prediction, protocol.scores, scale),
        *_check_alignment(found.alignment),
        *_check_cloud(found, protocol.scores),
    ]
    return [note for note in notes if note]


# --- cameras ---


@dataclass(frozen=True)
class Inversion:
    """Degrees between poses and the truth as given and once inverted, perhaps in OpenGL axes."""

    as_given: float
    inverted: float
    axes: str

    @classmethod
    def between(cls, given: Poses, truth: Poses) -> Inversion | None:
        """Compare cameras with the truth as they are and once inverted; None of fewer than 3."""
        if len(given) < 3:
            return None
        rows = np.unique(np.linspace(0, len(given) - 1, _MOST_CAMERAS).astype(int))
        chosen, pairs = given.take(rows), np.triu_indices(len(rows), 1)
        true_turn, true_sight = relative_poses(truth.take(rows), *pairs)

        def misfit(poses: Poses) -> float:
            turn, sight = relative_poses(poses, *pairs)
            apart = rotation_angle_deg(turn, true_turn), angle_deg(sight, true_sight)
            return float(np.median(np.maximum(*apart)))

        inverse = Poses.from_centres(np.swapaxes(chosen.rotation, 1, 2), chosen.translation)
        opengl = Poses.from_centres(_OPENGL @ inverse.rotation, inverse.centres)
        readings = ((inverse, ""), (opengl, " and in OpenCV's axes, not OpenGL's"))
        inverted, axes = min((misfit(one), axes) for one, axes in readings)
        return cls(misfit(chosen), inverted, axes)

    @property
    def is_likely(self) -> bool:
        """Whether poses look camera-to-world, read as world-to-camera, or the reverse."""
        return self.as_given > 5.0 and self.inverted < 0.5 * self.as_given

    def __str__(self) -> str:
        return (
            "the extrinsics look inverted (camera-to-world for world-to-camera, or the reverse): "
            f"between two cameras they are {self.as_given:.1f} degrees off the truth as they "
            f"stand, {self.inverted:.1f} once inverted{self.axes}"
        )


def refuse_camera_to_world(given: Poses, truth: Poses, where: str) -> None:
    """Refuse poses that fit the truth only once they are inverted, if they are off one line.

    Along a line, names in reverse order look the same.
    """
    found = Inversion.between(given, truth)
    if found is None or len(given) < _LEAST_CAMERAS:
        return
    is_sure = found.as_given > 20.0 and found.inverted < min(20.0, found.as_given / 3)
    spread = np.linalg.svd(truth.centres - truth.centres.mean(axis=0), compute_uv=False)
    if is_sure and spread[1] > _LINE_SHARE * spread[0]:
        raise PredictionError(
            str(found),
            where=where,
            expected="extrinsics that take points of the world to the camera, x_cam = R X + t, or "
            "what the reader says that they are",
            fix="invert them: R.T and -R.T @ t"
            + (", both with diag(1, -1, -1) from the left" if found.axes else ""),
        )


def refuse_shifted_names(given: PosedCameras, truth: PosedCameras, where: str) -> None:
    """Refuse names of photos that are one off: other photos leave a tenth of the misfit."""
    if not given.names:
        return
    true = truth.centres[np.argsort(truth.names)]
    at = np.searchsorted(sorted(truth.names), given.names)
    spacing = float(np.median(np.linalg.norm(np.diff(true, axis=0), axis=1)))
    for aligned in (False, True):
        here, *others = (_misfit(given.centres, true, at + step, aligned) for step in (0, 1, -1))
        if 0.2 * spacing < here < np.inf and min(others) < 0.1 * here:
            which = "next" if others[0] < others[1] else "previous"
            raise PredictionError(
                f"names of photos look one off: centres are {here:.3g} m from the photos they are "
                f"named for, and {min(others):.3g} m from the {which} ones in the order of names",
                where=where,
                expected="each camera under the name of its own photo",
                fix="look where the list of names begins: at the first photo, as the views do",
            )


def _misfit(centres: Floats, true: Floats, rows: Ints, aligned: bool) -> float:
    """Return the median distance of centres (N, 3) to rows of the truth, infinite for too few."""
    there = (rows >= 0) & (rows < len(true)) & np.isfinite(centres).all(axis=1)
    source, target = centres[there], true[rows[there]]
    if len(source) < _LEAST_CAMERAS:
        return float("inf")
    if aligned:
        source = fit_many(source[None], target[None], with_scale=True)[0][0].apply(source)
    return float(np.median(np.linalg.norm(source - target, axis=1)))


def _check_cameras(
    cameras: PosedCameras | None, truth: ReconstructionTruth, protocol: ReconstructionProtocol
) -> Iterator[str]:
    method = protocol.alignment.method
    if cameras is None and method != "none":
        yield f"holds no cameras: taken as it stands, without alignment by {method}"
    if cameras is None or cameras.rotation is None:
        return
    rows, true_rows = partners(cameras, truth.posed)
    given = Poses(rotation=cameras.rotation[rows], centres=cameras.centres[rows])
    found = Inversion.between(given, truth.poses.take(true_rows))
    if found is not None and found.is_likely:
        yield str(found)


def _check_alignment(alignment: Alignment) -> Iterator[str]:
    turns, agree = alignment.rotations_deg, 2 * alignment.inliers >= alignment.cameras
    if alignment.used_orientations:
        yield "camera centres lie on a line: aligned by the cameras' orientations too"
    if turns is not None and agree and turns["median"] > 150.0:
        yield (
            f"cameras are turned by {turns['median']:.0f} degrees (median), though their centres "
            "fit: are the extrinsics in OpenGL axes (y up, z back) instead of OpenCV's, or, along "
            "a straight strip, the image names in reverse order?"
        )
    if not alignment.robust:
        yield "fewer than 3 cameras agree: aligned to all of them"
    elif alignment.method != "none" and not agree:
        yield (
            f"only {alignment.inliers} of {counted(alignment.cameras, 'camera')} "
            f"{agreeing(alignment.inliers, 'agrees', 'agree')} within "
            f"{alignment.inlier_limit_m:.3g} m: the alignment may be that of a part"
        )
    if alignment.icp_failure is not None:
        yield f"{alignment.icp_failure}: aligned by cameras only"
    if alignment.method != "none" and alignment.cameras_missing:
        photos = counted(alignment.cameras + alignment.cameras_missing, "photo")
        have = agreeing(alignment.cameras_missing, "has", "have")
        yield f"{alignment.cameras_missing} of {photos} {have} no pose in the prediction"


# --- views ---


def check_resolution(cameras: Cameras, names: Sequence[str] | None, where: str) -> None:
    """Refuse intrinsics of images of another size than the maps, which the cameras have."""
    size = np.stack((cameras.width, cameras.height), axis=-1)
    middle, point = size / 2.0, cameras.principal_point
    ratio = point / middle
    normalised = (np.abs(point) <= 1.0).all(axis=1) & (size > 4).all(axis=1)
    other = np.flatnonzero(_scaled_alike(ratio, np.abs(point - middle)) | normalised)
    if not len(other):
        return
    labels = names or [f"camera {row}" for row in range(len(cameras))]
    typical = float(np.median(ratio[other].mean(axis=1)))
    likely = "of images of about {} x {}".format(*np.rint(typical * size[0]).astype(int))
    raise PredictionError(
        f"the principal point is {typical:.3g} times the centre of the maps in "
        f"{first_of([labels[row] for row in other.tolist()], len(cameras))}: the intrinsics look "
        f"{'normalised to 0..1' if normalised.any() else likely}",
        where=where,
        expected=f"intrinsics of the maps' own size, {size[0, 0]} x {size[0, 1]}",
        fix="scale fx, cx by the ratio of widths and fy, cy by the ratio of heights",
    )


def _scaled_alike(ratio: Floats, shift: Floats) -> Bools:
    """Say where x and y are off by one clear factor (N,); where all are, a slight one is clear."""
    positive = np.asarray((ratio > 0.0).all(axis=1))
    logs = np.log(np.where(positive[:, None], ratio, 1.0))
    apart, factor = np.abs(logs[:, 0] - logs[:, 1]), np.abs(logs).min(axis=1)
    clear = (apart <= 0.1) & (factor > np.log(1.5))
    # Photos of 640 px and maps of 504 px; conventions of pixels differ by half a pixel.
    slight = (apart <= 0.03) & (factor > np.log(1.1)) & (shift.min(axis=1) > 1.0)
    return np.asarray(positive & (clear | slight.all()))


def check_image_size(size: tuple[int, int], true_width: int, true_height: int) -> str | None:
    """Say where maps (width, height) have another shape than the photos that they belong to."""
    change = (size[0] / size[1]) / (true_width / true_height)
    if abs(np.log(change)) <= 0.05:
        return None
    turned = abs(np.log(change * (true_width / true_height) ** 2)) <= 0.05
    reason = "turned by 90 degrees (EXIF?)" if turned else "cut, padded, or of other photos"
    return (
        f"maps of {size[0]} x {size[1]} for photos of {true_width} x {true_height}: the images "
        f"look {reason}"
    )


def _check_views(
    prediction: ScenePrediction,
    truth: ReconstructionTruth,
    protocol: ReconstructionProtocol,
    scale: float,
) -> Iterator[str | None]:
    maps, images, fusion = prediction.geometry, prediction.images, protocol.fusion
    if isinstance(maps, FileCloud):
        return
    height, width = (maps.depth if isinstance(maps, DepthMaps) else maps.points).shape[1:3]
    widths, heights = truth.photos["width"], truth.photos["height"]
    yield check_image_size((width, height), int(widths.median()), int(heights.median()))
    if images is not None and not images.named:
        yield (
            "has no image_names: its views were taken for the photos in the order of their names, "
            "which their poses fit"
        )
    if isinstance(maps, DepthMaps):
        seen, far = _sample_depths(maps).astype(np.float64) * scale, fusion.max_depth_m
        if seen.size and (seen > far).mean() > 0.5:
            yield (
                f"depths are {float(np.median(seen)):g} m as aligned (median), beyond the "
                f"protocol's {far:g} m: are they in millimetres?"
            )
        if images is not None and not images.found.all():
            lost, every = int(np.count_nonzero(~images.found)), len(images.found)
            have = agreeing(lost, "has", "have")
            yield f"{lost} of {counted(every, 'depth map')} {have} no pose: left out"
    if fusion.least_confidence is not None and maps.confidence is None:
        yield "has no confidence: all of it was taken"


def _sample_depths(maps: DepthMaps) -> NDArray[Any]:
    """Return the depths of surfaces in the first views."""
    views = range(min(len(maps.depth), max(1, _LOOKED_AT // max(maps.depth[0].size, 1))))
    some = np.stack([maps.depth[row] for row in views])
    seen: NDArray[Any] = some[np.isfinite(some) & (some > 0)]
    return seen


# --- digits ---


def _check_precision(
    prediction: ScenePrediction, scores: ReconstructionScores, scale: float
) -> Iterator[str | None]:
    """Say where coordinates lost digits, or K may be half a pixel off, by how many metres."""
    geometry, images, finest = prediction.geometry, prediction.images, scores.finest_m / 20.0
    tolerance = min(finest, 0.01)
    if images is not None and images.found.any():
        error = float(np.median(images.errors[images.found])) * scale
        if tolerance < error < np.inf:
            yield (
                f"extrinsics lost digits: an error of {error:.2g} m is to be expected in the "
                "cameras (C = -R^T t, and t is long); store float64, or subtract an origin first"
            )
    if isinstance(geometry, FileCloud):
        some = next(iter(geometry.pieces(_PIECE)), None)
        if some is not None:
            yield check_digits(some.points, geometry.precision, scale, tolerance)
    elif isinstance(geometry, PointMaps):
        points = geometry.points[0].reshape(-1, 3)[:_PIECE].astype(np.float64)
        yield check_digits(points, geometry.points.dtype, scale, tolerance)
    elif prediction.pixel_centres is None and images is not None:
        yield _check_pixel_centres(geometry, images.named, scale, finest)


def _check_pixel_centres(
    maps: DepthMaps, named: bool, scale: float, tolerance: float
) -> str | None:
    """Ask for the field `pixel_centres`, which is absent, where it would move points."""
    seen = _sample_depths(maps)
    off = float(np.hypot(*(0.5 / np.median(maps.cameras.focal, axis=0))))
    error = off * float(np.median(seen)) * scale if seen.size else 0.0
    if not error > tolerance:
        return None
    taken = "half (the first pixel's is 0.5, 0.5)" if named else "integer (Depth Anything 3)"
    return (
        f"does not say where K has its pixel centres, taken as {taken}: if that is wrong, points "
        f"are {error:.2g} m off; add pixel_centres = 'integer' (Depth Anything 3, VGGT, CUT3R, "
        "MapAnything, DUSt3R) or 'half'"
    )


def check_digits(
    points: Floats, stored: np.dtype[Any], scale: float, tolerance: float
) -> str | None:
    """Say where coordinates lost digits before they came here."""
    finite = points[np.abs(points).max(axis=1, initial=0.0) < 1e30]
    if not len(finite):
        return None
    largest = np.abs(finite).max(axis=0)
    step, kept = _stated_step(finite[:_TRIED], largest, stored)
    error = float(np.sqrt((step * step).sum() / 12.0)) * scale
    if not error > tolerance:
        return None
    return (
        f"coordinates such as {float(largest.max()):.0f} are kept to {kept} only, steps of "
        f"{float(step.max()) * scale:.2g} m: an error of {error:.2g} m is to be expected; store "
        "float64, or all digits, or subtract an origin first"
    )


def _stated_step(points: Floats, largest: Floats, stored: np.dtype[Any]) -> tuple[Floats, str]:
    """Return the step (3,) between values at the largest, and what it comes from."""
    narrow = stored if stored.kind == "f" and stored.itemsize < 8 else np.dtype("f4")
    short = points.astype(narrow)
    fits = narrow == stored or bool((short == points).all())
    values = (short if fits else points).ravel()
    for digits in (_FEWEST_DIGITS, _FEWEST_DIGITS + 1):
        if all(values.dtype.type(f"{one:.{digits}g}") == one for one in values.tolist()):
            place = np.floor(np.log10(np.maximum(largest, 1e-30))) + 1
            return 10.0 ** (place - digits), f"{digits} digits"
    if not fits:
        return np.zeros(3), ""
    return np.spacing(largest.astype(narrow)).astype(np.float64), narrow.name


# --- the cloud ---


def _check_cloud(found: Comparison, scores: ReconstructionScores) -> Iterator[str | None]:
    """Say what was left out of a cloud, and where it seems to lie elsewhere."""
    cloud, true = found.clouds
    if cloud.distrusted:
        yield f"left out: {counted(cloud.distrusted, 'point')} of too little confidence"
    if cloud.not_finite:
        what = "with coordinates that are NaN, infinite or too large to compute with"
        yield f"left out: {counted(cloud.not_finite, 'point')} {what}"
    yield (
        check_bounds(cloud.bounds, true.bounds)
        or check_mirror(cloud.sample, true.sample, found.alignment.transform, scores.f1_below_m)
        or check_datum(cloud.bounds, true.bounds)
    )
    share = cloud.outside / max(cloud.source.count + cloud.thinned + cloud.outside, 1)
    if share >= 0.005:  # less is 0 %
        mostly = ": precision and F1 tell of the smaller part" if share > 0.5 else ""
        yield f"{share:.0%} of the prediction lies outside the scored region, uncounted{mostly}"
    if not cloud.source.count:
        if not cloud.outside and not cloud.not_finite and not cloud.distrusted:
            yield "the prediction holds no point, or no depth within the protocol's range"
        yield "no point is left to compare: it scores 0 and infinite distances"


def check_bounds(cloud: Floats, truth: Floats) -> str | None:
    """Guess from bounds (2, 3) in which other coordinates a cloud may be."""
    if not (np.isfinite(cloud).all() and np.isfinite(truth).all()):
        return None
    span, true_span = np.ptp(cloud, axis=0), np.ptp(truth, axis=0)
    spans = "it spans {}, the truth {}".format(
        *(" x ".join(f"{side:.4g}" for side in one) for one in (span, true_span))
    )
    flat, rise, true_rise = span[:2].max(), span[2], true_span[2]
    in_degrees = 0.0 < flat < 5.0 and (np.abs(cloud[:, :2]) <= 180.0).all()
    upright = 0.1 * true_rise < rise < 10.0 * true_rise
    if in_degrees and flat * _FACTOR < true_span[:2].max() and upright:
        return f"the cloud looks like longitude and latitude in degrees: {spans}"
    overlap = _overlap(cloud, truth)
    if not overlap and (np.abs(cloud[:, :2] * _FOOT_M - truth[:, :2]) < true_span[:2]).all():
        return "the cloud looks like feet: in metres it would lie on the truth"
    size, true_size = float(np.linalg.norm(span)), float(np.linalg.norm(true_span))
    if min(size, true_size) > 0.0 and not 1 / _FACTOR < size / true_size < _FACTOR:
        ratio = size / true_size
        off = (
            f"{ratio:.3g} times as large as" if ratio > 1 else f"{1 / ratio:.3g} times smaller than"
        )
        unit = next((unit for factor, unit in _UNITS if 0.5 < ratio / factor < 2.0), None)
        if unit is not None:
            return f"the cloud looks like {unit}: it is {off} the truth"
        return f"the cloud is {off} the truth: {spans}"
    if not overlap and _overlap(cloud[:, [1, 0, 2]], truth):
        return "the cloud has x and y exchanged: with easting first it would lie on the truth"
    away, width = (
        float(np.linalg.norm(cloud.mean(axis=0) - truth.mean(axis=0))),
        max(size, true_size),
    )
    if not away > _FACTOR * width:
        return None
    return (
        f"the cloud lies {away:.6g} away from the truth, {away / max(width, 1e-300):.3g} times "
        "its size: another coordinate system, or a local origin that was subtracted"
    )


def check_datum(cloud: Floats, truth: Floats) -> str | None:
    """Look for ellipsoidal heights where the truth has heights above the sea, or the reverse."""
    apart = float(np.mean(cloud[:, 2]) - np.mean(truth[:, 2]))
    elsewhere = not _overlap(cloud[:, :2], truth[:, :2]) or _overlap(cloud[:, 2:], truth[:, 2:])
    if elsewhere or not _UNDULATIONS_M[0] < abs(apart) < _UNDULATIONS_M[1]:
        return None
    where = "above" if apart > 0 else "below"
    return f"the cloud lies {abs(apart):.3g} m {where} the truth: are its heights of another datum?"


def _overlap(one: Floats, other: Floats) -> bool:
    return bool((one[0] <= other[1]).all() and (other[0] <= one[1]).all())


def check_mirror(
    cloud: Floats, truth: Floats, transform: Similarity, near: Sequence[float]
) -> str | None:
    """Say where a cloud (N, 3) would fit the truth (M, 3) with axes of its own frame negated.

    Or exchanged; most of it has to lie nearer than one of some distances then, and not now.
    """
    if not (len(cloud) and len(truth)):
        return None
    some = cloud[:: max(1, len(cloud) // _TRIED)]
    tree, own = cKDTree(truth - truth[0]), transform.inverse().apply(some)

    def shares(points: Floats) -> Floats:
        """Return the share of points nearer than each distance."""
        away, _ = tree.query(points - truth[0], distance_upper_bound=max(near))
        return np.asarray((away[:, None] < limits).mean(axis=0))

    limits = np.sort(near)
    now = shares(some)
    if now[0] > 0.5:  # as for nearly every cloud
        return None
    signs = itertools.product((1.0, -1.0), repeat=3)
    turns = itertools.product(itertools.permutations(range(3)), signs)
    axes = {
        ", ".join("+-"[s < 0] + "xyz"[a] for a, s in zip(*one, strict=True)): one for one in turns
    }
    turned = [shares(transform.apply(own[:, order] * sign)) for order, sign in axes.values()]
    for limit, before, all_after in zip(limits, now, np.transpose(turned), strict=True):
        words, after = list(axes)[all_after.argmax()], all_after.max()
        if before > 0.5:
            return None
        if after >= max(0.6, 2 * before):
            return (
                f"the cloud looks mirrored or turned over: {before:.0%} of it is within {limit:g} "
                f"m of the truth, {after:.0%} with ({words}) for (+x, +y, +z) in its own frame"
            )
    return None
