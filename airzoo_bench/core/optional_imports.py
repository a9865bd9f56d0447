"""The only imports of Open3D and pycolmap, both slow and with a will of their own."""

from __future__ import annotations

import ctypes
import importlib
import signal
import sys
import threading
from functools import cache
from types import ModuleType


@cache
def load_open3d() -> ModuleType:
    """Import Open3D and return the module."""
    if sys.platform == "linux":  # slim machines lack a libusb that Open3D links against
        if path := importlib.import_module("libusb_package").get_library_path():
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    return importlib.import_module("open3d")


@cache
def load_pycolmap() -> ModuleType:
    """Import pycolmap, which then logs errors only and leaves SIGTERM alone."""
    importlib.import_module("PIL._imaging")  # saving a PNG aborts where pycolmap's zlib came first
    before = signal.getsignal(signal.SIGTERM)
    module = importlib.import_module("pycolmap")
    if threading.current_thread() is threading.main_thread() and before is not None:
        signal.signal(signal.SIGTERM, before)
    module.logging.minloglevel = module.logging.Level.ERROR.value
    return module
