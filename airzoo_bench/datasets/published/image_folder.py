"""Making the benchmark folder of a benchmark that gives images."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.manifest import SceneFile
from airzoo_bench.benchmark.queries import write_queries
from airzoo_bench.core.errors import BenchmarkError, UserError, counted
from airzoo_bench.core.files import atomic_folder
from airzoo_bench.core.progress import Progress, shown, silent
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings, SceneSummary
from airzoo_bench.datasets.folder import write_folder_files
from airzoo_bench.datasets.native import NativeOptions, files_among
from airzoo_bench.datasets.native_prepare import chosen_scenes
from airzoo_bench.datasets.published.image_scene import ImageLayout, ImageScene
from airzoo_bench.datasets.scene_parts import SceneSource
from airzoo_bench.datasets.scene_tasks import made_scenes
from airzoo_bench.datasets.sources import check_target
from airzoo_bench.datasets.summary import retrieval_summary
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.protocol.model import ProtocolScene
from airzoo_bench.retrieval.prepare import PreparedScene
from airzoo_bench.retrieval.settings import RetrievalProtocol, StatedTruth
from airzoo_bench.retrieval.stated_truth import build_truth
from airzoo_bench.retrieval.truth import read_truth, write_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["is_prepared", "prepare_images"]


def prepare_images(
    dataset: ImageLayout, options: NativeOptions, settings: PrepareSettings
) -> Prepared:
    """Make the benchmark folder, with each protocol whose scenes are there."""
    check_target((options.source,), settings.folder)
    root = dataset.root(options.source)
    if root != options.source:
        settings.note(f"taken from {root}")
    wanted = _wanted(dataset, options)
    scenes, failed = _read_scenes(dataset, root, wanted, options, settings)
    if settings.tiles_on_disk:
        settings.note("the images of the gallery are files already: none was written")
    served = _of_scenes([_protocol(name) for name in dataset.protocols], list(scenes))
    if served[0].benchmark != dataset.name and settings.folder.name == dataset.name:
        folder = settings.folder.with_name(served[0].benchmark)
        settings = replace(settings, folder=folder)
    shown(partial(_write, served, scenes, settings), "writing the folder", settings.progress)
    return Prepared(
        settings.folder,
        {protocol.name: protocol.track for protocol in served},
        {
            scene: SceneSummary(
                len(_photos(prepared)),
                tracks={"retrieval": retrieval_summary(prepared.truth)},
                warnings=tuple(_counts(dataset, wanted[scene], scene, prepared)),
                notes=native.notes,
            )
            for scene, (native, prepared) in scenes.items()
        },
        failed=failed,
    )


def is_prepared(dataset: ImageLayout, options: NativeOptions, settings: PrepareSettings) -> bool:
    """Whether the folder holds the truth that would be made now."""
    if not (settings.folder / "benchmark.toml").is_file():
        return False
    benchmark = Benchmark.open(settings.folder)
    wanted = _wanted(dataset, options)
    if {scene.id for scene in benchmark.file.scenes} != set(wanted):
        return False
    root = dataset.root(options.source)
    scenes, failed = _read_scenes(dataset, root, wanted, options, settings)
    made = {scene: prepared.truth for scene, (_, prepared) in scenes.items()}
    if failed:
        return False
    there = {scene: read_truth(benchmark.scene_folder(scene), scene) for scene in made}
    return all(
        made[scene].fingerprint == truth.fingerprint
        and made[scene].queries["image"].equals(truth.queries["image"])
        for scene, truth in there.items()
    )


def _wanted(dataset: ImageLayout, options: NativeOptions) -> dict[str, RetrievalProtocol]:
    """Return the scenes that were asked for, each with its protocol."""
    protocols = [_protocol(name) for name in dataset.protocols]
    by_scene = {scene.id: protocol for protocol in protocols for scene in protocol.scenes}
    chosen = chosen_scenes(list(by_scene), options.scene, options.source)
    return {scene: by_scene[scene] for scene in chosen}


def _read_scenes(
    dataset: ImageLayout,
    root: Path,
    wanted: Mapping[str, RetrievalProtocol],
    options: NativeOptions,
    settings: PrepareSettings,
) -> tuple[dict[str, tuple[ImageScene, PreparedScene]], dict[str, str]]:
    """Read the scenes and make their truth; also say why some could not be made."""
    read, files = partial(_read_scene, dataset, wanted), partial(files_among, options)
    source = SceneSource(tuple(wanted), read, files, options, options.keep_going)
    make = partial(source.native, progress=silent)
    made = made_scenes(make, source, source.scenes, settings)
    found, failed = {}, {}
    for scene, one in made:
        if isinstance(one, UserError):
            failed[scene] = str(one)
        else:
            found[scene] = one
    if not found:
        raise BenchmarkError("no scene could be made:\n" + "\n".join(failed.values()), where=root)
    return found, failed


def _read_scene(
    dataset: ImageLayout,
    wanted: Mapping[str, RetrievalProtocol],
    options: NativeOptions,
    scene: str,
    progress: Progress,
) -> tuple[ImageScene, PreparedScene]:
    del progress
    native = dataset.read(dataset.root(options.source), scene)
    return native, _truth(scene, native, wanted[scene])


def _protocol(name: str) -> RetrievalProtocol:
    found = load_protocol(shipped_protocols()[name])
    if not isinstance(found, RetrievalProtocol):
        raise TypeError(f"{name} is no protocol of the retrieval track")
    return found


def _truth(scene: str, native: ImageScene, protocol: RetrievalProtocol) -> PreparedScene:
    rules = protocol.ground_truth
    if not isinstance(rules, StatedTruth):
        raise TypeError(f"{protocol.name} has a truth by geometry")
    return build_truth(scene, native.queries, native.gallery, native.pairs, rules)


def _counts(
    dataset: ImageLayout, protocol: RetrievalProtocol, scene: str, prepared: PreparedScene
) -> list[str]:
    """Compare the numbers of queries and images with the published ones."""
    published: ProtocolScene = next(one for one in protocol.scenes if one.id == scene)
    truth = prepared.truth
    pairs = (
        ("query", "queries", len(truth.queries), published.queries),
        (
            "image of the gallery",
            "images of the gallery",
            len(truth.tiles),
            dataset.gallery_sizes.get(scene),
        ),
    )
    return [
        f"scene {scene} has {counted(found, one, many)}, where {stated:,} are published: a score "
        "over others is another score"
        for one, many, found, stated in pairs
        if stated is not None and found != stated
    ]


def _of_scenes(
    protocols: Sequence[RetrievalProtocol], scenes: Sequence[str]
) -> list[RetrievalProtocol]:
    """Return the protocols of the scenes that are there; all named "partial" where one is cut."""
    kept = []
    for protocol in protocols:
        left = tuple(scene for scene in protocol.scenes if scene.id in scenes)
        if left:
            kept.append((protocol, left))
    if all(left == protocol.scenes for protocol, left in kept):
        return [protocol for protocol, _ in kept]
    return [
        protocol.model_copy(
            update={
                "name": f"{protocol.name}-partial",
                "benchmark": f"{protocol.benchmark}-partial",
                "title": f"{protocol.title} ({len(left)} of {len(protocol.scenes)} scenes)",
                "scenes": left,
            }
        )
        for protocol, left in kept
    ]


def _write(
    protocols: Sequence[RetrievalProtocol],
    scenes: Mapping[str, tuple[ImageScene, PreparedScene]],
    settings: PrepareSettings,
) -> None:
    titles = {scene.id: scene.title for protocol in protocols for scene in protocol.scenes}
    with atomic_folder(settings.folder, replace=settings.replace) as staged:
        entries = []
        for scene, (native, prepared) in scenes.items():
            home = staged / "scenes" / scene
            write_queries(home, _photos(prepared))
            write_truth(home, prepared.truth, prepared.overlaps)
            places = _places(staged, scene, native, copy=settings.copy)
            entries.append(
                SceneFile(
                    id=scene,
                    title=titles[scene],
                    images=places["images"],
                    gallery=places["gallery"],
                )
            )
        write_folder_files(staged, protocols, entries)


def _photos(prepared: PreparedScene) -> pd.DataFrame:
    """Return the table of all photos, those that are no queries too."""
    import pandas as pd

    return pd.concat([prepared.truth.queries, prepared.truth.excluded[["id", "image"]]])


def _places(folder: Path, scene: str, native: ImageScene, *, copy: bool) -> dict[str, str]:
    """Return the folders of queries and gallery, after copying the images if wanted."""
    sources = {
        "images": (native.images, native.queries.images),
        "gallery": (native.tiles, native.gallery.images),
    }
    if not copy:
        return {key: str(source.resolve()) for key, (source, _) in sources.items()}
    places = {}
    for key, (source, images) in sources.items():
        home = Path("data") / scene / key
        for image in images:
            target = folder / home / image
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source / image, target)
        places[key] = home.as_posix()
    return places
