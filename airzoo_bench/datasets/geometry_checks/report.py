"""Results of geometry checks as sentences, a table, and JSON values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from airzoo_bench.core.errors import CameraError, counted
from airzoo_bench.datasets.geometry_checks.depth import DepthConsistency
from airzoo_bench.datasets.geometry_checks.frame_chain import CLOSES_M, CLOSES_PX, FrameChain
from airzoo_bench.datasets.geometry_checks.scenes import PosedScene
from airzoo_bench.datasets.scene_warnings import scene_warnings
from airzoo_bench.geometry.crs import check_true_metres, horizontal_crs, to_lonlat
from airzoo_bench.tables.model import Cell, Column, Row, Table

_SHOWN = 3
_FLOATING_BELOW = 0.1  # of the points in front of surfaces: leaves and wires are
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

    @property
    def values(self) -> dict[str, Any]:
        """All figures as JSON values; None for what was not checked or is infinite."""
        chain, depth, ids = self.chain, self.depth, self.scene.ids
        found: dict[str, Any] = {"scene": self.scene.name, "photos": len(ids)}
        found |= {"frame_chain": None, "depth": None}
        if chain is not None:
            found["frame_chain"] = {
                "worst_photo": ids[chain.worst],
                "closure_m": _finite(chain.closure_m.max()),
                "closure_px": _finite(chain.closure_px.max()),
                "open_photos": [ids[row] for row in np.flatnonzero(chain.open_photos)],
            }
        if depth is not None:
            shares = {"median": 0.5, "p90": 0.9, "p95": 0.95}
            quantiles = {name: _finite(depth.quantile(share)) for name, share in shares.items()}
            names = ("pairs", "hidden", "floating", "median_below", "without_depth")
            found["depth"] = quantiles | {name: getattr(depth, name) for name in names}
            found["depth"]["compared"] = int(depth.error.size)
            found["depth"]["frames_that_stand_out"] = depth.bad_frames["id"].tolist()
        said = {"faults": self.failures, "warnings": self.warnings, "notes": self.notes}
        return found | said | {"passes": not self.failures}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


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
    return (
        f"the frame chain of {int(chain.open_photos.sum())} of {counted(len(ids), 'photo')} "
        f"does not close to {CLOSES_M:g} m and {CLOSES_PX:g} px (worst: {ids[worst]}, "
        f"{chain.closure_m[worst]:.2g} m, {chain.closure_px[worst]:.2g} px): "
        f"{int(chain.lens_fails.sum())} with pixels beyond the range of the lens model, "
        f"{int(chain.off_crs.sum())} with positions that are no place of the CRS"
    )


def _depth_failures(depth: DepthConsistency) -> list[str]:
    failures, median, limit = [], depth.quantile(0.5), depth.median_below
    if median >= limit:
        failures.append(f"median depth error {100 * median:.4f} %, not below {100 * limit:g} %")
    if depth.floating >= _FLOATING_BELOW:
        failures.append(
            f"{100 * depth.floating:.1f} % of the points float before the surface that they "
            f"should be on, not below {100 * _FLOATING_BELOW:g} %"
        )
    bad = depth.bad_frames
    failures += [
        f"{frame['id']}: median depth error {100 * frame['median']:.4f} %, depths "
        f"{100 * frame['ratio']:+.3f} % against its partners, {100 * frame['floating']:.0f} % "
        "of its points float"
        for _, frame in bad.head(_SHOWN).iterrows()
    ]
    if len(bad) > _SHOWN:
        failures.append(f"{counted(len(bad) - _SHOWN, 'more frame')}; --format json names all")
    if depth.hidden > depth.error.size or median >= _CONVENTION:
        failures.append(
            "so large an error is one of convention: poses are world-to-camera with OpenCV axes, "
            "centres are not translations, and depth is along the optical axis (--depth-kind)"
        )
    return failures


def geometry_table(checked: Sequence[SceneGeometry]) -> Table:
    """Lay out the checks in a row for each scene, with failures and notes below."""
    rows, notes = [], []
    for one in checked:
        chain, depth, failures, warnings = one.chain, one.depth, one.failures, one.warnings
        closure: Sequence[Any] = (None, None)
        if chain is not None:
            closure = [f"{part.max():.1e}" for part in (chain.closure_m, chain.closure_px)]
        found: Sequence[Any] = (None,) * 5
        if depth is not None:
            shares = [*map(depth.quantile, (0.5, 0.9, 0.95)), depth.floating]
            found = (depth.pairs, *(100 * share for share in shares))
        verdict = "fails" if failures else "warns" if warnings else "passes"
        values = (one.scene.name, len(one.scene.ids), *closure, *found, verdict)
        rows.append(Row(tuple(map(Cell, values))))
        said = (*failures, *(f"warning: {text}" for text in warnings), *one.notes)
        notes += [f"{one.scene.name}: {text}" for text in said]
    return Table("Geometry checks", _COLUMNS, tuple(rows), tuple(notes))
