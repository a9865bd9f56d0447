"""Writing an example prediction file of whatever track."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.matching.template import match_template
from airzoo_bench.matching.track import read_matching_truths
from airzoo_bench.protocol.lookup import (
    MatchingProtocol,
    Protocol,
    ReconstructionProtocol,
    RetrievalProtocol,
    find_protocol,
)
from airzoo_bench.reconstruction.template import depth_template
from airzoo_bench.reconstruction.track import read_reconstruction_truths
from airzoo_bench.retrieval.template import descriptor_template, ranked_template
from airzoo_bench.retrieval.track import read_truths

__all__ = ["write_template"]

_MATCHES = 20


def write_template(
    protocol: str,
    *,
    data: Path,
    out: Path,
    descriptors: bool = False,
    seed: int = 0,
    force: bool = False,
) -> str:
    """Write an example prediction file for a protocol, at random.

    Parameters
    ----------
    protocol : str
        Name or path.
    data : Path
        The benchmark folder, or the folder that holds it.
    out : Path
        The ``.npz`` to write; for reconstruction the folder.
    descriptors : bool
        Descriptors instead of ranked ids; for retrieval only.
    seed : int
    force : bool
        Write over a file that is there.

    Returns
    -------
    str
        The track.

    Raises
    ------
    UserError
        The protocol or the benchmark folder is not there, `out` does not end in ``.npz``, is there
        already, or is a folder that holds something.
    """
    chosen = find_protocol(protocol, data)
    if isinstance(chosen, ReconstructionProtocol):
        _refuse_descriptors(descriptors)
        _write_folder(chosen, data, out, seed)
        return chosen.track
    if out.suffix != ".npz":
        raise UsageError("templates are written as .npz", where=out, mend=f"name it {out}.npz")
    if out.exists() and not out.is_dir() and not force:
        raise UsageError(
            "is there already, and could be a prediction",
            where=out,
            mend="name another file with --out, or add --force",
        )
    arrays = _arrays(chosen, data, seed, descriptors=descriptors)
    with atomic_write(out) as stream:
        write_npz(stream, {"protocol": np.array(chosen.name), **arrays})
    return chosen.track


def _arrays(
    chosen: Protocol, data: Path, seed: int, *, descriptors: bool
) -> dict[str, NDArray[Any]]:
    benchmark = find_benchmark(chosen.benchmark, data)
    if isinstance(chosen, MatchingProtocol):
        _refuse_descriptors(descriptors)
        return match_template(read_matching_truths(benchmark, chosen), _MATCHES, seed)
    if not isinstance(chosen, RetrievalProtocol):
        raise TypeError(f"no template for {type(chosen).__name__}")
    truths = read_truths(benchmark, chosen)
    if descriptors:
        return descriptor_template(truths, seed)
    return ranked_template(truths, chosen.scores.ranks_kept, seed)


def _refuse_descriptors(descriptors: bool) -> None:
    if descriptors:
        raise UsageError("--kind descriptors is for retrieval", expected="a retrieval protocol")


def _write_folder(chosen: ReconstructionProtocol, data: Path, out: Path, seed: int) -> None:
    if out.suffix == ".npz" or out.is_file() or (out.is_dir() and any(out.iterdir())):
        what = "is there and not empty" if out.exists() else "is the name of a file"
        raise UsageError(
            f"templates of reconstruction are written as a folder, and this {what}",
            where=out,
            expected="a new folder, such as preds",
            mend="name another with --out",
        )
    truths = read_reconstruction_truths(find_benchmark(chosen.benchmark, data), chosen)
    for number, truth in enumerate(truths):
        with atomic_write(out / f"{truth.scene}.npz") as stream:
            write_npz(stream, depth_template(truth, seed + number))
    with atomic_write(out / "protocol.txt", "w") as text:
        text.write(chosen.name + "\n")
