"""AirZoo-Real: two survey regions for retrieval and matching, four sites for reconstruction.

What the files of ``Scene1`` (City) and ``Scene2`` (Rural) are called is not known, so they are told
by their kind: photos, rasters of colours and of heights, and DJI's tables of RTK positions (.MRK).

::

    airzoo_real_recon/<site>/<hours>/images/{i}_0.png       photos (_1, _2: other renderings)
                                    /poses/poses/t_pose.txt  name qw qx qy qz tx ty tz
                                    /poses/intrinsics/t_intrinsic.txt
                     /dom/fcw_hangtian_DSM.tif               heights, 0.5 m a pixel

Poses of sites are world-to-camera with OpenGL's camera axes; cameras are written for photos of
4032x3024 while those that are there have a quarter of that size.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.files import data_root
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.metadata import (
    metadata_priors,
    photo_metadata,
    priors_to_poses,
    read_prior_file,
)
from airzoo_bench.datasets.published.places import (
    files_by_key,
    find_home,
    find_maps,
    missing,
    needed_path,
    only_one,
    published_scenes,
    read_posed_lines,
    stem_key,
    sub_path,
    with_georeference,
)
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos
from airzoo_bench.datasets.settings import AirZooRealOptions
from airzoo_bench.datasets.surveys.dji import (
    photo_cameras,
    photo_time_stamps,
    read_tags,
    true_positions,
)
from airzoo_bench.datasets.tables import values_by_scene
from airzoo_bench.datasets.truths import BenchmarkProtocols, variant_of
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from airzoo_bench.geometry.rasters import gsd_m, open_info, pixel_to_world
from airzoo_bench.matching.protocol import MatchingProtocol
from airzoo_bench.protocol.model import protocol_of_track
from airzoo_bench.retrieval.settings import RetrievalProtocol

_CRS = "EPSG:4547"
_REGIONS: Mapping[str, str] = {"City": "Scene1", "Rural": "Scene2"}
_SITES: Mapping[str, str] = {
    "school": "xuexiao",
    "driving-school": "jiaxiao",
    "substation": "biandian",
    "plaza": "guangchang",
}
_RECON = "airzoo_real_recon"
_SURFACE = "fcw_hangtian_DSM.tif"
_OPENGL = (1.0, -1.0, -1.0)
_REACH_M = 500.0  # of surface model about the cameras, which becomes the true cloud
# As `matching.truth` tells priors that are the truth.
_SAME_M, _SAME_DEG = 0.02, 0.1
_LAYOUT = (
    "Scene1/ (City) and Scene2/ (Rural), each with photos, a DOM, a DSM and RTK tables, and "
    f"{_RECON}/{{{','.join(_SITES.values())}}}/06-08/images, poses/poses/t_pose.txt, "
    "poses/intrinsics/t_intrinsic.txt"
)


class _AirZooReal(Dataset[AirZooRealOptions]):
    """AirZoo's own flights."""

    name = "airzoo-real"
    about = load_about("airzoo-real")
    options = AirZooRealOptions

    def benchmark_protocols(self, options: AirZooRealOptions, root: Path) -> BenchmarkProtocols:
        matching = protocol_of_track(f"{self.name}-matching", root, MatchingProtocol)
        if options.prior == "truth":
            changes = {"prior": {"source": "truth"}}
            return BenchmarkProtocols((variant_of(matching, f"{self.name}-truth-prior", changes),))
        wanted = options.scene or list(self.scenes(options))
        regions = [scene for scene in wanted if scene in _REGIONS]
        maps = [_maps(options, scene)[0].get("satellite") for scene in regions]
        names = ["retrieval"] * bool(maps and None not in maps) + ["matching"] * bool(regions)
        names += ["reconstruction"] * (len(wanted) > len(regions))
        return BenchmarkProtocols.find([f"{self.name}-{track}" for track in names], root)

    def scenes(self, options: AirZooRealOptions) -> Mapping[str, Sequence[Path]]:
        home, found = _home(options), {}
        for scene, folder in _REGIONS.items():
            part = sub_path(home, folder)
            if part is not None:
                found[scene] = [part, *map(Path, _files_by_option(options, scene).values())]
        for scene in published_scenes(f"{self.name}-reconstruction"):
            site = _site_folder(home, scene)
            if site is not None and options.prior == "metadata":
                parts = (site, _surface(home, site), _cloud_by_option(options, scene))
                found[scene] = [part for part in parts if part is not None]
        return found

    def read(self, options: AirZooRealOptions, scene: str, progress: Progress) -> NativeScene:
        if scene in _REGIONS:
            return _read_region(options, scene, progress)
        return _read_site(options, scene, progress)


def _home(options: AirZooRealOptions) -> Path:
    parts = (*_REGIONS.values(), _RECON, *_SITES.values())
    return find_home(options.source, lambda f: any(sub_path(f, part) for part in parts), _LAYOUT)


def _files_by_option(options: AirZooRealOptions, scene: str) -> dict[str, Path]:
    """Return the files that the user names for a region, by option."""
    names = ("dom", "dsm", "satellite", "priors")
    given = {n: values_by_scene(getattr(options, n), n, list(_REGIONS)).get(scene) for n in names}
    return {name: Path(file) for name, file in given.items() if file is not None}


def _cloud_by_option(options: AirZooRealOptions, scene: str) -> Path | None:
    """Return the true cloud that the user names for a scene."""
    known = published_scenes("airzoo-real-reconstruction")
    file = values_by_scene(options.cloud, "cloud", known).get(scene)
    return None if file is None else Path(file)


def _maps(options: AirZooRealOptions, scene: str) -> tuple[dict[str, Path], list[str]]:
    """Return DOM, surface model and retrieval's map, each with its georeference, and notes."""
    home = needed_path(_home(options), _REGIONS[scene], _LAYOUT)
    given, made = _files_by_option(options, scene), data_root() / "made" / "airzoo-real" / scene
    maps, surfaces = find_maps(home)
    protocol = protocol_of_track("airzoo-real-retrieval", data_root(), RetrievalProtocol)
    gallery = protocol.map_rules()[0]
    gsd = 0.0 if isinstance(gallery.gsd_m, str) else gallery.gsd_m

    def fits(path: Path) -> bool:
        sides = gsd_m(open_info(with_georeference(path, made)[0]))
        return all(abs(side / gsd - 1.0) <= gallery.gsd_tolerance for side in sides)

    fitting = [path for path in maps if fits(path)]
    satellite = given.get("satellite")
    if satellite is None and fitting:
        satellite = only_one(fitting, "satellite map", home, f"name it: --satellite {scene}=FILE")
    others = [path for path in maps if path not in (*fitting, satellite)]
    doms = maps if len(maps) == 1 else others
    dom = given.get("dom") or only_one(doms, "map (DOM)", home, f"name it: --dom {scene}=FILE")
    dsm = given.get("dsm") or only_one(
        surfaces, "surface model", home, f"name it: --dsm {scene}=FILE"
    )
    of_retrieval = f"no map has {gsd:g} m a pixel: retrieval has no truth"
    if satellite is not None:
        of_retrieval = f"{satellite.name} is the map of retrieval"
    notes = [f"{dom.name} is the DOM, {dsm.name} the surface model; {of_retrieval}"]
    found = {}
    for what, path in (("dom", dom), ("dsm", dsm), ("satellite", satellite)):
        if path is not None:
            found[what], said = with_georeference(path, made, heights=what == "dsm")
            notes += [one for one in said if one not in notes]
    return found, notes


def _read_region(options: AirZooRealOptions, scene: str, progress: Progress) -> NativeScene:
    """Read photos, cameras and true positions of a region."""
    maps, notes = _maps(options, scene)
    home = needed_path(_home(options), _REGIONS[scene], _LAYOUT)
    given = _files_by_option(options, scene)
    every = sorted(p for p in home.rglob("*") if p.suffix.lower() in (".jpg", ".jpeg"))
    photos = [path.relative_to(home).as_posix() for path in every if path.name[0] != "."]
    if not photos:
        raise missing("holds no photo", home, "the drone's photos as .JPG")
    sizes = {name: photo_size(home / name) for name in progress(photos, "photos", len(photos))}
    stated = photo_metadata(photos, home, None, sizes, progress)
    table = read_prior_file(given["priors"], sizes) if "priors" in given else {}
    metadata = {name: replace(stated[name], **table.get(name, {})) for name in photos}
    tags = {name: read_tags(home / name, size) for name, size in sizes.items()}
    stamps, said = photo_time_stamps(home, home, stated)
    truth, more = true_positions(stated, tags, stamps, home)
    notes += [*said, *more]
    notes.append("true orientations are the gimbal's, and not trusted")
    own_sizes, fix = {name: sizes[name] for name in truth}, "download the photos as they were taken"
    cameras, of_cameras = photo_cameras(home, own_sizes, tags, None, fix)
    poses, own = priors_to_poses(truth, _CRS), {name: metadata[name] for name in truth}
    priors = metadata_priors(own, _CRS)
    notes += of_cameras
    if priors is not None:
        priors = _unlike_truth(priors, poses, notes)
    satellite = maps.get("satellite")
    return NativeScene(
        scene,
        home,
        *PosedPhotos(tuple(truth), cameras, poses, _CRS),
        dom=maps["dom"],
        dsm=maps["dsm"],
        gallery=None if satellite == maps["dom"] else satellite,
        priors=priors,
        metadata=own,
        unposed=tuple(name for name in photos if name not in truth),
        notes=tuple(notes),
        poses_from=home,
    )


def _unlike_truth(priors: Poses, poses: Poses, notes: list[str]) -> Poses | None:
    """Return priors as they are, none where most of them are the truth."""
    apart = np.linalg.norm(priors.centres - poses.centres, axis=1)
    turned = rotation_angle_deg(priors.rotation, poses.rotation)
    same = int(((apart < _SAME_M) & (turned < _SAME_DEG)).sum())
    if 2 * same <= len(poses):
        return priors
    notes.append(
        f"the photos' own metadata are the truth in {same} of {len(poses)} photos, and so no "
        "prior: matching has no truth. --priors gives others; --prior truth crops by the truth, "
        "as a benchmark of another name"
    )
    return None


def _site_and_hours(scene: str) -> tuple[str, str]:
    site, first, last = scene.rsplit("-", 2)
    return site, f"{first}-{last}"


def _site_folder(home: Path, scene: str) -> Path | None:
    """Return the folder of a scene such as "school-06-08"; None where it is not there."""
    site, hours = _site_and_hours(scene)
    return sub_path(sub_path(home, _RECON) or home, _SITES[site], hours)


def _surface(home: Path, site: Path) -> Path | None:
    """Return the surface model of all sites."""
    return sub_path(site.parent.parent, "dom", _SURFACE) or sub_path(home, "dom", _SURFACE)


def _read_site(options: AirZooRealOptions, scene: str, progress: Progress) -> NativeScene:
    """Read the photos, cameras and poses of a site at some hours, and its true cloud."""
    home = _home(options)
    site = _site_folder(home, scene) or home
    images, poses, cameras = (
        needed_path(site, place, _LAYOUT)
        for place in ("images", "poses/poses/t_pose.txt", "poses/intrinsics/t_intrinsic.txt")
    )
    own = sorted(p.name for p in images.iterdir() if re.fullmatch(r"[^.].*_0\.png", p.name, re.I))
    photos = files_by_key(images, _photo_key, "files such as 0_0.png, 1_0.png", own)
    posed = read_posed_lines(
        images,
        dict(sorted(photos.items(), key=lambda pair: pair[1])),
        poses,
        cameras,
        _photo_key,
        progress,
        crs=_CRS,
        axes=_OPENGL,
        # Lines of the other renderings, <name>_1 and <name>_2.
        is_other=lambda key, known: key[:-2] in known and key[-2:] in ("_1", "_2"),
    )
    cloud, notes = _cloud_by_option(options, scene), list(posed.notes)
    dsm = _surface(home, site)
    if dsm is not None:
        dsm, said = with_georeference(dsm, data_root() / "made" / "airzoo-real", heights=True)
        notes += said
    if cloud is None:
        if dsm is None:
            fix = "download it too, or name a true cloud: --cloud SCENE=FILE"
            what = f"there is no dom/{_SURFACE} to make the true cloud of"
            raise missing(what, site.parent.parent, f"{_RECON}/dom/{_SURFACE}", fix)
        cloud = _surface_cloud(dsm, posed.photos.poses.centres, scene)
        notes.append(
            f"the true cloud is made of dom/{_SURFACE}, one point a pixel within "
            f"{_REACH_M:g} m of the cameras; it has no facades and nothing below a roof "
            "or a crown; --cloud names another"
        )
    hours = _site_and_hours(scene)[1]
    return NativeScene(
        scene,
        images,
        *posed.photos,
        dsm=dsm,
        cloud=cloud,
        unposed=posed.unposed,
        notes=tuple(notes),
        poses_from=poses,
        conditions={"hours": [hours] * len(posed.photos.names)},
    )


def _photo_key(name: str) -> str:
    """Return what a name says of a photo, whether it is written as 12, 12_0 or images/12_0.png."""
    return stem_key(name).removesuffix("_0")


def _surface_cloud(dsm: Path, centres: Floats, scene: str) -> Path:
    """Write the heights of a surface model around cameras as a cloud, one point a pixel."""
    low, high = centres[:, :2].min(axis=0) - _REACH_M, centres[:, :2].max(axis=0) + _REACH_M
    field = HeightField.read(dsm, (*low.tolist(), *high.tolist()))
    rows, columns = np.nonzero(np.isfinite(field.heights))
    places = pixel_to_world(field.transform, np.stack((columns, rows), axis=1) + 0.5)
    inside = ((places >= low) & (places <= high)).all(axis=1)
    heights = field.heights[rows, columns].astype(np.float64)
    points = np.column_stack((places, heights))[inside]
    target = data_root() / "made" / "airzoo-real" / f"{scene}-dsm-{_REACH_M:g}m.ply"
    target.parent.mkdir(parents=True, exist_ok=True)
    write_ply(target, Cloud(points))
    return target


AIRZOO_REAL = _AirZooReal()
