"""Checking a prediction file of whatever track, without truth."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.evaluation.common import Checked
from airzoo_bench.formats.archives import ARCHIVE_SUFFIXES
from airzoo_bench.formats.arrays import open_arrays, protocol_name
from airzoo_bench.formats.clouds.formats import SUFFIXES
from airzoo_bench.protocol.lookup import find_protocol

__all__ = ["check_predictions"]

_OTHER_KINDS = (".npz", ".parquet", ".txt")
_OF_RECONSTRUCTION = {"depth", "world_points", "points"}


def check_predictions(
    path: Path, *, data: Path, protocol: str | None, memory_bytes: int
) -> Checked:
    """Find all that is wrong with a prediction file.

    Parameters
    ----------
    path : Path
    data : Path
        The benchmark folder, or the folder that holds it; it need not be there.
    protocol : str, optional
        Name or path; by default the file's own. It says which track the file is of.
    memory_bytes : int
        The most that one array of the file may take.

    Raises
    ------
    UserError
        The file is not there or is none of its kind, or no protocol is known for it.
    """
    from airzoo_bench.matching.track import check_matching
    from airzoo_bench.reconstruction.track import check_reconstruction
    from airzoo_bench.retrieval.track import check_retrieval

    tracks = {
        "retrieval": check_retrieval,
        "matching": check_matching,
        "reconstruction": check_reconstruction,
    }
    try:
        check = tracks[_track(path, data, protocol, memory_bytes)]
        return check(path, data=data, protocol=protocol, memory_bytes=memory_bytes)
    except UnreadableError:
        raise
    except PredictionError as fault:
        return Checked([fault], [])


def _track(path: Path, data: Path, protocol: str | None, memory_bytes: int) -> str:
    """Find the track of a prediction by its protocol, else by what kind of file it is."""
    name = path.name.lower()
    if path.is_file() and not name.endswith((*_OTHER_KINDS, *SUFFIXES, *ARCHIVE_SUFFIXES)):
        raise UnreadableError(
            f"no kind of file that predictions come in: {path.suffix[:20]!r}",
            where=path,
            expected="retrieval: .npz or .parquet; matching: .npz or .txt; reconstruction: a "
            f"folder, an archive, or {', '.join(SUFFIXES)}",
            mend="`airzoo-bench template` writes an example",
        )
    if path.suffix == ".txt":
        return "matching"
    fields: set[str] = set()
    if path.is_file() and path.suffix == ".npz":
        arrays = open_arrays(path, memory_bytes)
        fields = arrays.names()
        protocol = protocol or protocol_name(arrays)
    if protocol is not None:
        return find_protocol(protocol, data).track
    if fields & _OF_RECONSTRUCTION:
        return "reconstruction"
    is_table = path.suffix in (".npz", ".parquet") or not path.exists()
    return "retrieval" if is_table else "reconstruction"
