"""Benchmarks that are declared: files of a scene, and columns of a table of poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, get_args

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import data_root
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.cameras import (
    attitudes_to_rotations,
    cameras_of_lenses,
    lens_of,
)
from airzoo_bench.datasets.content import photo_sizes, utm_zone
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.metadata import metadata_priors, photo_metadata
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos
from airzoo_bench.datasets.settings import Convention, SourceOptions
from airzoo_bench.datasets.tables import match_names, read_table
from airzoo_bench.geometry.crs import from_lonlat, grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.protocol.model import find_protocol


class TableDataset(Dataset[SourceOptions]):
    """A benchmark of scenes with photos, a table of their poses, and maps.

    A subclass states the attributes. Paths are relative to the source, with ``{scene}`` for the
    scene's id.

    Attributes
    ----------
    protocols : tuple of str
        Files of its protocols, whose scenes are those of the benchmark.
    images, table, dom, dsm, cloud : str or None
        Photos, poses, map, surface model and true cloud.
    columns : mapping of str to str
        The table's names of our columns: ``image``; ``lon`` and ``lat``, or ``x`` and ``y``;
        ``height``; ``first``, ``second`` and ``third`` angle in the order of `angles`.
    angles : str
        What the angles mean, see `angles.attitudes_to_rotations`.
    crs : str or None
        Of x and y, and of the poses; None for the UTM zone of lon and lat.
    lens : mapping of str to float
        The camera of all photos, such as ``{"fov_deg": 70}``; see `lenses.lens_of`.
    plane_height_m : float or None
        The ground as a plane, where there is no surface model.
    """

    images: ClassVar[str] = "{scene}/images"
    table: ClassVar[str] = "{scene}/poses.csv"
    dom: ClassVar[str | None] = "{scene}/dom.tif"
    dsm: ClassVar[str | None] = "{scene}/dsm.tif"
    cloud: ClassVar[str | None] = None
    columns: ClassVar[Mapping[str, str]]
    angles: ClassVar[Convention] = "gimbal"
    crs: ClassVar[str | None] = None
    lens: ClassVar[Mapping[str, float]]
    plane_height_m: ClassVar[float | None] = None

    def __init_subclass__(cls) -> None:
        """Refuse a declaration that lacks a part, or has unknown angles."""
        lacking = {"image", "height", "first", "second", "third"} - {*getattr(cls, "columns", ())}
        if lacking or cls.angles not in get_args(Convention) or not hasattr(cls, "lens"):
            known = ", ".join(get_args(Convention))
            parts = f"`columns` with {', '.join(sorted(lacking))}, " if lacking else ""
            raise TypeError(f"{cls.__name__} needs {parts}`lens`, and `angles` of {known}")

    def scenes(self, options: SourceOptions) -> Mapping[str, Sequence[Path]]:
        """Return the protocols' scenes that have a table."""
        every = [find_protocol(name, data_root()).scenes for name in self.protocols]
        ids = dict.fromkeys(scene.id for scenes in every for scene in scenes)
        found = {one: list(self._files(options, one).values()) for one in ids}
        there = {one: files for one, files in found.items() if files[1].is_file()}
        if not there:
            raise BenchmarkError(
                "holds no scene",
                where=options.source,
                expected=f"{self.table} of {', '.join(ids)}",
                fix="name the folder as it was downloaded and unpacked",
            )
        return there

    def _files(self, options: SourceOptions, scene: str) -> dict[str, Path]:
        names = ("images", "table", "dom", "dsm", "cloud")
        stated = {name: getattr(self, name) for name in names}
        return {
            name: options.source / str(path).format(scene=scene)
            for name, path in stated.items()
            if path is not None
        }

    def read(self, options: SourceOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a scene's table, and the priors of its photos' metadata."""
        files = self._files(options, scene)
        images, path = files["images"], files["table"]
        table = read_table(path, {ours: (name,) for ours, name in self.columns.items()})
        table.require_unique("image")
        sizes = photo_sizes(images, progress)
        found = match_names(table.texts("image"), sizes, path)
        rows = [row for row, name in enumerate(table.texts("image")) if name in found]
        names = tuple(found[table.texts("image")[row]] for row in rows)
        angles = table.columns(("first", "second", "third"), -360.0, 360.0)[rows]
        if table.has("lon", "lat"):
            lon, lat = table.numbers("lon", -180.0, 180.0), table.numbers("lat", -90.0, 90.0)
            lonlat = np.stack((lon, lat), axis=-1)[rows]
            crs = self.crs or utm_zone(lonlat)
            plan = from_lonlat(crs, lonlat)
        else:
            plan, crs = table.columns(("x", "y"))[rows], self.crs or ""
            lonlat = to_lonlat(crs, plan)
        north = 0.0 if self.angles == "omega-phi-kappa" else grid_convergence_deg(crs, lonlat)
        rotations = attitudes_to_rotations(self.angles, angles, convergence_deg=north)
        centres = np.column_stack((plan, table.numbers("height")[rows]))
        metadata = photo_metadata(names, images, None, sizes, progress)
        lenses = [lens_of(self.lens, sizes[name], path) for name in names]
        cameras = cameras_of_lenses(lenses, names, sizes)
        return NativeScene(
            scene,
            images,
            *PosedPhotos(names, cameras, Poses.from_centres(rotations, centres, names), crs),
            dom=files.get("dom"),
            dsm=files.get("dsm"),
            cloud=files.get("cloud"),
            plane_height_m=self.plane_height_m,
            priors=metadata_priors(metadata, crs),
            metadata=metadata,
            unposed=tuple(sorted(set(sizes) - set(names))),
            poses_from=path,
        )
