"""Everything that an object leads to: attributes, properties, items, closures, bases of arrays."""

from __future__ import annotations

import re
import types
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

_NUMBER = re.compile(r"-?\d+\.?\d*")
_LEAVES = (str, bytes, int, float, complex, bool, type, types.ModuleType, np.generic)
# Arguments of none of these are needed, and what they return is what a method is given.
_GIVEN = ("queries", "tiles", "crops", "photos")


def reached(root: object) -> Iterator[object]:
    """Yield every object that `root` leads to, itself too, each once."""
    waiting, seen, kept = [root], set(), []
    while waiting:
        one = waiting.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        kept.append(one)  # so that no other object gets its id
        yield one
        if one is not None and not isinstance(one, _LEAVES):
            waiting += _below(one)


def numbers_of(objects: Iterable[object]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return every number among objects, as text too, sorted, each once."""
    found = [np.zeros(0)]
    for one in objects:
        if isinstance(one, np.ndarray) and one.dtype.kind in "fiu" and one.dtype.itemsize > 1:
            found.append(one.astype(np.float64).ravel())
        elif isinstance(one, int | float | np.number) and not isinstance(one, bool):
            found.append(np.array([one], np.float64))
        elif isinstance(one, str) and _NUMBER.fullmatch(one):
            found.append(np.array([float(one)]))
    return np.unique(np.concatenate(found))


def _below(one: Any) -> list[object]:
    if isinstance(one, np.ndarray):
        return [one.base] if one.dtype.kind != "O" else [one.base, *one.ravel().tolist()]
    if isinstance(one, pd.DataFrame | pd.Series | pd.Index):
        return [one.to_numpy(), *getattr(one, "columns", ())]
    if isinstance(one, dict):
        return [*one.keys(), *one.values()]
    if isinstance(one, partial):
        return [one.func, *one.args, *one.keywords.values()]
    if isinstance(one, types.FunctionType):
        cells = [cell.cell_contents for cell in one.__closure__ or ()]
        return [*cells, *(one.__defaults__ or ()), *(one.__kwdefaults__ or {}).values()]
    if isinstance(one, types.MethodType):
        return [one.__self__, one.__func__]
    items = list(one) if isinstance(one, Sequence | set | frozenset) else []
    return [*items, *_attributes(one)]


def _attributes(one: Any) -> list[object]:
    found: list[object] = [*getattr(one, "__dict__", {}).values()]
    if not type(one).__module__.startswith("airzoo_bench"):
        return found
    for name in dir(type(one)):
        if not name.startswith("__") and isinstance(getattr(type(one), name), property):
            found.append(getattr(one, name))
        elif name in _GIVEN:
            found.append(getattr(one, name)())
    return found
