"""The only imports of Matplotlib, Open3D and pycolmap, each slow or with a will of its own."""

from __future__ import annotations

import ctypes
import importlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from types import ModuleType
from typing import Any

# Pictures look alike whatever the person has set: a ``matplotlibrc`` in the working folder, the
# person's own, or MPLBACKEND would rule fonts, sizes and whether a picture can be drawn at all.
_BACKEND = "MPLBACKEND"
# What a whole process has, not a picture.
_OF_PROCESS = ("backend", "backend_fallback", "date.epoch", "interactive", "timezone", "toolbar")


@cache
def load_matplotlib() -> ModuleType:
    """Import Matplotlib and return the module."""
    given = os.environ.pop(_BACKEND, None)
    try:
        matplotlib = importlib.import_module("matplotlib")
    finally:
        if given is not None:
            os.environ[_BACKEND] = given
    if given is not None:
        with suppress(ValueError):
            matplotlib.rcParams["backend"] = given
    return matplotlib


@contextmanager
def default_style(changes: dict[str, Any] | None = None) -> Iterator[None]:
    """Draw, or decorate what draws, with Matplotlib's default settings."""
    matplotlib = load_matplotlib()
    defaults = matplotlib.rcParamsDefault
    settings = {name: defaults[name] for name in defaults if name not in _OF_PROCESS}
    with matplotlib.rc_context(settings | (changes or {})):
        yield


@cache
def load_open3d() -> ModuleType:
    """Import Open3D and return the module."""
    if sys.platform == "linux":  # slim machines lack a libusb that Open3D links against
        path = importlib.import_module("libusb_package").get_library_path()
        if path is not None:
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    return importlib.import_module("open3d")


@cache
def load_pycolmap() -> ModuleType:
    """Import pycolmap, which then logs warnings only, and return the module."""
    before = signal.getsignal(signal.SIGTERM)
    module = importlib.import_module("pycolmap")
    if threading.current_thread() is threading.main_thread() and before is not None:
        signal.signal(signal.SIGTERM, before)
    module.logging.minloglevel = module.logging.Level.WARNING.value
    return module
