"""Plain methods that need no weights, one a track: what `airzoo-bench baseline` runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.options import Option
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.evaluation.resources import Resources
from airzoo_bench.protocol.lookup import protocol_of_track

__all__ = ["DOUBLED", "Baseline", "run_baseline"]

S = TypeVar("S")


DOUBLED = Option("double", "Look for the finest features too, for four times the time.")


@dataclass(frozen=True)
class Baseline(Generic[S]):
    """A plain method of a track.

    Attributes
    ----------
    method : str
        What tables call it.
    summary : str
        What it does, in one sentence, for the help.
    settings : S
        What it takes where nobody says: a dataclass. Fields whose annotation carries an `Option`
        are options of the command.
    demo : S
        What it takes in the demonstration.
    out : str
        What its predictions are called where nobody says.
    out_help : str
    example : str
        A protocol and where to write, for the help.
    predict : callable
        Takes protocol, benchmark, settings, the predictions to write, `Resources`, and a callable
        that takes a sentence on what came of a scene.
    """

    method: str
    summary: str
    settings: S
    demo: S
    out: str
    out_help: str
    example: str
    predict: Callable[[Any, Benchmark, S, Path, Resources, Callable[[str], None]], None]


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
    """Run a track's plain method on a benchmark and write predictions.

    Parameters
    ----------
    track : str
    protocol : str
        Name or path.
    out : Path
        The file or folder to write.
    data : Path
        The benchmark folder, or the folder that holds it.
    settings : optional
        Of the class of the baseline's own.
    resources : Resources
        The predictions do not depend on them.
    note : callable
        Takes a sentence on what came of a scene.

    Raises
    ------
    UserError
        The protocol, the benchmark folder or a picture is not as it must be.
    """
    of = TRACKS.get(track)
    baseline: Baseline[Any] = of.baseline
    chosen = protocol_of_track(protocol, data, of.protocol)
    benchmark = find_benchmark(chosen.benchmark, data)
    benchmark.check_fits(chosen)
    baseline.predict(chosen, benchmark, settings or baseline.settings, out, resources, note)
