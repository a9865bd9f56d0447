"""The one place that imports Matplotlib: pictures look alike whatever the person has set.

A ``matplotlibrc`` in the working folder, the person's own, or ``MPLBACKEND`` would rule fonts,
sizes and even whether a picture can be drawn: none of them is followed.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from types import ModuleType
from typing import Any

from airzoo_bench.core.errors import UsageError

__all__ = ["default_style", "load_matplotlib"]

_BACKEND = "MPLBACKEND"
# What a whole process has, not a picture.
_OF_PROCESS = ("backend", "backend_fallback", "date.epoch", "interactive", "timezone", "toolbar")


@cache
def load_matplotlib() -> ModuleType:
    """Import Matplotlib and return the module.

    The environment stays as it was; a backend that it names, if there is such a one, holds for
    windows of the program's own.

    Raises
    ------
    ImportError
        It is not installed.
    UsageError
        It finds a file of settings, and that is no text.
    """
    given = os.environ.pop(_BACKEND, None)
    try:
        matplotlib = importlib.import_module("matplotlib")
    except UnicodeDecodeError as error:
        raise UsageError(
            f"Matplotlib cannot start: its file of settings is no text ({error})",
            fix="remove or correct the matplotlibrc in this folder, or of this user",
        ) from None
    finally:
        if given is not None:
            os.environ[_BACKEND] = given
    if given is not None:
        with suppress(ValueError):
            matplotlib.rcParams["backend"] = given
    return matplotlib


@contextmanager
def default_style(changes: dict[str, Any] | None = None) -> Iterator[None]:
    """Draw, or decorate what draws, with Matplotlib's default settings.

    Parameters
    ----------
    changes : dict, optional
        Settings that differ from the defaults.

    Raises
    ------
    ImportError, UsageError
        See `load_matplotlib`.
    """
    matplotlib = load_matplotlib()
    defaults = matplotlib.rcParamsDefault
    settings = {name: defaults[name] for name in defaults if name not in _OF_PROCESS}
    with matplotlib.rc_context(settings | (changes or {})):
        yield
