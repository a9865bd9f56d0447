"""Files laid out as ``torch.save`` lays them out, made without PyTorch."""

from __future__ import annotations

import io
import pickle
import sys
import zipfile
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

_NAMES = {"<f4": "FloatStorage", "<f8": "DoubleStorage", "<i8": "LongStorage"}


class Tensor:
    """An array that is pickled as PyTorch pickles a tensor."""

    def __init__(self, values: Any, kind: str = "<f4", base: np.ndarray | None = None) -> None:
        self.values = np.asarray(values, kind)
        self.base = self.values.ravel() if base is None else base

    def __reduce__(self) -> tuple[Any, ...]:
        values = self.values
        shares = np.shares_memory(values, self.base)
        start = values.__array_interface__["data"][0] - self.base.__array_interface__["data"][0]
        strides = tuple(step // values.itemsize for step in values.strides)
        offset = start // values.itemsize if shares else 0
        arguments = (_Storage(self.base), offset, values.shape, strides, False, OrderedDict())
        return sys.modules["torch._utils"]._rebuild_tensor_v2, arguments


class _Storage:
    def __init__(self, base: np.ndarray) -> None:
        self.base = base


class _Pickler(pickle.Pickler):
    def __init__(self, stream: io.BytesIO, protocol: int, torch: ModuleType) -> None:
        super().__init__(stream, protocol)
        self.torch, self.storages = torch, []

    def persistent_id(self, thing: Any) -> Any:
        if not isinstance(thing, _Storage):
            return None
        keys = [id(base) for base in self.storages]
        if id(thing.base) not in keys:
            self.storages.append(thing.base)
        key = [id(base) for base in self.storages].index(id(thing.base))
        kind = getattr(self.torch, _NAMES[thing.base.dtype.str])
        return ("storage", kind, str(key), "cpu", thing.base.size)


def _stand_in() -> dict[str, ModuleType]:
    """Modules whose names are those that PyTorch's pickles mention."""
    torch, utils = ModuleType("torch"), ModuleType("torch._utils")
    for name in _NAMES.values():
        setattr(torch, name, type(name, (), {"__module__": "torch"}))

    def rebuild(*arguments: Any) -> None: ...

    rebuild.__module__, rebuild.__qualname__ = "torch._utils", "_rebuild_tensor_v2"
    rebuild.__name__ = "_rebuild_tensor_v2"
    utils._rebuild_tensor_v2 = rebuild  # type: ignore[attr-defined]
    return {"torch": torch, "torch._utils": utils}


def pickled(content: Any, protocol: int = 2) -> tuple[bytes, list[np.ndarray]]:
    """Pickle a value as torch.save does; returns the storages as well."""
    modules = _stand_in()
    kept = {name: sys.modules.get(name) for name in modules}
    sys.modules.update(modules)
    try:
        stream = io.BytesIO()
        pickler = _Pickler(stream, protocol, modules["torch"])
        pickler.dump(content)
    finally:
        for name, module in kept.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module
    return stream.getvalue(), pickler.storages


def save(path: Path, content: Mapping[str, Any], protocol: int = 2) -> Path:
    """Write what ``torch.save(content, path)`` writes."""
    data, storages = pickled(dict(content), protocol)
    members = {"data.pkl": data, "byteorder": b"little"}
    members |= {f"data/{key}": base.tobytes() for key, base in enumerate(storages)}
    return write_members(path, members | {"version": b"3\n"})


def write_members(
    path: Path, members: Mapping[str, bytes], compression: int = zipfile.ZIP_STORED
) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in members.items():
            archive.writestr(f"{path.stem}/{name}", data)
    return path
