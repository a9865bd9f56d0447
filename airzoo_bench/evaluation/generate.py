"""Making predictions for any track: by its baseline, or at random as an example of the format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.registry import TRACKS, load_track, resolve
from airzoo_bench.evaluation.given import read_truths
from airzoo_bench.evaluation.info import TrackInfo
from airzoo_bench.evaluation.queries import check_npz
from airzoo_bench.evaluation.track import Run
from airzoo_bench.protocol.lookup import find_protocol, protocol_of_track

__all__ = ["Template", "run_baseline", "write_template"]


def run_baseline(
    track: str,
    protocol: str,
    out: Path,
    *,
    data: Path,
    settings: Any = None,
    run: Run = Run(),  # noqa: B008 - frozen
    note: Callable[[str], None] = lambda _: None,
) -> None:
    """Run a track's baseline on a benchmark and write predictions."""
    baseline = TRACKS.get(track).baseline
    if baseline is None:
        raise UsageError(f"the {track} track has no baseline")
    chosen = protocol_of_track(protocol, data, load_track(track).protocol)
    benchmark = find_benchmark(chosen.benchmark, data, sealed=True)
    benchmark.check_fits(chosen)
    with benchmark.fixes():
        predict = resolve(baseline.predict)
        predict(chosen, benchmark, settings or baseline.settings, out, run, note)


@dataclass(frozen=True)
class Template:
    """An example that was written.

    Attributes
    ----------
    track : str
    out : Path
    note : str or None
        What it will score, if known.
    sealed : bool
        Whether the truth is sealed, so that it can only be checked.
    """

    track: str
    out: Path
    note: str | None
    sealed: bool = False


def write_template(
    protocol: str,
    *,
    data: Path,
    out: Path | None = None,
    kind: str | None = None,
    seed: int = 0,
    force: bool = False,
) -> Template:
    """Write an example prediction for a protocol, at random."""
    chosen = find_protocol(protocol, data)
    info: TrackInfo = TRACKS.get(chosen.track)
    if kind is not None and kind not in info.templates:
        raise UsageError(
            f"templates of {info.name} have no kind {kind!r}",
            expected=" or ".join(info.templates) or "no --kind",
        )
    target = out or Path("template" if info.folders else "template.npz")
    _check_target(target, info, force=force)
    benchmark, truths = read_truths(chosen, data, sealed=True)
    kind = kind or (*info.templates, "")[0]
    note = load_track(info.name).template(target, truths, chosen, kind, seed)
    return Template(info.name, target, note, benchmark.is_sealed)


def _check_target(out: Path, info: TrackInfo, *, force: bool) -> None:
    """Refuse, before any work, a place where a template cannot be, or where predictions are."""
    if not info.folders:
        check_npz(out)
        if out.exists() and not out.is_dir() and not force:
            raise UsageError(
                "is there already, and could be a prediction",
                where=out,
                fix="name another file with --out, or add --force",
            )
    elif out.suffix == ".npz" or out.is_file() or (out.is_dir() and any(out.iterdir())):
        what = "is there and not empty" if out.exists() else "is the name of a file"
        raise UsageError(
            f"templates of {info.name} are written as a folder, and this {what}",
            where=out,
            expected="a new folder, such as preds",
            fix="name another with --out",
        )
