"""A folder of DJI photos with RTK, whose metadata are the truth, as a dataset of `prepare`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import BenchmarkError, UsageError, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.registry import Option
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.content import photo_sizes, utm_zone
from airzoo_bench.datasets.heights import surface_altitudes
from airzoo_bench.datasets.metadata import (
    PhotoPrior,
    metadata_priors,
    priors_to_poses,
    read_prior,
    read_prior_file,
)
from airzoo_bench.datasets.scenes import NativeScene
from airzoo_bench.datasets.surveys.dji_files import (
    FIXED,
    DjiTags,
    TimeStamp,
    photo_cameras,
    photo_time_stamps,
    read_tags,
    turned_note,
)
from airzoo_bench.datasets.surveys.survey import Survey, SurveyOptions, stated_crs
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.crs import horizontal_crs
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.settings import MatchingProtocol

__all__ = ["DJI", "DjiOptions"]

_SAME_PRIOR_M = 0.01
_SAME_DATUM_M = 5.0  # two receivers are nearer, geoid and ellipsoid as a rule farther apart


@dataclass(frozen=True, kw_only=True)
class DjiOptions(SurveyOptions):
    """What may be asked of a folder of DJI photos."""

    source: Annotated[Path, Option("source", "Folder of the photos, and of *_Timestamp.MRK.")]
    priors: Annotated[
        Path | None,
        Option("priors", "CSV of positions and angles that are not the RTK's, for matching."),
    ] = None
    rtk: Annotated[
        Literal["fixed", "any"],
        Option("rtk", "Photos whose position becomes truth: those with an RTK fix, or any."),
    ] = "fixed"
    camera: Annotated[
        Path | None, Option("camera", "Camera of all photos (JSON); default: what the photos say.")
    ] = None


class DjiFolders(Survey[DjiOptions]):
    """Photos whose own metadata are the truth: RTK position, gimbal angles."""

    about = about_of("dji")
    options = DjiOptions
    needs = ("dom",)

    def reasons(self, options: DjiOptions) -> Mapping[str, str]:
        """Return why a track may have no truth, without asking for what was given."""
        stated = self.about.without_truth
        if options.dsm is not None:
            return stated
        lacking = "no surface model was given (--dsm)"
        if options.priors is None:
            lacking = f"{stated['matching']}, and --dsm"
        return {**stated, "matching": lacking}

    def benchmark_protocols(self, options: DjiOptions, root: Path) -> BenchmarkProtocols:
        """Return the protocols of own photos; orientations are not trusted."""
        kept = []
        for protocol in super().benchmark_protocols(options, root).every:
            if isinstance(protocol, MatchingProtocol):
                scores = protocol.scores.model_copy(update={"orientation_is_trusted": False})
                protocol = protocol.model_copy(update={"scores": scores})
                if options.dsm is None:
                    continue
            kept.append(protocol)
        return BenchmarkProtocols(tuple(kept))

    def read(self, options: DjiOptions, scene: str, progress: Progress) -> NativeScene:
        """Read the photos' metadata, and tables of time stamps next to them."""
        images = options.images or options.source
        sizes = photo_sizes(images, progress)
        shown = list(progress(sorted(sizes), "metadata", len(sizes)))
        metadata = {name: read_prior(images / name) for name in shown}
        tags = {name: read_tags(images / name, sizes[name]) for name in shown}
        stamps, notes = photo_time_stamps(options.source, images, metadata)
        kept = _kept(options, _placed(metadata, stamps), tags, stamps, notes)
        names = tuple(kept)
        _check_one_datum(kept, metadata, stamps, options.source)
        kept, converted = _of_surface(options, kept)
        metadata, _ = _of_surface(options, {name: metadata[name] for name in names})
        notes += [*converted, *turned_note(kept, tags)]
        crs = _crs(options, kept, notes)
        poses = priors_to_poses(kept, crs)
        stated = [stamps[n].std_m if n in stamps else tags[n].std_m for n in names]
        accuracy = _stated_accuracy([std for std in stated if std is not None], notes)
        plane = options.plane_height
        if plane is None and options.dsm is None:
            plane = _take_off(kept, images, notes)
        priors = _priors(options, names, sizes, poses, crs, notes)
        of_kept = {name: sizes[name] for name in names}
        fix = "give the camera with --camera"
        cameras, said = photo_cameras(images, of_kept, tags, options.camera, fix)
        return NativeScene(
            scene,
            images,
            names,
            cameras,
            poses,
            crs,
            dom=options.dom,
            dsm=options.dsm,
            cloud=options.cloud,
            plane_height_m=plane,
            priors=priors,
            metadata=metadata,
            is_metadata=True,
            unposed=tuple(name for name in sorted(sizes) if name not in kept),
            notes=(*notes, *said),
            truth_accuracy_m=options.truth_accuracy or accuracy,
            poses_from=images,
            crs_from=f"--crs {options.crs}" if options.crs else str(options.dsm or options.dom),
        )


def _placed(
    metadata: Mapping[str, PhotoPrior], stamps: Mapping[str, TimeStamp]
) -> dict[str, PhotoPrior]:
    """Put photos where their time stamps say, those that have one."""
    found = dict(metadata)
    for name, one in stamps.items():
        found[name] = replace(found[name], lon=one.lon, lat=one.lat, altitude_m=one.height_m)
    return found


def _kept(
    options: DjiOptions,
    placed: Mapping[str, PhotoPrior],
    tags: Mapping[str, DjiTags],
    stamps: Mapping[str, TimeStamp],
    notes: list[str],
) -> dict[str, PhotoPrior]:
    """Return the photos whose position can be truth, and note the others."""
    incomplete = [name for name, prior in placed.items() if not prior.is_complete]
    kept = {name: prior for name, prior in placed.items() if prior.is_complete}
    flags = {n: stamps[n].flag if n in stamps else tags[n].rtk_flag for n in kept}
    unfixed = [name for name, flag in flags.items() if flag not in FIXED]
    fixed_only = options.rtk == "fixed"
    if not kept or (fixed_only and len(unfixed) == len(kept)):
        seen = Counter("no RtkFlag" if f is None else f"RtkFlag {f}" for f in flags.values())
        counts = ", ".join(f"{count} with {what}" for what, count in sorted(seen.items()))
        raise BenchmarkError(
            f"no photo has a fixed RTK position: {counts}"
            if kept
            else "no photo has a position, an altitude and gimbal angles",
            where=options.source,
            expected="photos as the drone wrote them, with EXIF GPS, DJI's XMP and RtkFlag 50",
            fix="give poses from elsewhere (prepare poses, odm, colmap), or --rtk any if a "
            "truth that is metres off will do",
        )
    if unfixed:
        what = "left out" if fixed_only else "taken nevertheless"
        notes.append(f"photos without an RTK fix, {what}: {first_of(unfixed, len(placed))}")
    if incomplete:
        listed = first_of(incomplete, len(placed))
        notes.append(f"photos without position, altitude or angles: {listed}")
    return {n: prior for n, prior in kept.items() if not fixed_only or n not in unfixed}


def _check_one_datum(
    kept: Mapping[str, PhotoPrior],
    metadata: Mapping[str, PhotoPrior],
    stamps: Mapping[str, TimeStamp],
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
    given, dsm_vertical = options.vertical_crs, options.dsm_vertical_crs
    what = "heights of the poses"
    return surface_altitudes(photos, given, "--vertical-crs", options.dsm, dsm_vertical, what)


def _crs(options: DjiOptions, kept: Mapping[str, PhotoPrior], notes: list[str]) -> str:
    """Return the CRS that is stated, else the map's, else the UTM zone of the photos."""
    crs = stated_crs(options)
    if crs is None:
        crs = horizontal_crs(open_info(options.dsm or options.dom or Path()).crs)
    if crs.is_projected:
        return str(crs.to_string())
    if options.dsm is not None:
        raise UsageError(
            "the surface model is in degrees", where=options.dsm, fix="warp it to the UTM zone"
        )
    zone = CRS.from_user_input(
        utm_zone(np.array([(p.lon, p.lat) for p in kept.values()], np.float64))
    )
    notes.append(f"poses are in {zone.name}, the photos' zone")
    return str(zone.to_string())


def _stated_accuracy(stds: Sequence[tuple[float, float, float]], notes: list[str]) -> float | None:
    """Return how good positions are stated to be, in metres of all three axes, and say it."""
    if not stds:
        notes.append("photos do not state how good their positions are")
        return None
    values = np.array(stds)
    level = np.median(np.hypot(values[:, 0], values[:, 1]))
    notes.append(
        f"positions are stated good to {level:.3f} m in plan and {np.median(values[:, 2]):.3f} m "
        f"in height (medians of standard deviations of {len(stds)} photos); gimbal angles to no "
        "figure"
    )
    # A file of zeros states nothing.
    return round(float(np.median(np.linalg.norm(values, axis=1))), 4) or None


def _take_off(kept: Mapping[str, PhotoPrior], images: Path, notes: list[str]) -> float:
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
    sizes: Mapping[str, tuple[int, int]],
    poses: Poses,
    crs: str,
    notes: list[str],
) -> Poses | None:
    """Return priors of another source than the truth; None where none are given."""
    if options.priors is None:
        return None
    given = read_prior_file(options.priors, sizes)
    every = {name: PhotoPrior(**given.get(name, {})) for name in names}
    vertical, what = options.priors_vertical_crs, "altitudes of --priors"
    every, converted = surface_altitudes(
        every, vertical, "--priors-vertical", options.dsm, options.dsm_vertical_crs, what
    )
    notes += converted
    priors = metadata_priors(every, crs)
    away = None if priors is None else np.linalg.norm(priors.centres - poses.centres, axis=1)
    if away is None or np.nanmedian(away) < _SAME_PRIOR_M:
        raise BenchmarkError(
            "gives no photo with an RTK position a whole prior"
            if away is None
            else f"its positions are the truth: {np.nanmedian(away):.4f} m from the RTK's (median)",
            where=options.priors,
            expected="image, lon, lat, altitude_m, yaw_deg, pitch_deg, roll_deg of another source, "
            "such as the receiver without RTK",
            fix="leave --priors out: retrieval needs none",
        )
    return priors


DJI = DjiFolders()
