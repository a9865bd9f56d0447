"""``airzoo-bench prepare``: native data become a benchmark folder."""

from __future__ import annotations

import re
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from airzoo_bench.cli.built import BuiltGroup
from airzoo_bench.cli.common import JobsOption, progress, put, say
from airzoo_bench.core.plurals import counted
from airzoo_bench.core.registry import DATASETS, TRACKS
from airzoo_bench.datasets.dataset import Dataset

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from airzoo_bench.datasets.folder import SceneTruths
    from airzoo_bench.datasets.photos import Prepared

__all__ = ["AIRZOO_MINI", "PHOTOS", "app"]

_LONGEST_NAME = 48  # of which more names are made


class _PrepareGroup(BuiltGroup):
    registry = DATASETS
    panels: ClassVar[dict[str, tuple[str, ...]]] = {
        "Sources": ("name", "images", "poses", "dom", "dsm", "cloud", "priors", "crs"),
        "What is measured": (
            *("protocol", "matching_protocol", "reconstruction_protocol"),
            *("tile_size", "rule", "iou_above"),
        ),
        "Output": ("out", "tiles", "crops", "copy", "force"),
    }

    def command_of(self, thing: Dataset) -> tuple[Callable[..., None], str]:
        return thing.prepare, f"prepare {thing.example}"


app = typer.Typer(
    cls=_PrepareGroup, help="Make a benchmark folder out of data.", no_args_is_help=True
)


class Rule(StrEnum):
    """When a tile is positive."""

    PLANE = "plane"
    DSM = "dsm"
    IOU = "iou"


class Parts(StrEnum):
    """Where parts of the map are."""

    WINDOWS = "windows"
    FILES = "files"


TilesOption = Annotated[
    Parts, typer.Option(help="Leave tiles as windows of the map, or write them as PNG too.")
]
CropsOption = Annotated[
    Parts, typer.Option(help="Leave crops as windows, or write them as GeoTIFF too.")
]


@app.callback()
def _group() -> None:
    """Make a benchmark folder out of data."""


def photos(
    name: Annotated[str, typer.Option(help="Of the benchmark and its scene.")],
    images: Annotated[Path, typer.Option(help="Folder of the photos.")],
    poses: Annotated[Path, typer.Option(help="Pose file (JSON), or folder of a COLMAP model.")],
    dom: Annotated[Path, typer.Option(help="Map that tiles are cut from, GeoTIFF in any CRS.")],
    dsm: Annotated[Path, typer.Option(help="Surface model, GeoTIFF in the CRS of the poses.")],
    cloud: Annotated[
        Path | None,
        typer.Option(help="True cloud in the CRS of the poses (.las, .laz, .ply ...), if any."),
    ] = None,
    priors: Annotated[
        Path | None,
        typer.Option(
            help="CSV of positions and gimbal angles, where the photos' metadata lack them."
        ),
    ] = None,
    crs: Annotated[
        str | None, typer.Option(help="CRS of the poses (default: what their file says).")
    ] = None,
    protocol: Annotated[
        str, typer.Option(help="Retrieval protocol to start from, a name or .toml file.")
    ] = "photos-retrieval",
    matching_protocol: Annotated[
        str, typer.Option(help="Matching protocol to start from, a name or .toml file.")
    ] = "photos-matching",
    reconstruction_protocol: Annotated[
        str, typer.Option(help="Reconstruction protocol to start from, a name or .toml file.")
    ] = "photos-reconstruction",
    tile_size: Annotated[
        list[int] | None,
        typer.Option(help="Side of a tile in map pixels; repeat it (default: the protocol's)."),
    ] = None,
    rule: Annotated[
        Rule | None, typer.Option(help="When a tile is positive (default: the protocol's).")
    ] = None,
    iou_above: Annotated[float | None, typer.Option(help="With --rule iou.")] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The folder to make (default: NAME in the data root)."),
    ] = None,
    tiles: TilesOption = Parts.WINDOWS,
    crops: CropsOption = Parts.WINDOWS,
    copy: Annotated[
        bool, typer.Option("--copy", help="Copy photos, DOM and DSM into the folder.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the folder.")] = False,
) -> None:
    """Make a benchmark folder out of photos, their poses, a map and a surface model.

    It serves retrieval; matching where the photos' metadata hold GPS and gimbal angles; and
    reconstruction where there is a true --cloud.
    """
    from airzoo_bench.core.errors import UsageError
    from airzoo_bench.core.places import data_root
    from airzoo_bench.core.validation import SAFE_NAME
    from airzoo_bench.datasets.photos import PhotoProtocols, prepare_photos
    from airzoo_bench.datasets.sources import PhotoSources
    from airzoo_bench.matching.settings import MatchingProtocol
    from airzoo_bench.protocol.lookup import protocol_for, protocol_of_track
    from airzoo_bench.reconstruction.settings import ReconstructionProtocol
    from airzoo_bench.retrieval.settings import RetrievalProtocol

    if not re.fullmatch(SAFE_NAME, name) or len(name) > _LONGEST_NAME:
        raise UsageError(
            f"--name {name[:80]!r} cannot be the name of a benchmark",
            expected="letters, digits, '.', '_' and '-', beginning with a letter or digit, at most "
            f"{_LONGEST_NAME} characters",
        )
    root = data_root()
    base = protocol_of_track(protocol, root, RetrievalProtocol)
    matching = protocol_of_track(matching_protocol, root, MatchingProtocol)
    reconstruction = protocol_of_track(reconstruction_protocol, root, ReconstructionProtocol)
    truth = base.ground_truth
    changes: dict[str, dict[str, Any]] = {
        "gallery": {"tile_sizes_px": tuple(tile_size)} if tile_size else {},
        "ground_truth": {
            "rule": rule.value if rule else truth.rule,
            "iou_above": _threshold(truth.iou_above, rule, iou_above),
        },
    }
    prepared = prepare_photos(
        PhotoSources(images, poses, dom, dsm, crs, cloud, priors),
        PhotoProtocols(
            protocol_for(base, name, changes),
            protocol_for(matching, name, {}),
            protocol_for(reconstruction, name, {}),
        ),
        out or data_root() / name,
        tiles_on_disk=tiles is Parts.FILES,
        crops_on_disk=crops is Parts.FILES,
        copy=copy,
        replace=force,
        progress=progress,
    )
    _report(prepared, out)


def airzoo_mini(
    seed: Annotated[
        int, typer.Option(min=0, help="Another seed is another place, and another benchmark.")
    ] = 0,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The folder to make (default: in the data root)."),
    ] = None,
    tiles: TilesOption = Parts.WINDOWS,
    crops: CropsOption = Parts.WINDOWS,
    copy: Annotated[
        bool, typer.Option("--copy", help="Copy photos, maps and clouds into the folder.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the folder.")] = False,
    jobs: JobsOption = 2,
) -> None:
    """Make AirZoo-Mini: a made-up world, flights over it, photos, and the truth of every track.

    Needs no data. Worlds and photos are kept in the data root: a run that was stopped goes on.
    """
    from airzoo_bench.core.places import data_root
    from airzoo_bench.datasets.mini.prepare import mini_protocols, prepare_airzoo_mini

    protocols = mini_protocols(seed)
    root = data_root()
    prepared = prepare_airzoo_mini(
        root,
        out or root / protocols.retrieval.benchmark,
        protocols,
        seed=seed,
        jobs=jobs,
        tiles_on_disk=tiles is Parts.FILES,
        crops_on_disk=crops is Parts.FILES,
        copy=copy,
        replace=force,
        progress=progress,
        note=say,
    )
    put(f"{prepared.folder}\n")
    for name, truths in prepared.scenes.items():
        put(f"{name}, {counted(len(truths.photos), 'photo')}\n")
        _report_tracks(truths)
    _suggest([protocol.name for protocol in protocols.every], out and prepared.folder)


def _threshold(base: float | None, rule: Rule | None, given: float | None) -> float | None:
    """Return the overlap to use: what was given, else the protocol's, if it goes by overlap."""
    goes_by_overlap = rule is Rule.IOU or (rule is None and base is not None)
    return base if given is None and goes_by_overlap else given


def _report(prepared: Prepared, out: Path | None) -> None:
    from airzoo_bench.core.errors import first_of
    from airzoo_bench.datasets.facts_lines import fact_lines
    from airzoo_bench.datasets.plausibility import plausibility_warnings

    put(f"{prepared.folder}\n")
    for line in fact_lines(prepared.facts):
        put(f"  {line}\n")
    _report_tracks(prepared.truths)
    for sentence in plausibility_warnings(prepared.facts):
        say(f"warning: {sentence}")
    if prepared.without_pose:
        listed = first_of(map(repr, prepared.without_pose))
        say(f"photos without a pose, which no track asks: {listed}")
    _suggest(prepared.protocols, out and prepared.folder)


def _report_tracks(truths: SceneTruths) -> None:
    if truths.retrieval is not None:
        truth = truths.retrieval.truth
        counts = truth.positives.counts
        put(f"  retrieval       {counted(len(truth.queries), 'query')}, ")
        put(f"{counted(len(truth.tiles), 'tile')}, ")
        put(f"{counts.min()} to {counts.max()} positives per query, mean {counts.mean():.1f}\n")
        _report_left_out(len(truth.excluded))
    if truths.matching is not None:
        put(f"  matching        {counted(len(truths.matching.queries), 'query')} with a prior\n")
        _report_left_out(len(truths.matching.excluded))
    else:
        put("  matching        no: no photo has GPS position and gimbal angles (--priors)\n")
    if truths.reconstruction is not None:
        photos = counted(len(truths.reconstruction.photos), "photo")
        put(f"  reconstruction  {photos}, a true cloud\n")
    else:
        put("  reconstruction  no: no true cloud was given (--cloud)\n")


def _suggest(protocols: Sequence[str], folder: Path | None) -> None:
    where = f" --data {folder}" if folder else ""
    for name in protocols:
        track = name.rsplit("-", 1)[1]
        file = f"{track}{Path(TRACKS.get(track).baseline.out).suffix}"
        say(f"next: airzoo-bench baseline {track} {name}{where} --out {file}")


def _report_left_out(count: int) -> None:
    if count:
        put(f"                  {counted(count, 'photo')} left out; excluded.csv says why\n")


PHOTOS = Dataset(
    photos,
    "photos --name park --images photos --poses poses.json --dom dom.tif --dsm dsm.tif "
    "--tile-size 256 --tile-size 128",
)
AIRZOO_MINI = Dataset(airzoo_mini, "airzoo-mini")
