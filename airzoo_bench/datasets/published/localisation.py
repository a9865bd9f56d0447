"""AerialExtreMatch's localisation set, and OrthoLoC: photos of 6-DoF truth, matched to maps.

AerialExtreMatch has one map and surface model, OrthoLoC an orthophoto and a surface model for each
photo of its 47 places: a sample (.npz) becomes a photo, a map and a surface model.

::

    rgb/<name>.JPG     queries
    gt_pose.txt        name qw qx qy qz tx ty tz: world-to-camera, OpenCV axes, EPSG:4547
    intrinsic.txt      name PINHOLE width height fx fy cx cy
    HQref/, LQref/     an orthophoto and a surface model as GeoTIFF, with .prj and .tfw

Names agree up to their first point.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine
from numpy.typing import NDArray
from PIL import Image

from airzoo_bench.core.errors import BenchmarkError, first_of, readable
from airzoo_bench.core.files import atomic_write, data_root, fingerprint
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.metadata import metadata_priors, photo_metadata
from airzoo_bench.datasets.published.places import (
    files_by_key,
    find_home,
    find_maps,
    missing,
    needed_path,
    only_one,
    read_posed_lines,
    stem_key,
    sub_path,
    with_georeference,
)
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos
from airzoo_bench.datasets.settings import ExtreMatchOptions, SourceOptions
from airzoo_bench.datasets.truths import BenchmarkProtocols, variant_of
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS, check_same_crs
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info, write_geotiff
from airzoo_bench.matching.protocol import MatchingProtocol
from airzoo_bench.protocol.model import protocol_of_track

_CRS = "EPSG:4547"
_SCENE = "localization"
_FOLDERS = {"hq": "HQref", "lq": "LQref"}
_PARTS = "rgb/*.JPG, gt_pose.txt, intrinsic.txt, and HQref/*.tif or LQref/*.tif"


class _AerialExtreMatch(Dataset[ExtreMatchOptions]):
    """The localisation set of _AerialExtreMatch."""

    name = "aerialextrematch"
    about = load_about("aerialextrematch")
    options = ExtreMatchOptions

    def benchmark_protocols(self, options: ExtreMatchOptions, root: Path) -> BenchmarkProtocols:
        lq, by_truth = options.reference == "lq", options.prior == "truth"
        benchmark = self.name + "-lq" * lq + "-truth-prior" * by_truth
        base = protocol_of_track("aerialextrematch-matching", root, MatchingProtocol)
        changes = {"prior": {"source": options.prior}}
        return BenchmarkProtocols((variant_of(base, benchmark, changes),))

    def scenes(self, options: ExtreMatchOptions) -> Mapping[str, Sequence[Path]]:
        priors = () if options.priors is None else (options.priors,)
        return {_SCENE: (*_parts(options), *priors)}

    def read(self, options: ExtreMatchOptions, scene: str, progress: Progress) -> NativeScene:
        images, poses, cameras, references = _parts(options)
        photos = files_by_key(images, stem_key, _PARTS)
        posed = read_posed_lines(images, photos, poses, cameras, stem_key, progress, crs=_CRS)
        names = posed.photos.names
        metadata = photo_metadata(names, images, options.priors, photos.values(), progress)
        maps, surfaces = find_maps(references)
        move = "leave one in the folder, the others elsewhere"
        made = data_root() / "made" / self.name / f"{scene}-{options.reference}"
        dom, notes = with_georeference(only_one(maps, "orthophoto", references, move), made)
        surface = only_one(surfaces, "surface model", references, move)
        dsm, more = with_georeference(surface, made, heights=True)
        for path in (dom, dsm):
            check_same_crs(_CRS, open_info(path).crs, f"the poses and {path.name}")
        return NativeScene(
            scene,
            images,
            *posed.photos,
            dom=dom,
            dsm=dsm,
            priors=metadata_priors(metadata, _CRS),
            metadata=metadata,
            unposed=posed.unposed,
            notes=(*posed.notes, f"references of {references.name}", *notes, *more),
            poses_from=poses,
        )


def _parts(options: ExtreMatchOptions) -> tuple[Path, ...]:
    """Return photos, poses, cameras and references of the localisation set."""
    home = find_home(options.source, lambda f: sub_path(f, "gt_pose.txt") is not None, _PARTS)
    parts = ("rgb", "gt_pose.txt", "intrinsic.txt", _FOLDERS[options.reference])
    return tuple(needed_path(home, one, _PARTS) for one in parts)


AERIALEXTREMATCH = _AerialExtreMatch()


_SETS = ("test_outPlace", "test_inPlace")
_SAMPLE = re.compile(r"(L\d+)_(R|xDOP|xDOPDSM)\d+")
_SAMPLES = f"{' and '.join(_SETS)}, with samples such as L08_R0000.npz, L08_xDOP0001.npz"
_FIELDS = (
    "image_query and image_dop (H, W, 3) uint8, dsm (H, W, 3), scale (2), extrinsics (3, 4), "
    "intrinsics (3, 3)"
)
_LIMIT_BYTES = 1 << 30
# GeoTIFFs without a CRS are not read; this one has metres near its origin.
_MADE_UP_CRS = "+proj=tmerc +lat_0=0 +lon_0=0 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"
_HALF_PIXEL = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])

_Sample = tuple[tuple[int, int], NDArray[Any], NDArray[Any]]
"""Size of the photo, intrinsics and extrinsics."""


class _OrthoLoc(Dataset[SourceOptions]):
    """The two test sets of OrthoLoC, a scene each."""

    name = "ortholoc"
    about = load_about("ortholoc")
    protocols = ("ortholoc-matching",)

    def scenes(self, options: SourceOptions) -> Mapping[str, Sequence[Path]]:
        def is_home(folder: Path) -> bool:
            return any((folder / name).is_dir() for name in _SETS)

        home = find_home(options.source, is_home, _SAMPLES)
        return {name: [home / name] for name in _SETS if (home / name).is_dir()}

    def read(self, options: SourceOptions, scene: str, progress: Progress) -> NativeScene:
        folder = self.scenes(options)[scene][0]
        paths = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".npz")
        kinds = {path.stem: _SAMPLE.fullmatch(path.stem) for path in paths}
        if not paths or None in kinds.values():
            raise missing("holds no .npz, or others than samples", folder, _SAMPLES)
        stamps = [(str(p.resolve()), p.stat().st_size, p.stat().st_mtime_ns) for p in paths]
        made = data_root() / "made" / self.name / f"{scene}-{fingerprint(stamps)[:16]}"
        read: dict[str, _Sample | None] = {}
        for path in progress(paths, "samples", len(paths)):
            with readable(path, "is no sample", kind=BenchmarkError, expected=_FIELDS):
                read[path.stem] = _read(path, made)
        samples = {name: sample for name, sample in read.items() if sample is not None}
        black = [name for name, sample in read.items() if sample is None]
        names = tuple(f"{name}.png" for name in samples)
        sizes, matrices, extrinsics = (
            np.array(part) for part in zip(*samples.values(), strict=True)
        )
        matches = [match for name, match in kinds.items() if match and name in samples]
        matrices = matrices + _HALF_PIXEL
        cameras = Cameras.from_matrices(matrices, sizes[:, 0], sizes[:, 1], names=names)
        poses = Poses.from_translations(extrinsics[:, :, :3], extrinsics[:, :, 3], names)
        return NativeScene(
            scene,
            made / "photos",
            *PosedPhotos(names, cameras, poses, LOCAL_CRS),
            maps=made / "maps",
            conditions={
                "location": [match[1] for match in matches],
                "domain": [match[2] for match in matches],
            },
            notes=(f"black photos, left out: {first_of(black, len(read))}",) if black else (),
            poses_from=folder,
        )


def _read(path: Path, made: Path) -> _Sample | None:
    """Read a sample and write what is missing of its files; None where its photo is black."""
    file = NpzFile(path, _LIMIT_BYTES)
    photo, dop, dsm, scale = map(file.read, ("image_query", "image_dop", "dsm", "scale"))
    if not photo.any():
        return None
    # dsm has the centres of the map's pixels.
    across, down = scale.astype(np.float64)
    x, y = dsm[0, 0, :2].astype(np.float64) - (across / 2, down / 2)
    transform = Affine(across, 0.0, x, 0.0, down, y)
    files = [made / "photos" / f"{path.stem}.png"]
    files += [made / "maps" / f"{path.stem}_{kind}.tif" for kind in ("dom", "dsm")]
    if not all(one.is_file() for one in files):
        for one in files:
            one.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(files[0]) as stream:
            Image.fromarray(photo).save(stream, "PNG")
        layout = {"crs": _MADE_UP_CRS, "transform": transform, "compress": "deflate", "tiled": True}
        write_geotiff(files[1], np.moveaxis(dop, -1, 0), **layout)
        write_geotiff(files[2], dsm[None, ..., 2], nodata=np.nan, **layout)
    matrix, pose = (file.read(name).astype(np.float64) for name in ("intrinsics", "extrinsics"))
    return (photo.shape[1], photo.shape[0]), matrix, pose


ORTHOLOC = _OrthoLoc()
