"""Writing prediction files of a row a query."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write, write_npz

__all__ = ["check_npz", "write_predictions"]


def check_npz(out: Path) -> None:
    """Refuse, before any work, a name that does not say what the file is."""
    if out.suffix != ".npz":
        raise UsageError("predictions are written as .npz", where=out, fix=f"name it {out}.npz")


def write_predictions(out: Path, protocol: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write the arrays of predictions, and the name of their protocol, as one ``.npz``."""
    with atomic_write(out) as stream:
        write_npz(stream, {"protocol": np.array(protocol), **arrays})
