"""The one place that imports Open3D: slow to import, and picky about the machine.

Open3D 0.20 links against libusb, which slim machines lack; the wheel ``libusb-package`` carries
it. Loaded with global symbols before the import, it is found.
"""

from __future__ import annotations

import ctypes
import importlib
import sys
from functools import cache
from types import ModuleType

__all__ = ["load_open3d"]


@cache
def load_open3d() -> ModuleType:
    """Import Open3D and return the module.

    Raises
    ------
    ImportError
        It is not installed, or a library that it needs is missing.
    """
    if sys.platform == "linux":
        _load_libusb()
    return importlib.import_module("open3d")


def _load_libusb() -> None:
    import libusb_package

    path = libusb_package.get_library_path()
    if path is not None:
        ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
