"""What the checks found: in words, as a table, as files."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.errors import CameraError, agreeing, counted
from airzoo_bench.core.files import atomic_write
from airzoo_bench.datasets.facts_lines import plausibility_warnings
from airzoo_bench.datasets.geometry_checks.dataset import PosedScene
from airzoo_bench.datasets.geometry_checks.depth_report import FLOATING_BELOW, DepthConsistency
from airzoo_bench.datasets.geometry_checks.frame_chain import CLOSES_M, CLOSES_PX, FrameChain
from airzoo_bench.datasets.scene_facts import SceneFacts
from airzoo_bench.geometry.crs import check_true_metres, horizontal_crs, to_lonlat
from airzoo_bench.tables.model import Cell, Column, Row, Table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["OUTPUT_NAMES", "SceneGeometry", "geometry_table", "report_values", "save_report"]

OUTPUT_NAMES = ("geometry.json", "photos.csv", "pairs.csv")

_SHOWN = 3
_CONVENTION = 0.02  # a median error that no small fault has
_MOST_HIDDEN = 0.5

_COLUMNS = (
    Column("Scene"),
    Column("Photos"),
    Column("Closure", "m"),
    Column("Closure", "px"),
    Column("Pairs"),
    Column("No overlap"),
    Column("Compared", "%", decimals=1),
    Column("Median", "%", decimals=4),
    Column("P90", "%", decimals=4),
    Column("P95", "%", decimals=4),
    Column("Signed", "%", decimals=4),
    Column("Verdict"),
)


@dataclass(frozen=True, eq=False)
class SceneGeometry:
    """The checks of one scene.

    Attributes
    ----------
    scene : PosedScene
    chain : FrameChain or None
        None where the CRS is not known.
    depth : DepthConsistency or None
        None where there is no depth.
    sources : SceneFacts or None
        What poses, photos and maps of a benchmark folder say of each other; None for pose files,
        and where map or surface model are not there.
    """

    scene: PosedScene
    chain: FrameChain | None
    depth: DepthConsistency | None
    sources: SceneFacts | None = None

    @property
    def failures(self) -> list[str]:
        """What is wrong, a sentence each; empty where nothing is."""
        chain = _scale_failures(self.scene)
        chain += [] if self.chain is None else _chain_failures(self.chain, self.scene.ids)
        return chain + ([] if self.depth is None else _depth_failures(self.depth))

    @property
    def warnings(self) -> list[str]:
        """What is suspect, a sentence each: the same as `prepare` says."""
        return [] if self.sources is None else plausibility_warnings(self.sources)

    @property
    def notes(self) -> list[str]:
        """What was not checked, and other things to know."""
        notes = []
        if self.sources is None and self.scene.benchmark is not None:
            notes.append("poses not held against GPS and maps: map or surface model are not there")
        if self.chain is None:
            notes.append(f"frame chain not checked: {self.scene.without_crs}")
        if self.depth is None:
            notes.append("depth not checked: there are no depth maps (--depth)")
        elif self.depth.without_depth:
            names = self.depth.without_depth
            who, have = counted(len(names), "photo"), agreeing(len(names), "has", "have")
            notes.append(f"{who} {have} no depth map, such as {names[0]}")
        return notes


def _scale_failures(scene: PosedScene) -> list[str]:
    if scene.crs is None:
        return []
    crs = horizontal_crs(scene.crs)
    places = to_lonlat(crs, scene.poses.centres[:, :2])
    try:
        # Positions that are no place are the frame chain's.
        check_true_metres(crs, places[np.isfinite(places).all(axis=1)], scene.name)
    except CameraError as error:
        return [error.what]
    return []


def _chain_failures(chain: FrameChain, ids: tuple[str, ...]) -> list[str]:
    bad = np.flatnonzero(chain.open_photos)
    if not bad.size:
        return []
    worst = chain.worst
    causes = [
        (chain.lens_fails, "pixels beyond the range of the lens model: look at the distortion"),
        (chain.off_crs, "positions that are no place of the CRS: look at the CRS and the centres"),
    ]
    named = [f"{int(mask.sum())} with {cause}" for mask, cause in causes if mask.any()]
    because = "; ".join(named) or "the CRS cannot be inverted so exactly"
    return [
        f"the frame chain of {bad.size} of {counted(len(ids), 'photo')} does not close "
        f"to {CLOSES_M:g} m and {CLOSES_PX:g} px (worst: {ids[worst]}, "
        f"{chain.closure_m[worst]:.2g} m, {chain.closure_px[worst]:.2g} px): {because}"
    ]


def _depth_failures(depth: DepthConsistency) -> list[str]:
    failures = []
    if depth.median >= depth.median_below:
        limit = 100 * depth.median_below
        failures.append(f"median depth error {100 * depth.median:.4f} %, not below {limit:g} %")
    if depth.floating >= FLOATING_BELOW:
        share = f"{100 * depth.floating:.1f} % of the points float before the surface"
        failures.append(f"{share} that they should be on, where nothing can hide them")
    bad = depth.bad_frames
    for _, frame in bad.head(_SHOWN).iterrows():
        failures.append(
            f"{frame['id']}: median depth error {100 * frame['median']:.4f} %, depths "
            f"{100 * frame['ratio']:+.3f} % against its partners, {100 * frame['floating']:.0f} % "
            f"of its points float"
        )
    if len(bad) > _SHOWN:
        more = len(bad) - _SHOWN
        stand = f"{counted(more, 'more frame')} {agreeing(more, 'stands', 'stand')}"
        failures.append(f"{stand} out; photos.csv has all (--out)")
    return failures + (_conventions(depth) if failures else [])


def _conventions(depth: DepthConsistency) -> list[str]:
    """Hints where errors are too large for a small fault."""
    hints = []
    if depth.error.size == 0:
        hints.append("no pixel could be compared: no frame sees what another does")
    hidden = int(depth.pairs["hidden"].sum())
    if hidden > _MOST_HIDDEN * (hidden + depth.error.size):
        hints.append(f"{hidden:,} points, most of all, lie behind the surface that they should be")
    if depth.median >= _CONVENTION:
        hints.append(
            "so large an error is one of convention: poses are world-to-camera with OpenCV axes, "
            "centres are not translations, and depth is along the optical axis (--depth-kind ray "
            "for distances from the camera)"
        )
    return hints


def geometry_table(checked: list[SceneGeometry]) -> Table:
    """Lay out the checks in a row for each scene, with failures and notes below."""
    rows = tuple(Row(tuple(Cell(value) for value in _row(one))) for one in checked)
    notes = [
        f"{one.scene.name}: {text}"
        for one in checked
        for text in (*one.failures, *(f"warning: {said}" for said in one.warnings), *one.notes)
    ]
    return Table("Geometry checks", _COLUMNS, rows, tuple(notes))


def _row(one: SceneGeometry) -> list[float | int | str | None]:
    chain, depth = one.chain, one.depth
    closure: list[str | None] = [None, None]
    if chain is not None:
        closure = [f"{chain.closure_m.max():.1e}", f"{chain.closure_px.max():.1e}"]
    figures: list[float | int | str | None] = [None] * 7
    if depth is not None:
        figures = [len(depth.pairs) // 2, depth.pairs_without_overlap, 100 * depth.compared]
        figures += [100 * depth.quantile(share) for share in (0.5, 0.9, 0.95)]
        figures.append(100 * depth.signed_median)
    verdict = "fails" if one.failures else "warns" if one.warnings else "passes"
    return [one.scene.name, len(one.scene.ids), *closure, *figures, verdict]


def report_values(checked: list[SceneGeometry]) -> dict[str, object]:
    """Return all figures as JSON values; None for what was not checked or is infinite."""
    return {"passes": not any(one.failures for one in checked), "scenes": [*map(_values, checked)]}


def _values(one: SceneGeometry) -> dict[str, object]:
    chain, depth = one.chain, one.depth
    values: dict[str, object] = {"scene": one.scene.name, "photos": len(one.scene.ids)}
    values["frame_chain"] = (
        None
        if chain is None
        else {
            "worst_photo": one.scene.ids[chain.worst],
            "closure_m": _finite(float(chain.closure_m.max())),
            "closure_px": _finite(float(chain.closure_px.max())),
            "open_photos": [one.scene.ids[row] for row in np.flatnonzero(chain.open_photos)],
        }
    )
    values["depth"] = (
        None
        if depth is None
        else {
            "pairs": len(depth.pairs) // 2,
            "pairs_without_overlap": depth.pairs_without_overlap,
            "sampled": int(depth.pairs["sampled"].sum()),
            "compared": len(depth.error),
            "median": _finite(depth.median),
            "p90": _finite(depth.quantile(0.9)),
            "p95": _finite(depth.quantile(0.95)),
            "signed_median": _finite(depth.signed_median),
            "floating": depth.floating,
            "median_below": depth.median_below,
            "frames_that_stand_out": depth.bad_frames["id"].tolist(),
            "without_depth": list(depth.without_depth),
        }
    )
    values["sources"] = None if one.sources is None else one.sources.values()
    said = {"faults": one.failures, "warnings": one.warnings, "notes": one.notes}
    return values | said | {"passes": not one.failures}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def save_report(checked: list[SceneGeometry], folder: Path) -> list[Path]:
    """Write `OUTPUT_NAMES` into a folder, and return what was written."""
    written = [folder / "geometry.json", folder / "photos.csv"]
    with atomic_write(written[0], "w") as stream:
        stream.write(json.dumps(report_values(checked), indent=1, allow_nan=False) + "\n")
    _write_csv([_photo_table(one) for one in checked], written[1])
    depths = [one.depth for one in checked if one.depth is not None]
    if depths:
        written.append(folder / "pairs.csv")
        _write_csv([depth.pairs for depth in depths], written[2])
    return written


def _photo_table(one: SceneGeometry) -> pd.DataFrame:
    import pandas as pd

    table = pd.DataFrame({"id": one.scene.ids})
    if one.chain is not None:
        table = table.assign(closure_m=one.chain.closure_m, closure_px=one.chain.closure_px)
    return table if one.depth is None else table.merge(one.depth.frames, "left", "id")


def _write_csv(tables: list[pd.DataFrame], path: Path) -> None:
    import pandas as pd

    with atomic_write(path, "w") as stream:
        pd.concat(tables).to_csv(stream, index=False, lineterminator="\n")
