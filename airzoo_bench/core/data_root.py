"""Where benchmark folders lie; apart from what reads them, since every command asks."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["DATA_VARIABLE", "data_root"]

DATA_VARIABLE = "AIRZOO_BENCH_DATA"
"""The variable of the environment that names the folder."""


def data_root() -> Path:
    """Return the folder in which benchmark folders lie: AIRZOO_BENCH_DATA, else a cache folder."""
    named = os.environ.get(DATA_VARIABLE)
    if named:
        return Path(named).expanduser()
    from platformdirs import user_cache_path

    return user_cache_path("airzoo-bench") / "data"
