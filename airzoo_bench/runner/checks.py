"""Checking a prediction file of whatever track, without truth."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.protocol import MatchingProtocol, find_protocol
from airzoo_bench.readers.arrays import open_arrays, protocol_name
from airzoo_bench.runner.common import Checked

__all__ = ["check_predictions"]


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
        The file cannot be read at all, or the protocol is unknown.
    """
    from airzoo_bench.runner.matching import check_matching
    from airzoo_bench.runner.retrieval import check_retrieval

    check = check_matching if _is_matching(path, data, protocol, memory_bytes) else check_retrieval
    return check(path, data=data, protocol=protocol, memory_bytes=memory_bytes)


def _is_matching(path: Path, data: Path, protocol: str | None, memory_bytes: int) -> bool:
    if path.suffix == ".txt":
        return True
    if protocol is None and path.suffix == ".npz":
        protocol = protocol_name(open_arrays(path, memory_bytes))
    return protocol is not None and isinstance(find_protocol(protocol, data), MatchingProtocol)
