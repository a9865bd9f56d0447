"""Writing an example prediction of whatever track."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.evaluation.given import AnyTrack, read_truths
from airzoo_bench.protocol.lookup import find_protocol

__all__ = ["Template", "write_template"]


@dataclass(frozen=True)
class Template:
    """An example that was written: of which track, where, and what it will score if known."""

    track: str
    out: Path
    note: str | None


def write_template(
    protocol: str,
    *,
    data: Path,
    out: Path | None = None,
    kind: str | None = None,
    seed: int = 0,
    force: bool = False,
) -> Template:
    """Write an example prediction for a protocol, at random.

    Parameters
    ----------
    protocol : str
        Name or path.
    data : Path
        The benchmark folder, or the folder that holds it.
    out : Path, optional
        The file or folder to write; by default what the track calls it.
    kind : str, optional
        One of the track's `template_kinds`.
    seed : int
    force : bool
        Write over a file that is there.

    Raises
    ------
    UserError
        The protocol or the benchmark folder is not there, the track has no such kind, or `out`
        cannot be written or could be a prediction.
    """
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
    _, truths = read_truths(track, chosen, data)
    track.write_template(target, chosen, truths, kind or (kinds or ("",))[0], seed)
    return Template(track.name, target, track.template_note(chosen, truths))
