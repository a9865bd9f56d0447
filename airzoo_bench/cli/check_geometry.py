"""``airzoo-bench check-geometry`` and ``check-split``: whether a dataset agrees with itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from airzoo_bench.cli.common import Format, FormatOption, examples, progress, put, say, show
from airzoo_bench.core.errors import UsageError

if TYPE_CHECKING:
    from airzoo_bench.datasets.geometry_checks.report import SceneGeometry
    from airzoo_bench.datasets.geometry_checks.scenes import PosedScene

SPLIT_EXAMPLES = examples("check-split training-set airzoo-mini --out overlaps.csv")
GEOMETRY_EXAMPLES = examples("check-geometry airzoo-mini --format json")
PANELS = {
    "Cameras": ("scene", "poses", "images", "crs"),
    "Depth": ("depth", "depth_kind", "depth_scale", "samples", "seed", "median_below"),
    "Output": ("form",),
}


def check_geometry(
    data: Annotated[
        Path | None, typer.Argument(help="A benchmark folder, or its name in the data root.")
    ] = None,
    scene: Annotated[str | None, typer.Option(help="One scene (default: all).")] = None,
    poses: Annotated[
        Path | None,
        typer.Option(help="Instead of DATA: pose file (JSON), or folder of a COLMAP model."),
    ] = None,
    images: Annotated[Path | None, typer.Option(help="With --poses: folder of the photos.")] = None,
    crs: Annotated[
        str | None, typer.Option(help="With --poses: their CRS (default: what their file says).")
    ] = None,
    depth: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the depth maps, or of one for each scene (default: depth/ next to the "
            "folder of the photos)."
        ),
    ] = None,
    depth_kind: Annotated[
        Literal["z", "ray"], typer.Option(help="Depth along the optical axis, or the pixel's ray.")
    ] = "z",
    depth_scale: Annotated[
        float | None,
        typer.Option(help="Metres of a unit, for whole numbers such as 16-bit PNG."),
    ] = None,
    samples: Annotated[int, typer.Option(min=64, help="Pixels sampled of each frame.")] = 4096,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sampling.")] = 0,
    median_below: Annotated[
        float, typer.Option(min=0.0, help="The median relative depth error must be below this.")
    ] = 0.00066,
    form: FormatOption = Format.TERMINAL,
) -> None:
    """Check frames and depth of a dataset; exit code 1 where something is wrong."""
    from airzoo_bench.datasets.geometry_checks.report import geometry_table

    if depth_scale is not None and not 0.0 < depth_scale < float("inf"):
        what = f"--depth-scale {depth_scale} is not a scale"
        raise UsageError(what, expected="metres of a unit")
    sampling = {
        "kind": depth_kind,
        "scale_m": depth_scale,
        "pixels": samples,
        "seed": seed,
        "median_below": median_below,
    }
    scenes = _scenes(data, scene, poses, images, crs)
    checked = [_checked(one, depth, sampling) for one in scenes]
    passes = not any(one.failures for one in checked)
    if form is Format.JSON:
        values = {"passes": passes, "scenes": [one.values for one in checked]}
        put(json.dumps(values, indent=1, allow_nan=False) + "\n")
    else:
        show(geometry_table(checked), form)
    if not passes:
        raise typer.Exit(1)


def _scenes(
    data: Path | None, scene: str | None, poses: Path | None, images: Path | None, crs: str | None
) -> list[PosedScene]:
    from airzoo_bench.datasets.geometry_checks import scenes

    if data is not None and (poses, images, crs) == (None, None, None):
        return scenes.scenes_of_benchmark(scenes.open_benchmark(data), scene, measured=True)
    if data is None and scene is None and poses is not None and images is not None:
        return [scenes.scene_from_poses(poses, images, crs, progress)]
    raise UsageError(
        "what is to be checked is not clear",
        expected="a benchmark folder DATA, perhaps with --scene; or --poses and --images, "
        "perhaps with --crs",
    )


def _checked(scene: PosedScene, depth: Path | None, sampling: dict[str, Any]) -> SceneGeometry:
    from airzoo_bench.datasets.geometry_checks.depth import check_depth_consistency, find_depths
    from airzoo_bench.datasets.geometry_checks.frame_chain import check_frame_chain
    from airzoo_bench.datasets.geometry_checks.report import SceneGeometry

    folder = scene.folder.resolve().parent / "depth" if depth is None else depth
    if depth is not None and (depth / scene.name).is_dir():
        folder = depth / scene.name
    has_depth = depth is not None or folder.is_dir()
    if scene.crs is None and not has_depth:
        raise UsageError(
            f"nothing can be checked of {scene.name}: its poses have no CRS, and there is no depth",
            where=folder,
            expected="depth maps, or poses in a projected CRS",
            fix="name the folder of the depth maps with --depth, or the CRS with --crs",
        )
    chain = None if scene.crs is None else check_frame_chain(scene.cameras, scene.poses, scene.crs)
    found = None
    if has_depth:
        paths = find_depths(folder, scene.images)
        found = check_depth_consistency(scene, paths, **sampling, progress=progress)
    return SceneGeometry(scene, chain, found)


def check_split(
    train: Annotated[Path, typer.Argument(help="A benchmark folder, or a CSV of footprints.")],
    test: Annotated[Path, typer.Argument(help="Another.")],
    max_range: Annotated[
        float, typer.Option(min=1.0, help="Rays to the ground are cut at this many metres.")
    ] = 2000.0,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="CSV of all pairs that overlap.")
    ] = None,
    form: FormatOption = Format.TERMINAL,
) -> None:
    """Check that no photo of one set sees ground that a photo of another sees.

    Exit code 1 where one does, with the pairs named.
    """
    from airzoo_bench.datasets.geometry_checks import splits

    sets = [splits.read_footprints(place, max_range) for place in (train, test)]
    found = splits.compare_splits(*sets, csv=out, progress=progress)
    show(splits.split_table(found), form)
    if out is not None:
        say(f"wrote {out}")
    if not found.passes:
        raise typer.Exit(1)
