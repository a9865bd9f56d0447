"""Making predictions for any track: by its baseline, or at random as an example of the format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.registry import TRACKS, resolve
from airzoo_bench.evaluation.given import AnyTrack, read_truths
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.protocol.lookup import find_protocol, protocol_of_track

__all__ = ["Template", "run_baseline", "write_template"]


def run_baseline(
    track: str,
    protocol: str,
    out: Path,
    *,
    data: Path,
    settings: Any = None,
    resources: Resources = Resources(),  # noqa: B008 - frozen
    note: Callable[[str], None] = lambda _: None,
) -> None:
    """Run a track's baseline on a benchmark and write predictions."""
    of: AnyTrack = TRACKS.get(track)
    if of.baseline is None:
        raise UsageError(f"the {track} track has no baseline")
    chosen = protocol_of_track(protocol, data, of.protocol)
    benchmark = find_benchmark(chosen.benchmark, data, sealed=True)
    benchmark.check_fits(chosen)
    with benchmark.fixes():
        predict = resolve(of.baseline.predict)
        predict(chosen, benchmark, settings or of.baseline.settings, out, resources, note)


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
    track: AnyTrack = TRACKS.get(chosen.track)
    kinds = track.template_kinds
    if kind is not None and kind not in kinds:
        raise UsageError(
            f"templates of {track.name} have no kind {kind!r}",
            expected=" or ".join(kinds) if kinds else "no --kind",
        )
    target = out or Path(track.template_out)
    track.check_template_path(target, force=force)
    benchmark, truths = read_truths(track, chosen, data, sealed=True)
    track.write_template(target, chosen, truths, kind or (kinds or ("",))[0], seed)
    note = track.template_note(chosen, truths)
    return Template(track.name, target, note, benchmark.is_sealed)
