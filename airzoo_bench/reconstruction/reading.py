"""Predictions of the reconstruction track: a folder or an archive with an entry a scene.

::

    protocol.txt            the protocol's name, so that no --protocol is needed (optional)
    school.ply              a cloud or mesh of the scene "school"
    school.cameras.npz      its cameras: image_names, extrinsics (optional; aligning needs them)
    plaza.npz               depth maps or point maps with cameras, or a cloud
    substation/cloud.laz    or a folder a scene, with one such file
    substation/cameras.npz
    harbour/shards/*.laz    or a cloud in shards (.las, .laz), in the order of their names

A file alone is a prediction of one scene, named as the file is. A folder within an archive that
holds all the rest is stepped over. Files as methods write them come from readers, as
`NativeScenes`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from airzoo_bench.core.errors import PredictionError, UnreadableError, first_of
from airzoo_bench.evaluation.track import ScenePredictions
from airzoo_bench.formats.archives import ARCHIVE_SUFFIXES, Bundle, Member, open_bundle
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.formats.clouds.meshes import MeshSampling
from airzoo_bench.formats.clouds.shards import SHARD_SUFFIXES, open_shards
from airzoo_bench.formats.clouds.suffixes import KINDS, SUFFIXES, TEXT_SUFFIXES
from airzoo_bench.reconstruction.depth_map_files import ScenePrediction, holds_maps, read_maps
from airzoo_bench.reconstruction.image_poses import BYTES_A_CAMERA, read_image_poses

__all__ = ["ListedFiles", "NativeScenes", "open_reconstruction"]

_PROTOCOL = "protocol.txt"
_PROTOCOL_BYTES = 1024
_LONGEST_PROTOCOL = 64
_CAMERAS = "cameras.npz"
_SHARDS = "shards"


@dataclass(frozen=True)
class _Entry:
    geometry: tuple[Member, ...]
    cameras: Member | None

    @property
    def shards(self) -> PurePosixPath | None:
        """The folder of the shards, where the geometry is in some."""
        home = PurePosixPath(self.geometry[0].name).parent
        return home if home.name == _SHARDS else None


@dataclass(frozen=True)
class NativeScenes(ScenePredictions):
    """What a method wrote of each scene.

    Attributes
    ----------
    places : mapping of str to Path
        A file or folder by scene.
    read_scene : callable
        Given such a place and the bytes that it may take in memory, reads it.
    """

    path: Path
    places: Mapping[str, Path]
    read_scene: Callable[[Path, int], ScenePrediction]
    unknown_files: tuple[str, ...] = ()
    protocol: str | None = None

    @property
    def scenes(self) -> tuple[str, ...]:
        """Scenes that a method wrote something of, by name."""
        return tuple(sorted(self.places))

    @contextmanager
    def opened(
        self, scene: str, *, limit_bytes: int, sampling: MeshSampling | None
    ) -> Iterator[ScenePrediction]:
        """See `ScenePredictions.opened`."""
        yield self.read_scene(self.places[scene], limit_bytes)


@dataclass(frozen=True)
class ListedFiles(ScenePredictions):
    """Entries, by scene, of a folder or an archive, as `open_reconstruction` lists them."""

    path: Path
    protocol: str | None
    entries: dict[str, _Entry]
    unknown_files: tuple[str, ...]
    _bundle: Bundle

    @property
    def scenes(self) -> tuple[str, ...]:
        """Scenes that there is an entry of, by name."""
        return tuple(self.entries)

    @contextmanager
    def opened(
        self, scene: str, *, limit_bytes: int, sampling: MeshSampling | None
    ) -> Iterator[ScenePrediction]:
        """See `ScenePredictions.opened`."""
        entry = self.entries[scene]
        images = None
        if entry.cameras is not None:
            with self._bundle.file(entry.cameras) as path:
                images = read_image_poses(path, limit_bytes)
            limit_bytes -= len(images.names) * BYTES_A_CAMERA
        if entry.shards is not None:
            with ExitStack() as stack:
                paths = [stack.enter_context(self._bundle.file(one)) for one in entry.geometry]
                cloud = open_shards(self.path / entry.shards, paths)
                yield ScenePrediction(cloud, images, cloud.notes)
            return
        (geometry,) = entry.geometry
        with self._bundle.file(geometry) as path:
            if path.suffix.lower() != ".npz" or not holds_maps(path, limit_bytes):
                cloud = open_cloud(path, limit_bytes=limit_bytes, sampling=sampling)
                yield ScenePrediction(cloud, images, cloud.notes)
                return
            views = read_maps(path, limit_bytes)
            if views.images is not None and images is not None:
                raise PredictionError(
                    f"holds extrinsics, and so does {entry.cameras.name if entry.cameras else ''}",
                    where=f"{self.path}, {geometry.name}",
                    fix="keep one of the two",
                )
            yield replace(views, images=views.images or images)


def open_reconstruction(path: Path, *, unpacked_limit_bytes: int) -> ListedFiles:
    """List what a prediction holds: a folder, a zip or tar archive, or one file of a scene."""
    if path.is_file() and path.name.lower().endswith(SUFFIXES):
        member = Member(path.name, path.stat().st_size)
        entries = {path.stem: _Entry((member,), None)}
        return ListedFiles(path, None, entries, (), Bundle(path.parent, (member,)))
    bundle = open_bundle(path, unpacked_limit_bytes)
    wrapper = _wrapper(bundle.members)
    geometry: dict[str, Member] = {}
    texts: dict[str, Member] = {}
    cameras: dict[str, Member] = {}
    shards: dict[str, list[Member]] = {}
    protocol, unknown_files = None, []
    for member in bundle.members:
        name = member.name.removeprefix(wrapper)
        scene, is_camera = _scene(name)
        if name == _PROTOCOL:
            protocol = _protocol(bundle, member)
        elif (whole := _scene_of_shard(name)) is not None:
            shards.setdefault(whole, []).append(member)
        elif scene is None:
            unknown_files.append(name)
        else:
            kind = cameras if is_camera else texts if _is_text(name) else geometry
            _add(path, kind, scene, member)
    for scene, (first, *_) in shards.items():
        _add(path, geometry, scene, first)
    unknown_files += [texts[scene].name for scene in texts if scene in geometry]
    geometry = texts | geometry
    unknown_files += [cameras[scene].name for scene in cameras if scene not in geometry]
    entries = {
        scene: _Entry(tuple(shards.get(scene, (one,))), cameras.get(scene))
        for scene, one in sorted(geometry.items())
    }
    if not entries:
        raise _no_entries(path, unknown_files)
    return ListedFiles(path, protocol, entries, tuple(unknown_files), bundle)


def _wrapper(members: tuple[Member, ...]) -> str:
    """Return the folder, with its slash, that holds everything and is no scene; or nothing."""
    tops = {member.name.partition("/")[0] for member in members}
    if len(tops) != 1 or any("/" not in member.name for member in members):
        return ""
    prefix = f"{tops.pop()}/"
    rest = [member.name.removeprefix(prefix) for member in members]
    files = [name for name in rest if name.lower().endswith(SUFFIXES) and name != _CAMERAS]
    files = [name for name in files if not _is_text(name)] or files
    if any(_scene_of_shard(member.name) for member in members):
        return ""
    is_scene = len(files) == 1 and "/" not in files[0] and _PROTOCOL not in rest
    return "" if is_scene else prefix


def _is_text(name: str) -> bool:
    """Say whether it may as well be a remark: beside another cloud of its scene it is not read."""
    return name.lower().endswith(TEXT_SUFFIXES)


def _scene(name: str) -> tuple[str | None, bool]:
    """Return the scene that a file belongs to, and whether it holds cameras."""
    path = PurePosixPath(name)
    if not name.lower().endswith(SUFFIXES) or len(path.parts) > 2:
        return None, False
    if len(path.parts) == 2:
        return path.parts[0], path.name == _CAMERAS
    if name.endswith(f".{_CAMERAS}"):
        return name.removesuffix(f".{_CAMERAS}"), True
    return path.stem, False


def _scene_of_shard(name: str) -> str | None:
    scene, *folder = PurePosixPath(name).parent.parts or ("",)
    return scene if folder == [_SHARDS] and name.lower().endswith(SHARD_SUFFIXES) else None


def _add(path: Path, members: dict[str, Member], scene: str, member: Member) -> None:
    if scene in members:
        raise PredictionError(
            f"scene {scene!r} has two entries: {members[scene].name} and {member.name}",
            where=path,
            expected="one cloud, mesh or npz a scene (and, if you like, its cameras.npz)",
            fix="keep one of the two",
        )
    members[scene] = member


def _protocol(bundle: Bundle, member: Member) -> str:
    name = bundle.text(member, _PROTOCOL_BYTES).strip()
    plain = name.isprintable() and not set(name) & set("/\\ ") and not name.endswith(".toml")
    if not (plain and 0 < len(name) <= _LONGEST_PROTOCOL):
        # A file from a stranger must not choose which file of this computer is read.
        raise PredictionError(
            f"the protocol {name[:80]!r} is no protocol's name",
            where=f"{bundle.path}, {member.name}",
            expected="a line with a name, such as airzoo-real-reconstruction",
            fix="name a protocol's file with --protocol",
        )
    return name


def _no_entries(path: Path, unknown_files: list[str]) -> UnreadableError:
    there = f" (there are {first_of(unknown_files)})" if unknown_files else ""
    endings = sorted({PurePosixPath(name).suffix[:20] for name in unknown_files} - {"", *SUFFIXES})
    unread = [f"endings such as {one!r} are not read: write a cloud as .ply" for one in endings]
    return UnreadableError(
        f"holds no cloud, mesh or npz{there}",
        where=path,
        expected=f"an entry a scene, such as school.ply or school/cloud.ply; endings "
        f"{KINDS}, archives {', '.join(ARCHIVE_SUFFIXES)}",
        fix=unread[0] if unread else "name the files by their scenes",
    )
