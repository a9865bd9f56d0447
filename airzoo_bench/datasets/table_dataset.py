"""Benchmarks that are declared: files of a scene, and tables of poses."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.core.files import data_root
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.validation import nearest
from airzoo_bench.datasets.cameras import attitudes_to_rotations, stated_cameras
from airzoo_bench.datasets.content import metric_crs, photo_sizes, utm_zone
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.metadata import poses_by_name
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos, check_centred
from airzoo_bench.datasets.settings import Convention, SourceOptions, SurveyOptions
from airzoo_bench.datasets.surveys.survey import map_crs, posed_scene
from airzoo_bench.datasets.tables import match_every_row, match_names, read_table
from airzoo_bench.geometry.crs import from_lonlat, grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses, quaternion_to_matrix
from airzoo_bench.protocol.model import find_protocol

_ANGLES, _QUATERNION = ("yaw", "pitch", "roll"), ("qw", "qx", "qy", "qz")
_ORIENTATIONS: dict[Any, tuple[str, ...]] = {
    "gimbal": _ANGLES,
    "airframe": _ANGLES,
    "omega-phi-kappa": ("omega", "phi", "kappa"),
    "world-to-camera": _QUATERNION,
    "camera-to-world": _QUATERNION,
}
_LIMITS = {"lon": 180.0, "lat": 90.0, "x": 1e9, "y": 1e9, "height": 1e9}
_MOST_DEG = 360.0


@dataclass(frozen=True)
class PoseTable:
    """A table with the pose of a photo in each row, separated by comma, semicolon, tab or blanks.

    `path` is relative to the source, with ``{scene}`` for the scene's id. `orientation` says what
    three angles mean, see `datasets.cameras`, or which way a quaternion turns: its camera has x to
    the right, y down and z forward, its world the axes of the CRS. `columns` are the table's names
    of our columns where they differ: ``image``; ``lon`` and ``lat``, or ``x`` and ``y`` where these
    are named; ``height``; and those of the orientation.
    """

    path: str
    orientation: Convention | Literal["world-to-camera", "camera-to-world"]
    columns: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse unknown columns and orientations."""
        known = ("image", *_LIMITS, *_ORIENTATIONS.get(self.orientation, ()))
        strange = [name for name in self.columns if name not in known]
        if strange or self.orientation not in _ORIENTATIONS:
            expected = f"{', '.join(known)}; orientations are {', '.join(_ORIENTATIONS)}"
            what = f"{self.orientation} poses with the columns {', '.join(strange) or 'named'}"
            raise ValueError(f"{self.path}: there are no {what}; columns are {expected}")

    @property
    def is_plane(self) -> bool:
        """Whether it has x and y."""
        return bool({"x", "y"} & self.columns.keys())

    def read(
        self, path: Path, photos: Collection[str], crs: str | None, *, gaps: bool = False
    ) -> tuple[tuple[str, ...], Poses, str]:
        """Return photos, their poses, and the CRS of these; where it may have gaps, of some."""
        place = ("x", "y") if self.is_plane else ("lon", "lat")
        numbers = (*place, "height", *_ORIENTATIONS[self.orientation])
        named = {ours: (self.columns.get(ours, ours),) for ours in ("image", *numbers)}
        table = read_table(path, named, blanks=True)
        table.require_unique("image")
        listed = table.texts("image")
        if gaps or "{scene}" not in self.path:  # it may have photos of other scenes
            found = match_names(listed, photos, path)
        else:
            found = match_every_row(table, "image", photos)
        limits = [(name, _LIMITS.get(name, _MOST_DEG)) for name in numbers]
        columns = [table.numbers(name, -most, most, empty=gaps) for name, most in limits]
        values = np.column_stack(columns)
        whole = np.flatnonzero(np.isfinite(values).all(axis=1)).tolist()
        rows = [row for row in whole if listed[row] in found]
        names, values = tuple(found[listed[row]] for row in rows), values[rows]
        plan, height, turns = values[:, :2], values[:, 2], values[:, 3:]
        if not self.is_plane:
            lonlat, crs = plan, crs or utm_zone(plan)
            plan = from_lonlat(crs, lonlat)
        else:
            crs = crs or ""
            lonlat = to_lonlat(crs, plan)
        if self.orientation == "world-to-camera" or self.orientation == "camera-to-world":
            turned = quaternion_to_matrix(turns, names)
            turned = turned.transpose(0, 2, 1) if self.orientation[0] == "c" else turned
        else:
            is_grid = self.orientation == "omega-phi-kappa"
            north = 0.0 if is_grid else grid_convergence_deg(crs, lonlat)
            turned = attitudes_to_rotations(self.orientation, turns, convergence_deg=north)
        return names, Poses.from_centres(turned, np.column_stack((plan, height)), names), crs


class TableDataset(Dataset[SourceOptions]):
    """A benchmark of scenes with photos, a table of their poses, and maps.

    A subclass states the attributes. Paths are relative to the source, with ``{scene}`` for the
    scene's id.

    Attributes
    ----------
    protocols : tuple of str
        Files of its protocols, whose scenes are those of the benchmark.
    images, dom, dsm, cloud : str or None
        Photos, map, surface model and true cloud.
    poses, priors : PoseTable
        The true poses, and those that matching starts from; None for the photos' metadata.
    crs : str or None
        Of x and y, and of the poses; None for that of the scene's surface model or map where poses
        have x and y, else the UTM zone.
    lens : mapping of str to float
        The camera of all photos, such as ``{"fov_deg": 70}``; see `cameras.lens_of`.
    plane_height_m : float or None
        The ground as a plane, where there is no surface model.

    The last three may be mappings by scene instead.
    """

    images: ClassVar[str] = "{scene}/images"
    poses: ClassVar[PoseTable]
    priors: ClassVar[PoseTable | None] = None
    dom: ClassVar[str | None] = "{scene}/dom.tif"
    dsm: ClassVar[str | None] = "{scene}/dsm.tif"
    cloud: ClassVar[str | None] = None
    crs: ClassVar[str | Mapping[str, str] | None] = None
    lens: ClassVar[Mapping[str, Any]]
    plane_height_m: ClassVar[float | Mapping[str, float] | None] = None

    def __init__(self) -> None:
        """Refuse a declaration that lacks a part; a class that is only extended may."""
        needed = ("name", "about", "protocols", "poses", "lens")
        lacking = [name for name in needed if not getattr(self, name, None)]
        if lacking:
            raise TypeError(f"{type(self).__name__} lacks {', '.join(lacking)}")

    def scenes(self, options: SourceOptions) -> Mapping[str, Sequence[Path]]:
        """Return the protocols' scenes that have a table: all, or some where they are named."""
        every = {name: find_protocol(name, data_root()).scenes for name in self.protocols}
        homes = {one.id: name for name, scenes in every.items() for one in scenes}
        found = {one: self._files(options, one) for one in homes}
        there = {one: [*files.values()] for one, files in found.items() if files["poses"].is_file()}
        lost = [one for one in found if one not in there]
        if not there or (lost and not options.scene):
            path = first = found[lost[0]]["poses"]
            while not first.parent.is_dir():
                first = first.parent
            known = {part for files in found.values() for part in files["poses"].parts}
            others = [one.name for one in first.parent.iterdir() if one.name not in known]
            what = f"lacks the poses of {first_of(lost, len(found), noun='scene')}"
            expected = f"{path}{nearest(first.name, others, 1)}, for a scene of {homes[lost[0]]}"
            fix = "correct the id, or --source, or make the scenes that are there with --scene"
            raise BenchmarkError(what, where=options.source, expected=expected, fix=fix)
        return there

    def _files(self, options: SourceOptions, scene: str) -> dict[str, Path]:
        stated = {name: getattr(self, name) for name in ("images", "dom", "dsm", "cloud")}
        stated |= {"poses": self.poses.path, "priors": self.priors and self.priors.path}
        paths = {one: path.replace("{scene}", scene) for one, path in stated.items() if path}
        return {one: options.source / path for one, path in paths.items()}

    def read(self, options: SourceOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a scene's tables, and the metadata of its photos."""
        files, by = self._files(options, scene), f"class {type(self).__name__}"
        images, path = files["images"], files["poses"]
        parts: dict[str, Any] = {one: files.get(one) for one in ("dom", "dsm", "cloud")}
        values: Any = (self.crs, self.plane_height_m)
        crs, plane = (one.get(scene) if isinstance(one, Mapping) else one for one in values)
        surface = parts["dsm"] or parts["dom"]
        crs_from = f"{by}, crs" if crs or self.poses.is_plane else ""
        if self.poses.is_plane and surface and not crs:
            crs, crs_from = map_crs(surface, None).to_string(), str(surface)
        if crs_from:
            metric_crs(crs or "", crs_from)
        sizes = photo_sizes(images, progress)
        names, poses, crs = self.poses.read(path, sizes, crs)
        lens = self.lens.get(scene, self.lens)
        cameras = stated_cameras(dict.fromkeys(names, lens), sizes, images, f"{by}, lens")
        photos = PosedPhotos(names, cameras, poses, crs)
        check_centred(photos, f"{by}, lens")
        if self.priors is not None:
            given, priors, _ = self.priors.read(files["priors"], names, crs, gaps=True)
            parts["priors"] = poses_by_name(priors, given, names)
        stated = SurveyOptions(options.source, plane_height=plane)
        where = scene, images, sizes, photos, path, progress
        return posed_scene(stated, *where, crs_from=crs_from, **parts)
