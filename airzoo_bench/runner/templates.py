"""Writing an example prediction file of whatever track."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark import find_benchmark
from airzoo_bench.errors import UsageError
from airzoo_bench.files import atomic_write, write_npz
from airzoo_bench.matching.template import match_template
from airzoo_bench.protocol import MatchingProtocol, Protocol, RetrievalProtocol, find_protocol
from airzoo_bench.retrieval.template import descriptor_template, ranked_template
from airzoo_bench.runner.matching import read_matching_truths
from airzoo_bench.runner.retrieval import read_truths

__all__ = ["write_template"]

_MATCHES = 20


def write_template(
    protocol: str, *, data: Path, out: Path, descriptors: bool = False, seed: int = 0
) -> str:
    """Write an example prediction file for a protocol, at random.

    Parameters
    ----------
    protocol : str
        Name or path.
    data : Path
        The benchmark folder, or the folder that holds it.
    out : Path
        The ``.npz`` to write.
    descriptors : bool
        Descriptors instead of ranked ids; for retrieval only.
    seed : int

    Returns
    -------
    str
        The track.

    Raises
    ------
    UserError
        The protocol or the benchmark folder is not there, or `out` does not end in ``.npz``.
    """
    if out.suffix != ".npz":
        raise UsageError("templates are written as .npz", where=out, mend=f"name it {out}.npz")
    chosen = find_protocol(protocol, data)
    arrays = _arrays(chosen, data, seed, descriptors=descriptors)
    with atomic_write(out) as stream:
        write_npz(stream, {"protocol": np.array(chosen.name), **arrays})
    return chosen.track


def _arrays(
    chosen: Protocol, data: Path, seed: int, *, descriptors: bool
) -> dict[str, NDArray[Any]]:
    benchmark = find_benchmark(chosen.benchmark, data)
    if isinstance(chosen, MatchingProtocol):
        if descriptors:
            raise UsageError("--kind descriptors is for retrieval", expected="a retrieval protocol")
        return match_template(read_matching_truths(benchmark, chosen), _MATCHES, seed)
    if not isinstance(chosen, RetrievalProtocol):
        raise TypeError(f"no template for {type(chosen).__name__}")
    truths = read_truths(benchmark, chosen)
    if descriptors:
        return descriptor_template(truths, seed)
    return ranked_template(truths, max(chosen.scores.ndcg_at), seed)
