"""``airzoo-bench audit``, ``check-geometry``, ``check-split``: published numbers and geometry."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from airzoo_bench.cli import common as cli
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write

if TYPE_CHECKING:
    from airzoo_bench.datasets.geometry_checks import PosedScene, SceneGeometry
_MOST_M = 2000.0  # rays to the ground are cut here


def audit(
    table: Annotated[
        Path,
        typer.Argument(
            help="CSV, one number a line: the columns method, scene, metric, value, and any of "
            "table, benchmark, track, unit, n, bold, gain."
        ),
    ],
    form: cli.FormatOption = cli.Format.TERMINAL,
    counts: Annotated[
        cli.Texts,
        cli.option(
            "Queries of scenes, as 'scene=n,...' or 'benchmark/scene=n,...', repeatable "
            "(default: from the file, else implied by the values)."
        ),
    ] = None,
) -> None:
    """Check a published table by arithmetic. Exit code 1 if it contradicts itself.

    The first line is 'method,scene,metric,value', each further line a number as printed, such as
    'X,City,R@1,8.70', with its trailing zeros. See docs/audit.md.

    Example: airzoo-bench audit table.csv

    Example: airzoo-bench audit table.csv --counts City=161,Rural=190 --format markdown
    """
    from airzoo_bench.audit.audit import audit as audit_published
    from airzoo_bench.audit.audit import audit_table, audit_text
    from airzoo_bench.audit.counts import parse_counts
    from airzoo_bench.tables.published import read_published

    done = audit_published(read_published(table), parse_counts(counts or []))
    if form is cli.Format.TERMINAL:
        cli.echo(audit_text(done, table.name))
    else:
        cli.show(audit_table(done, table.name), form)
    if done.failed:
        raise typer.Exit(1)


def check_geometry(
    data: Annotated[
        cli.File, typer.Argument(help="A benchmark folder, or its name in the data root.")
    ] = None,
    scene: Annotated[cli.Text, cli.option("One scene (default: all).")] = None,
    poses: Annotated[
        cli.File, cli.option("Instead of DATA: pose file (JSON), or folder of a COLMAP model.")
    ] = None,
    images: Annotated[cli.File, cli.option("With --poses: folder of the photos.")] = None,
    crs: Annotated[
        cli.Text, cli.option("With --poses: their CRS (default: what their file says).")
    ] = None,
    depth: Annotated[
        cli.File,
        cli.option(
            "Folder of the depth maps, or of a folder by scene (default: depth/ next to the "
            "folder of the photos)."
        ),
    ] = None,
    depth_kind: Annotated[
        Literal["z", "ray"], cli.option("Depth along the optical axis, or the pixel's ray.")
    ] = "z",
    depth_scale: Annotated[
        float | None,
        cli.option("Metres of a unit, for whole numbers such as 16-bit PNG.", min=1e-6, max=1000),
    ] = None,
    median_below: Annotated[
        float, cli.option("Limit of the median relative depth error.", min=0.0)
    ] = 0.00066,
    form: cli.FormatOption = cli.Format.TERMINAL,
) -> None:
    """Check frames and depth of a dataset. Exit code 1 if something is wrong.

    Example: airzoo-bench check-geometry airzoo-mini --format json
    """
    from airzoo_bench.datasets import geometry_checks

    if data is not None and (poses, images, crs) == (None, None, None):
        found = geometry_checks.scenes_of_benchmark(data, scene)
    elif data is None and scene is None and poses is not None and images is not None:
        found = [geometry_checks.scene_from_poses(poses, images, crs, cli.progress)]
    else:
        expected = "DATA, perhaps with --scene; or --poses and --images, perhaps with --crs"
        raise UsageError("what is to be checked is not clear", expected=expected)
    sampling = {"kind": depth_kind, "scale_m": depth_scale, "median_below": median_below}
    checked = [_check_scene(one, depth, sampling) for one in found]
    cli.show(geometry_checks.geometry_table(checked), form)
    if any(one.failures for one in checked):
        raise typer.Exit(1)


def _check_scene(scene: PosedScene, depth: Path | None, sampling: dict[str, Any]) -> SceneGeometry:
    from airzoo_bench.datasets.depth_maps import check_depth_consistency, find_depths
    from airzoo_bench.datasets.geometry_checks import SceneGeometry, check_frame_chain

    folder = depth or scene.folder.resolve().parent / "depth"
    folder = folder / scene.name if (folder / scene.name).is_dir() else folder
    posed, found = (scene.cameras, scene.poses), None
    chain = None if scene.crs is None else check_frame_chain(*posed, scene.crs)
    if depth is not None or folder.is_dir():
        photos = scene.ids, *posed, find_depths(folder, scene.images)
        found = check_depth_consistency(*photos, **sampling, progress=cli.progress)
    if chain is None and found is None:
        said = f"nothing can be checked of {scene.name}: its poses have no CRS, and it has no depth"
        raise UsageError(said, where=folder, fix="name --depth or --crs")
    return SceneGeometry(scene, chain, found)


def check_split(
    train: Annotated[Path, typer.Argument(help="A benchmark folder, or a CSV of footprints.")],
    test: Annotated[Path, typer.Argument(help="Another.")],
    out: Annotated[cli.File, cli.option("CSV of all pairs that overlap.", "--out", "-o")] = None,
    form: cli.FormatOption = cli.Format.TERMINAL,
) -> None:
    """Check that photos of two sets see no common ground.

    Exit code 1 if some do; the pairs are named.

    Example: airzoo-bench check-split training-set airzoo-mini --out overlaps.csv
    """
    from airzoo_bench.datasets import geometry_checks

    sets = [geometry_checks.read_footprints(place, _MOST_M) for place in (train, test)]
    pairs = geometry_checks.compare_splits(*sets)
    unknown = [name for one in sets for name in one.index[one.isna().any(axis=1)]]
    cli.show(geometry_checks.split_table(pairs, unknown), form)
    if out is not None:
        with atomic_write(out, "w") as stream:
            pairs.to_csv(stream, index=False, lineterminator="\n")
        cli.say(f"wrote {out}")
    if unknown or not pairs.empty:
        raise typer.Exit(1)
