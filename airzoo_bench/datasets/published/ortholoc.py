"""OrthoLoC: photos of 47 places, each with its own orthophoto and surface model.

A sample (.npz) becomes a photo, a map and a surface model.
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
from rasterio.io import MemoryFile

from airzoo_bench.core.errors import BenchmarkError, first_of, readable
from airzoo_bench.core.files import atomic_write, data_root, fingerprint
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.published.places import missing
from airzoo_bench.datasets.scenes import NativeScene
from airzoo_bench.datasets.settings import SourceOptions
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.geometry.poses import Poses

_SETS = ("test_outPlace", "test_inPlace")
_SAMPLE = re.compile(r"(L\d+)_(R|xDOP|xDOPDSM)\d+")
_LAYOUT = f"{' and '.join(_SETS)}, with samples such as L08_R0000.npz, L08_xDOP0001.npz"
_FIELDS = (
    "image_query and image_dop (H, W, 3) uint8, dsm (H, W, 3), scale (2), extrinsics (3, 4), "
    "intrinsics (3, 3)"
)
_LIMIT_BYTES = 1 << 30
_OFF_GRID_PX = 0.1
# GeoTIFFs without a CRS are not read; this one has metres near its origin.
_MADE_UP_CRS = "+proj=tmerc +lat_0=0 +lon_0=0 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"
_HALF_PIXEL = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])

_Sample = tuple[tuple[int, int], NDArray[Any], NDArray[Any]]
"""Size of the photo, intrinsics and extrinsics."""


class OrthoLoc(Dataset[SourceOptions]):
    """The two test sets of OrthoLoC, a scene each."""

    name = "ortholoc"
    about = about_of("ortholoc")
    protocols = ("ortholoc-matching",)

    def scenes(self, options: SourceOptions) -> Mapping[str, Sequence[Path]]:
        """Return the test sets: the source, or below it, or below its ``full``."""
        source = options.source
        if source.name in _SETS and source.is_dir():
            return {source.name: [source]}
        for home in (source, source / "full"):
            found = {name: [home / name] for name in _SETS if (home / name).is_dir()}
            if found:
                return found
        raise missing("holds no test set", source, _LAYOUT)

    def read(self, options: SourceOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a set's samples, and write the files that are missing."""
        folder = self.scenes(options)[scene][0]
        paths = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".npz")
        kinds = {path.stem: _SAMPLE.fullmatch(path.stem) for path in paths}
        if not paths or None in kinds.values():
            raise missing("holds no .npz, or others than samples", folder, _LAYOUT)
        stamps = [(str(p.resolve()), p.stat().st_size, p.stat().st_mtime_ns) for p in paths]
        made = data_root() / "made" / self.name / f"{scene}-{fingerprint(stamps)[:16]}"
        read: dict[str, _Sample | None] = {}
        for path in progress(paths, "samples", len(paths)):
            with readable(path, "is no sample", kind=BenchmarkError, expected=_FIELDS):
                read[path.stem] = _read(path, made)
        samples = {name: sample for name, sample in read.items() if sample is not None}
        black = [name for name, sample in read.items() if sample is None]
        if not samples:
            raise BenchmarkError("all photos are black", where=folder)
        names = tuple(f"{name}.png" for name in samples)
        sizes, matrices, extrinsics = (
            np.array(part) for part in zip(*samples.values(), strict=True)
        )
        matches = [match for name, match in kinds.items() if match and name in samples]
        return NativeScene(
            scene,
            made / "photos",
            names,
            Cameras.from_matrices(matrices + _HALF_PIXEL, sizes[:, 0], sizes[:, 1], names=names),
            Poses.from_translations(extrinsics[:, :, :3], extrinsics[:, :, 3], names),
            LOCAL_CRS,
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
    transform = _transform(dsm, scale)
    files = [made / "photos" / f"{path.stem}.png"]
    files += [made / "maps" / f"{path.stem}_{kind}.tif" for kind in ("dom", "dsm")]
    if not all(one.is_file() for one in files):
        for one in files:
            one.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(files[0]) as stream:
            Image.fromarray(photo).save(stream, "PNG")
        _write_raster(files[1], np.moveaxis(dop, -1, 0), transform)
        _write_raster(files[2], dsm[None, ..., 2], transform, nodata=np.nan)
    matrix, pose = (file.read(name).astype(np.float64) for name in ("intrinsics", "extrinsics"))
    return (photo.shape[1], photo.shape[0]), matrix, pose


def _transform(dsm: NDArray[Any], scale: NDArray[Any]) -> Affine:
    """Return the geotransform of a sample's map, whose grid must be the one that dsm has."""
    step, first = scale.astype(np.float64), dsm[0, 0, :2].astype(np.float64)
    rows, columns = np.indices(dsm.shape[:2])
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.abs((dsm[..., :2] - first) / step - np.stack((columns, rows), axis=-1))
    if not np.isfinite(off).any() or not np.nanmax(off) <= _OFF_GRID_PX:
        raise ValueError(f"x and y of dsm do not lie on the grid of scale {scale}")
    (x, y), (across, down) = first - step / 2, step
    return Affine(across, 0.0, x, 0.0, down, y)


def _write_raster(
    path: Path, bands: NDArray[Any], transform: Affine, nodata: float | None = None
) -> None:
    count, height, width = bands.shape
    profile = {"count": count, "height": height, "width": width, "dtype": bands.dtype}
    profile |= {"crs": _MADE_UP_CRS, "transform": transform, "nodata": nodata}
    with MemoryFile() as memory:
        with memory.open(driver="GTiff", compress="deflate", tiled=True, **profile) as raster:
            raster.write(bands)
        with atomic_write(path) as stream:
            stream.write(memory.getbuffer())


ORTHOLOC = OrthoLoc()
