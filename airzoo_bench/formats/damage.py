"""One message for all that libraries raise over a file that is damaged or of another kind."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import PredictionError, UserError

__all__ = ["FIX_COPY", "readable"]

FIX_COPY = "write or copy the file again"
_PANIC = "pyo3_runtime"  # of what Rust raises, which is no Exception and has no name


@contextmanager
def readable(
    path: Path,
    what: str,
    *,
    kind: type[UserError] = PredictionError,
    expected: str | None = None,
    fix: str = FIX_COPY,
) -> Iterator[None]:
    """Turn what a library raises into an error; only calls of libraries may stand in the block."""
    try:
        with warnings.catch_warnings(action="ignore"), np.errstate(all="ignore"):
            yield
    except BaseException as error:
        is_fault = isinstance(error, Exception) or type(error).__module__ == _PANIC
        if isinstance(error, UserError | GeneratorExit) or not is_fault:
            raise
        why = "".join(one if one.isprintable() else " " for one in str(error)[:200]).strip()
        said = f"{what}: {why or type(error).__name__}"
        raise kind(said, where=path, expected=expected, fix=fix) from error
