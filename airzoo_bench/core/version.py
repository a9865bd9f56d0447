"""The versions of the suite and of its libraries, stated in results."""

from __future__ import annotations

from functools import cache
from importlib import metadata

__version__ = "0.1.0.dev0"
_PACKAGES = ("numpy", "scipy", "pandas", "pyproj", "faiss-cpu", "pycolmap", "pykdtree", "laspy")


@cache
def versions() -> dict[str, str]:
    """Return the versions of this package and of the libraries behind its numbers."""
    return {"airzoo-bench": __version__} | {name: metadata.version(name) for name in _PACKAGES}
