"""Making the benchmark folder of a benchmark that gives images."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import tomli_w

from airzoo_bench.benchmark.folder import BenchmarkFile, SceneFile, write_benchmark_file
from airzoo_bench.benchmark.queries import write_queries
from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.core.files import atomic_folder
from airzoo_bench.core.plurals import counted
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.native import NativeOptions
from airzoo_bench.datasets.native_prepare import chosen_scenes
from airzoo_bench.datasets.published.image_benchmark import ImageBenchmark, ImageScene
from airzoo_bench.datasets.sources import check_target
from airzoo_bench.datasets.truths import SceneTruths
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.protocol.model import ProtocolScene
from airzoo_bench.retrieval.prepare import PreparedScene
from airzoo_bench.retrieval.settings import RetrievalProtocol, StatedTruth
from airzoo_bench.retrieval.stated_truth import build_truth
from airzoo_bench.retrieval.truth import write_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["prepare_images"]


def prepare_images(
    dataset: ImageBenchmark, options: NativeOptions, settings: PrepareSettings
) -> Prepared:
    """Make the benchmark folder, with each protocol whose scenes are there.

    Raises
    ------
    UserError
        No scene can be read, or, without ``--keep-going``, one cannot.
    """
    check_target((options.source,), settings.folder)
    root = dataset.root(options.source)
    if root != options.source:
        settings.note(f"taken from {root}")
    settings.note(f"licence of {dataset.about.title}: {dataset.about.licence}")
    protocols = [_protocol(name) for name in dataset.protocols]
    by_scene = {scene.id: protocol for protocol in protocols for scene in protocol.scenes}
    wanted = {scene: by_scene[scene] for scene in chosen_scenes(list(by_scene), options.scene)}
    scenes = _read_scenes(dataset, root, wanted, options, settings)
    for scene, (native, prepared) in scenes.items():
        for sentence in (*native.notes, *_counts(dataset, by_scene[scene], scene, prepared)):
            settings.note(f"scene {scene}: {sentence}")
    if settings.tiles_on_disk:
        settings.note("the images of the gallery are files already: none was written")
    served = _of_scenes(protocols, list(scenes))
    if served[0].benchmark != dataset.name and settings.folder.name == dataset.name:
        folder = settings.folder.with_name(served[0].benchmark)
        settings = replace(settings, folder=folder)
    return _write(served, scenes, settings)


def _read_scenes(
    dataset: ImageBenchmark,
    root: Path,
    wanted: Mapping[str, RetrievalProtocol],
    options: NativeOptions,
    settings: PrepareSettings,
) -> dict[str, tuple[ImageScene, PreparedScene]]:
    """Read the scenes and make their truth."""
    found = {}
    for scene, protocol in settings.progress(wanted.items(), "scenes", len(wanted)):
        try:
            native = dataset.read(root, scene)
            found[scene] = (native, _truth(scene, native, protocol))
        except UserError as error:
            if not options.keep_going:
                raise
            settings.note(f"scene {scene} is left out: {error}")
    if not found:
        raise BenchmarkError(
            f"none of the scenes {', '.join(wanted)} can be read",
            where=root,
            fix="mend what is said of each",
        )
    return found


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
    dataset: ImageBenchmark, protocol: RetrievalProtocol, scene: str, prepared: PreparedScene
) -> list[str]:
    """Compare the numbers of queries and images with the published ones."""
    published: ProtocolScene = next(one for one in protocol.scenes if one.id == scene)
    truth = prepared.truth
    pairs = (
        ("query", len(truth.queries), published.queries),
        ("image of the gallery", len(truth.tiles), dataset.gallery_sizes.get(scene)),
    )
    return [
        f"{counted(found, what, 'images of the gallery' if ' ' in what else None)}, where "
        f"{stated:,} are published: a score over others is another score"
        for what, found, stated in pairs
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
) -> Prepared:
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
        (staged / "protocols").mkdir()
        for protocol in protocols:
            values = protocol.model_dump(mode="json", by_alias=True, exclude_none=True)
            target = staged / "protocols" / f"{protocol.name}.toml"
            target.write_text(tomli_w.dumps(values), encoding="utf-8")
        file = BenchmarkFile(
            schema=1,
            name=protocols[0].benchmark,
            version=1,
            title=protocols[0].benchmark,
            tracks={"retrieval": protocols[0].truth_settings()},
            scenes=tuple(entries),
            checksums={},
        )
        write_benchmark_file(staged, file)
    return Prepared(
        settings.folder,
        {protocol.name: protocol.track for protocol in protocols},
        {
            scene: SceneTruths(_photos(prepared), prepared, None, None)
            for scene, (_, prepared) in scenes.items()
        },
    )


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
