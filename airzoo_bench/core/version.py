"""The version of the suite, which results and pictures state, and of what it computes with."""

from __future__ import annotations

import importlib.metadata
from functools import cache

__version__ = "0.1.0.dev0"

_PACKAGES = ("numpy", "scipy", "pandas", "pyproj", "faiss-cpu", "pycolmap", "pykdtree", "laspy")


@cache
def versions() -> dict[str, str]:
    """Return the versions of this package and of those that numbers depend on."""
    found = {name: importlib.metadata.version(name) for name in _PACKAGES}
    return {"airzoo-bench": __version__} | found
