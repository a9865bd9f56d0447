"""Results of geometry checks as sentences, a table, and files."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from airzoo_bench.core.errors import CameraError, counted
from airzoo_bench.core.files import atomic_write
from airzoo_bench.datasets.geometry_checks.depth import FLOATING_BELOW, DepthConsistency
from airzoo_bench.datasets.geometry_checks.frame_chain import CLOSES_M, CLOSES_PX, FrameChain
from airzoo_bench.datasets.geometry_checks.scenes import PosedScene
from airzoo_bench.datasets.scene_warnings import scene_warnings
from airzoo_bench.geometry.crs import check_true_metres, horizontal_crs, to_lonlat
from airzoo_bench.tables.model import Cell, Column, Row, Table

__all__ = ["OUTPUT_NAMES", "SceneGeometry", "geometry_table", "report_values", "save_report"]

OUTPUT_NAMES = ("geometry.json", "photos.csv")
_SHOWN = 3
_CONVENTION = 0.02  # a median error that no small fault has
_COLUMNS = (
    *(Column("Scene"), Column("Photos"), Column("Closure", "m"), Column("Closure", "px")),
    *(Column("Pairs"), *(Column(name, "%", decimals=4) for name in ("Median", "P90", "P95"))),
    *(Column("Floating", "%", decimals=2), Column("Verdict")),
)


@dataclass(frozen=True, eq=False)
class SceneGeometry:
    """The checks of one scene; None for what was not checked."""

    scene: PosedScene
    chain: FrameChain | None
    depth: DepthConsistency | None

    @property
    def failures(self) -> list[str]:
        """Faults, a sentence each."""
        found = _scale_failures(self.scene)
        if self.chain is not None and self.chain.open_photos.any():
            found.append(_chain_failure(self.chain, self.scene.ids))
        return found + ([] if self.depth is None else _depth_failures(self.depth))

    @property
    def warnings(self) -> list[str]:
        """Suspect figures, a sentence each: the same as `prepare` prints."""
        facts = self.scene.facts
        return [] if facts is None else [str(found) for found in scene_warnings(facts)]

    @property
    def notes(self) -> list[str]:
        """Checks that were left out, a sentence each."""
        notes = []
        if self.chain is None:
            notes.append("frame chain not checked: poses have no CRS (--crs), or a local frame")
        if self.depth is None:
            notes.append("depth not checked: there are no depth maps (--depth)")
        elif self.depth.without_depth:
            notes.append(f"without a depth map: {counted(self.depth.without_depth, 'photo')}")
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


def _chain_failure(chain: FrameChain, ids: Sequence[str]) -> str:
    worst = chain.worst
    causes = (
        (chain.lens_fails, "pixels beyond the range of the lens model: look at the distortion"),
        (chain.off_crs, "positions that are no place of the CRS: look at CRS and centres"),
    )
    named = [f"{int(mask.sum())} with {cause}" for mask, cause in causes if mask.any()]
    return (
        f"the frame chain of {int(chain.open_photos.sum())} of {counted(len(ids), 'photo')} "
        f"does not close to {CLOSES_M:g} m and {CLOSES_PX:g} px (worst: {ids[worst]}, "
        f"{chain.closure_m[worst]:.2g} m, {chain.closure_px[worst]:.2g} px): "
        + ("; ".join(named) or "the CRS cannot be inverted so exactly")
    )


def _depth_failures(depth: DepthConsistency) -> list[str]:
    failures, median, limit = [], depth.quantile(0.5), depth.median_below
    if median >= limit:
        failures.append(f"median depth error {100 * median:.4f} %, not below {100 * limit:g} %")
    if depth.floating >= FLOATING_BELOW:
        failures.append(
            f"{100 * depth.floating:.1f} % of the points float before the surface that they "
            f"should be on, not below {100 * FLOATING_BELOW:g} %"
        )
    bad = depth.bad_frames
    failures += [
        f"{frame['id']}: median depth error {100 * frame['median']:.4f} %, depths "
        f"{100 * frame['ratio']:+.3f} % against its partners, {100 * frame['floating']:.0f} % "
        "of its points float"
        for _, frame in bad.head(_SHOWN).iterrows()
    ]
    if len(bad) > _SHOWN:
        failures.append(f"{counted(len(bad) - _SHOWN, 'more frame')}; photos.csv has all (--out)")
    if depth.hidden > depth.error.size or median >= _CONVENTION:
        failures.append(
            "so large an error is one of convention: poses are world-to-camera with OpenCV axes, "
            "centres are not translations, and depth is along the optical axis (--depth-kind ray "
            "for distances from the camera)"
        )
    return failures


def geometry_table(checked: Sequence[SceneGeometry]) -> Table:
    """Lay out the checks in a row for each scene, with failures and notes below."""
    rows, notes = [], []
    for one in checked:
        chain, depth, failures, warnings = one.chain, one.depth, one.failures, one.warnings
        values: list[float | int | str | None] = [one.scene.name, len(one.scene.ids)]
        values += [None] * 2
        if chain is not None:
            values[2:] = [f"{chain.closure_m.max():.1e}", f"{chain.closure_px.max():.1e}"]
        values += [None] * 5
        if depth is not None:
            quantiles = (100 * depth.quantile(share) for share in (0.5, 0.9, 0.95))
            values[4:] = [depth.pairs, *quantiles, 100 * depth.floating]
        verdict = "fails" if failures else "warns" if warnings else "passes"
        rows.append(Row(tuple(Cell(value) for value in (*values, verdict))))
        said = (*failures, *(f"warning: {text}" for text in warnings), *one.notes)
        notes += [f"{one.scene.name}: {text}" for text in said]
    return Table("Geometry checks", _COLUMNS, tuple(rows), tuple(notes))


def report_values(checked: Sequence[SceneGeometry]) -> dict[str, object]:
    """Return all figures as JSON values; None for what was not checked or is infinite."""
    scenes = [
        {
            "scene": one.scene.name,
            "photos": len(one.scene.ids),
            "frame_chain": None if one.chain is None else _chain_values(one.chain, one.scene.ids),
            "depth": None if one.depth is None else _depth_values(one.depth),
            "faults": one.failures,
            "warnings": one.warnings,
            "notes": one.notes,
            "passes": not one.failures,
        }
        for one in checked
    ]
    return {"passes": all(one["passes"] for one in scenes), "scenes": scenes}


def _chain_values(chain: FrameChain, ids: Sequence[str]) -> dict[str, object]:
    return {
        "worst_photo": ids[chain.worst],
        "closure_m": _finite(chain.closure_m.max()),
        "closure_px": _finite(chain.closure_px.max()),
        "open_photos": [ids[row] for row in np.flatnonzero(chain.open_photos).tolist()],
    }


def _depth_values(depth: DepthConsistency) -> dict[str, object]:
    shares = {"median": 0.5, "p90": 0.9, "p95": 0.95}
    return {
        "pairs": depth.pairs,
        "compared": int(depth.error.size),
        "hidden": depth.hidden,
        **{name: _finite(depth.quantile(share)) for name, share in shares.items()},
        "floating": depth.floating,
        "median_below": depth.median_below,
        "frames_that_stand_out": depth.bad_frames["id"].tolist(),
        "without_depth": depth.without_depth,
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def save_report(checked: Sequence[SceneGeometry], folder: Path) -> list[Path]:
    """Write `OUTPUT_NAMES` into a folder, and return what was written."""
    tables = []
    for one in checked:
        table = pd.DataFrame({"id": one.scene.ids})
        if one.chain is not None:
            table = table.assign(closure_m=one.chain.closure_m, closure_px=one.chain.closure_px)
        tables.append(table if one.depth is None else table.merge(one.depth.frames, "left", "id"))
    written = [folder / name for name in OUTPUT_NAMES]
    with atomic_write(written[0], "w") as stream:
        stream.write(json.dumps(report_values(checked), indent=1, allow_nan=False) + "\n")
    with atomic_write(written[1], "w") as stream:
        pd.concat(tables).to_csv(stream, index=False, lineterminator="\n")
    return written
