"""The one import of pycolmap."""

from __future__ import annotations

import importlib
import signal
import threading
from functools import cache
from types import ModuleType

__all__ = ["load_pycolmap"]


@cache
def load_pycolmap() -> ModuleType:
    """Import pycolmap, quiet but for warnings, and return the module.

    Its log takes SIGTERM for itself, to print a trace; the handler from before is put back, so that
    a process that is told to end can tidy up.
    """
    before = signal.getsignal(signal.SIGTERM)
    module = importlib.import_module("pycolmap")
    if threading.current_thread() is threading.main_thread() and before is not None:
        signal.signal(signal.SIGTERM, before)
    module.logging.minloglevel = module.logging.Level.WARNING.value
    return module
