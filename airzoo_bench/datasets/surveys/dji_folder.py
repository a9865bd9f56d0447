"""A folder of DJI photos as a scene whose truth is what the photos say."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import BenchmarkError, UsageError, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.height_systems import check_accuracy, surface_altitudes
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.photo_metadata import PhotoPrior, priors_to_poses, read_prior
from airzoo_bench.datasets.photos import metadata_priors
from airzoo_bench.datasets.priors import read_prior_file
from airzoo_bench.datasets.sources import photo_sizes
from airzoo_bench.datasets.surveys.crs import stated_crs
from airzoo_bench.datasets.surveys.dji_stamps import TimeStamp, photo_time_stamps
from airzoo_bench.datasets.surveys.dji_tags import (
    FIXED,
    DjiTags,
    photo_cameras,
    read_tags,
    stated_accuracy,
    turned_note,
)
from airzoo_bench.datasets.surveys.options import DjiOptions
from airzoo_bench.geometry.crs import horizontal_crs
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info

__all__ = ["read_folder"]

_SAME_PRIOR_M = 0.01
_SAME_DATUM_M = 5.0  # two receivers are nearer, geoid and ellipsoid as a rule farther apart


def read_folder(options: DjiOptions, scene: str, dom: Path, progress: Progress) -> NativeScene:
    """Read a folder of photos."""
    check_accuracy(options)
    images = options.images or options.source
    sizes = photo_sizes(images, progress)
    shown = list(progress(sorted(sizes), "metadata", len(sizes)))
    metadata = {name: read_prior(images / name) for name in shown}
    tags = {name: read_tags(images / name, sizes[name]) for name in shown}
    stamps, notes = photo_time_stamps(options.source, images, metadata)
    placed = {name: _placed(metadata[name], stamps.get(name)) for name in metadata}
    kept = _kept(options, placed, tags, stamps, notes)
    names = tuple(kept)
    _check_one_datum(kept, metadata, stamps, options.source)
    kept, converted = _of_surface(options, kept)
    metadata, _ = _of_surface(options, {name: metadata[name] for name in names})
    notes += converted
    notes += turned_note(kept, tags)
    crs = _crs(options, dom, kept, notes)
    poses = priors_to_poses(kept, crs)
    stated = [stamps[n].std_m if n in stamps else tags[n].std_m for n in names]
    said, accuracy = stated_accuracy(stated)
    notes.append(said)
    plane = options.plane_height
    if plane is None and options.dsm is None:
        plane = _plane(kept, images, notes)
    priors = _priors(options, names, sizes, poses, crs, notes)
    of_kept = {name: sizes[name] for name in names}
    fix = "give the camera with --camera"
    cameras, said_of_cameras = photo_cameras(images, of_kept, tags, options.camera, fix)
    notes += said_of_cameras
    return NativeScene(
        scene,
        images,
        names,
        cameras,
        poses,
        crs,
        dom=dom,
        dsm=options.dsm,
        cloud=options.cloud,
        plane_height_m=plane,
        priors=priors,
        metadata=metadata,
        is_metadata=True,
        unposed=tuple(name for name in sorted(sizes) if name not in kept),
        notes=tuple(notes),
        truth_accuracy_m=options.truth_accuracy or accuracy,
        poses_from=images,
        crs_from=f"--crs {options.crs}" if options.crs else str(options.dsm or dom),
    )


def _placed(prior: PhotoPrior, stamp: TimeStamp | None) -> PhotoPrior:
    if stamp is None:
        return prior
    return replace(prior, lon=stamp.lon, lat=stamp.lat, altitude_m=stamp.height_m)


def _kept(
    options: DjiOptions,
    placed: dict[str, PhotoPrior],
    tags: dict[str, DjiTags],
    stamps: dict[str, TimeStamp],
    notes: list[str],
) -> dict[str, PhotoPrior]:
    """Return the photos whose position can be truth, and note the others."""
    incomplete = [name for name, prior in placed.items() if not prior.is_complete]
    kept = {name: prior for name, prior in placed.items() if prior.is_complete}
    if not kept:
        raise BenchmarkError(
            "no photo has a position, an altitude and gimbal angles",
            where=options.source,
            expected="photos as the drone wrote them, with EXIF GPS and DJI's XMP",
        )
    flags = {n: stamps[n].flag if n in stamps else tags[n].rtk_flag for n in kept}
    unfixed = [name for name, flag in flags.items() if flag not in FIXED]
    if options.rtk == "fixed":
        if len(unfixed) == len(kept):
            seen = Counter("no RtkFlag" if f is None else f"RtkFlag {f}" for f in flags.values())
            raise BenchmarkError(
                "no photo has a fixed RTK position: "
                + ", ".join(f"{count} with {what}" for what, count in sorted(seen.items())),
                where=options.source,
                expected="RtkFlag 50",
                fix="give poses from elsewhere (prepare poses, odm, colmap), or --rtk any if a "
                "truth that is metres off will do",
            )
        kept = {name: prior for name, prior in kept.items() if name not in unfixed}
    if unfixed:
        what = "left out" if options.rtk == "fixed" else "taken nevertheless"
        notes.append(f"photos without an RTK fix, {what}: {first_of(unfixed, len(placed))}")
    if incomplete:
        notes.append(
            f"photos without position, altitude or angles: {first_of(incomplete, len(placed))}"
        )
    return kept


def _check_one_datum(
    kept: dict[str, PhotoPrior],
    metadata: dict[str, PhotoPrior],
    stamps: dict[str, TimeStamp],
    where: Path,
) -> None:
    """Refuse time stamps of another datum than the photos that have none."""
    without = [name for name in kept if name not in stamps]
    known = [(one.height_m, metadata[name].altitude_m) for name, one in stamps.items()]
    apart = [stamped - own for stamped, own in known if own is not None]
    off = float(np.median(apart)) if apart else 0.0
    if without and abs(off) > _SAME_DATUM_M:
        raise BenchmarkError(
            f"time stamps are {off:+.1f} m from the photos' own heights (median), which are all "
            f"that there is of {first_of(without, len(kept))}",
            where=where,
            expected="heights of one datum",
            fix="take photos without a time stamp out of the folder, or the tables of time stamps",
        )


def _of_surface(
    options: DjiOptions, photos: dict[str, PhotoPrior]
) -> tuple[dict[str, PhotoPrior], tuple[str, ...]]:
    """Take the heights that are the truth to the surface model's, and say so."""
    given, what = options.vertical_crs, "heights of the poses"
    return surface_altitudes(photos, given, "--vertical-crs", options, options.dsm, what)


def _crs(options: DjiOptions, dom: Path, kept: dict[str, PhotoPrior], notes: list[str]) -> str:
    stated = stated_crs(options)
    if stated is not None:
        return stated.to_string()
    crs = horizontal_crs(open_info(options.dsm or dom).crs)
    if crs.is_projected:
        return crs.to_string()
    if options.dsm is not None:
        raise UsageError(
            "the surface model is in degrees", where=options.dsm, fix="warp it to the UTM zone"
        )
    places = np.array([(p.lon, p.lat) for p in kept.values()], dtype=np.float64)
    # About the first photo, since the middle of 179.9 and -179.9 degrees is not 0.
    places[:, 0] = (places[:, 0] - places[0, 0] + 180.0) % 360.0 - 180.0 + places[0, 0]
    lon, lat = np.median(places, axis=0).tolist()
    zone = CRS.from_epsg((32600 if lat >= 0 else 32700) + int((lon + 180) // 6) % 60 + 1)
    notes.append(f"poses are in {zone.name}, the photos' zone")
    return zone.to_string()


def _plane(kept: dict[str, PhotoPrior], images: Path, notes: list[str]) -> float:
    """Return the height of the place of take-off, in the photos' altitudes."""
    known = [
        p.altitude_m - p.relative_altitude_m
        for p in kept.values()
        if p.altitude_m is not None and p.relative_altitude_m is not None
    ]
    if not known:
        raise UsageError(
            "there is no surface model, and photos have no RelativeAltitude",
            where=images,
            fix="give --dsm or --plane-height",
        )
    height = float(np.median(known))
    notes.append(
        f"the ground is a plane at {height:.2f} m, where the drone took off: absolute less "
        f"relative altitude, {np.ptp(known):.2f} m apart at most (--dsm for a surface)"
    )
    return height


def _priors(
    options: DjiOptions,
    names: tuple[str, ...],
    sizes: dict[str, tuple[int, int]],
    poses: Poses,
    crs: str,
    notes: list[str],
) -> Poses | None:
    """Return priors of another source than the truth; None where there are none."""
    if options.priors is None:
        return None
    given = read_prior_file(options.priors, sizes)
    every = {name: PhotoPrior(**given.get(name, {})) for name in names}
    every, converted = surface_altitudes(
        every,
        options.priors_vertical_crs,
        "--priors-vertical",
        options,
        options.dsm,
        "altitudes of --priors",
    )
    notes += converted
    priors = metadata_priors(every, crs)
    if priors is None:
        raise BenchmarkError(
            "gives no photo with an RTK position a whole prior",
            where=options.priors,
            expected="image, lon, lat, altitude_m, yaw_deg, pitch_deg, roll_deg",
        )
    away = np.linalg.norm(priors.centres - poses.centres, axis=1)
    if np.nanmedian(away) < _SAME_PRIOR_M:
        raise BenchmarkError(
            f"its positions are the truth: {np.nanmedian(away):.4f} m from the RTK's (median)",
            where=options.priors,
            expected="positions of another source, such as the receiver without RTK",
            fix="leave --priors out: retrieval needs none",
        )
    return priors
