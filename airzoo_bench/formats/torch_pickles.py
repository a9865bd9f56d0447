"""Pickles of tensors, interpreted opcode by opcode: nothing is imported, nothing is called.

Only the opcodes are known that dictionaries of numbers, texts and tensors are made of, and only the
names that PyTorch gives tensors; whatever else stands in a pickle is refused.
"""

from __future__ import annotations

import math
import pickletools
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Storage", "UnreadableError", "unpickled"]

_MOST_OPCODES = 100_000
_MOST_DIMENSIONS = 8
_STORAGES = {
    "HalfStorage": "f2",
    "FloatStorage": "f4",
    "DoubleStorage": "f8",
    "ByteStorage": "u1",
    "CharStorage": "i1",
    "ShortStorage": "i2",
    "IntStorage": "i4",
    "LongStorage": "i8",
}
_REBUILD, _ORDERED = ("torch._utils", "_rebuild_tensor_v2"), ("collections", "OrderedDict")
_VALUES = {"BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT", "BINUNICODE", "SHORT_BINUNICODE"}
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_TUPLES = {"EMPTY_TUPLE": 0, "TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
_IGNORED = {"PROTO", "FRAME", "STOP"}
_PUTS, _GETS = {"BINPUT", "LONG_BINPUT"}, {"BINGET", "LONG_BINGET"}


class UnreadableError(Exception):
    """What a pickle of tensors does not hold."""


@dataclass(frozen=True)
class Storage:
    """The numbers that tensors are views of.

    Attributes
    ----------
    key : str
        Its name in the file.
    kind : str
        Type and bytes of a number, as NumPy has them, without the order of bytes.
    count : int
    """

    key: str
    kind: str
    count: int


Numbers = Callable[[Storage], NDArray[Any]]


def unpickled(pickled: bytes, numbers: Numbers, limit_bytes: int) -> Any:
    """Return what a pickle makes.

    Parameters
    ----------
    pickled : bytes
    numbers : callable
        Takes a storage, which is not checked, and returns its numbers as one row.
    limit_bytes : int
        The most that all tensors together may take.

    Raises
    ------
    UnreadableError
        It holds anything but dictionaries, lists, tuples, numbers, texts and tensors.
    ValueError
        It is damaged.
    """
    return _Interpreter(numbers, limit_bytes).run(pickled)


@dataclass(frozen=True)
class _Global:
    """A name that the pickle mentions; it stands for nothing but itself."""

    module: str
    name: str


_MARK = object()


class _Interpreter:
    """Runs the few opcodes that dictionaries of tensors need, on a stack of its own."""

    def __init__(self, numbers: Numbers, limit_bytes: int) -> None:
        self._numbers, self._limit_bytes = numbers, limit_bytes
        self._stack: list[Any] = []
        self._memo: dict[int, Any] = {}
        self._flat: dict[Storage, NDArray[Any]] = {}
        self._bytes = 0

    def run(self, pickled: bytes) -> Any:
        """Return what the pickle makes."""
        with warnings.catch_warnings(action="ignore"):  # of escapes in texts
            for number, (opcode, argument, _) in enumerate(pickletools.genops(pickled)):
                if number >= _MOST_OPCODES:
                    raise UnreadableError(f"its pickle has more than {_MOST_OPCODES:,} opcodes")
                self._step(opcode.name, argument)
        if len(self._stack) != 1:
            raise UnreadableError("its pickle leaves no single value")
        return self._stack[0]

    def _step(self, name: str, argument: Any) -> None:
        if name in _VALUES:
            self._stack.append(argument)
        elif name in _CONSTANTS:
            self._stack.append(_CONSTANTS[name])
        elif name in _TUPLES:
            self._stack.append(tuple(self._popped(_TUPLES[name])))
        elif name in _PUTS:
            self._memo[argument] = self._top()
        elif name in _GETS:
            self._stack.append(self._recalled(argument))
        elif name not in _IGNORED:
            self._act(name, argument)

    def _act(self, name: str, argument: Any) -> None:
        acts: dict[str, Callable[[], None]] = {
            "MARK": lambda: self._stack.append(_MARK),
            "EMPTY_DICT": lambda: self._stack.append({}),
            "EMPTY_LIST": lambda: self._stack.append([]),
            "TUPLE": lambda: self._stack.append(tuple(self._since_mark())),
            "APPEND": lambda: self._extend(self._popped(1)),
            "APPENDS": lambda: self._extend(self._since_mark()),
            "SETITEM": lambda: self._update(self._popped(2)),
            "SETITEMS": lambda: self._update(self._since_mark()),
            "MEMOIZE": lambda: self._memo.update({len(self._memo): self._top()}),
            "GLOBAL": lambda: self._name(str(argument).split(" ", 1)),
            "STACK_GLOBAL": lambda: self._name(self._popped(2)),
            "BINPERSID": lambda: self._stack.append(_storage(self._popped(1)[0])),
            "REDUCE": lambda: self._stack.append(self._made(*self._popped(2))),
        }
        if name not in acts:
            raise UnreadableError(f"its pickle has the opcode {name}, which tensors do not need")
        acts[name]()

    def _top(self) -> Any:
        if not self._stack or self._stack[-1] is _MARK:
            raise UnreadableError("its pickle is damaged: nothing is on the stack")
        return self._stack[-1]

    def _popped(self, count: int) -> list[Any]:
        values = self._stack[len(self._stack) - count :] if count else []
        if len(values) < count or any(value is _MARK for value in values):
            raise UnreadableError("its pickle is damaged: too little is on the stack")
        del self._stack[len(self._stack) - count :]
        return values

    def _since_mark(self) -> list[Any]:
        values: list[Any] = []
        while self._stack:
            value = self._stack.pop()
            if value is _MARK:
                return values[::-1]
            values.append(value)
        raise UnreadableError("its pickle is damaged: a mark is missing")

    def _recalled(self, key: int) -> Any:
        if key not in self._memo:
            raise UnreadableError("its pickle is damaged: it recalls what was never stored")
        return self._memo[key]

    def _name(self, parts: list[Any]) -> None:
        if len(parts) != 2 or not all(isinstance(part, str) for part in parts):
            raise UnreadableError("its pickle is damaged: a name is none")
        found = _Global(*parts)
        known = (found.module, found.name) in (_REBUILD, _ORDERED)
        if not known and not (found.module == "torch" and found.name in _STORAGES):
            named = f"{found.module}.{found.name}"[:80]
            raise UnreadableError(f"its pickle names {named!r}, which is no tensor of numbers")
        self._stack.append(found)

    def _extend(self, values: list[Any]) -> None:
        if not isinstance(self._top(), list):
            raise UnreadableError("its pickle is damaged: it appends to no list")
        self._top().extend(values)

    def _update(self, values: list[Any]) -> None:
        target, keys = self._top(), values[::2]
        if not isinstance(target, dict) or len(values) % 2:
            raise UnreadableError("its pickle is damaged: it fills no dictionary")
        if not all(isinstance(key, str) for key in keys):
            raise UnreadableError("a key of its dictionary is no text")
        target.update(zip(keys, values[1::2], strict=True))

    def _made(self, function: Any, arguments: Any) -> Any:
        if function == _Global(*_ORDERED) and arguments == ():
            return {}
        if function == _Global(*_REBUILD):
            return self._tensor(*_described(arguments))
        raise UnreadableError("its pickle calls something that makes no tensor")

    def _tensor(
        self, storage: Storage, offset: int, shape: tuple[int, ...], strides: tuple[int, ...]
    ) -> NDArray[Any]:
        flat = self._flat.get(storage)
        if flat is None:
            flat = self._flat[storage] = self._numbers(storage)
        self._bytes += math.prod(shape) * flat.itemsize
        if self._bytes > self._limit_bytes:
            raise UnreadableError(f"its tensors take more than {self._limit_bytes:,} bytes")
        steps = [stride * flat.itemsize for stride in strides]
        return np.lib.stride_tricks.as_strided(flat[offset:], shape, steps).copy()


def _storage(identity: Any) -> Storage:
    match identity:
        case ("storage", _Global("torch", name), str(key), str(), int(count)) if name in _STORAGES:
            return Storage(key, _STORAGES[name], count)
    raise UnreadableError("a tensor's numbers are not where torch.save puts them")


def _described(arguments: Any) -> tuple[Storage, int, tuple[int, ...], tuple[int, ...]]:
    """Return where a tensor's numbers are, the first, its shape and its strides."""
    match arguments:
        case (Storage() as storage, int(offset), tuple(shape), tuple(strides), *_):
            last = _last_index(offset, shape, strides)
        case _:
            raise UnreadableError("a tensor is not described as torch.save does")
    if not last < storage.count or math.prod(shape) > storage.count:
        raise UnreadableError("a tensor is larger than its numbers")
    return storage, offset, shape, strides


def _last_index(offset: int, shape: tuple[Any, ...], strides: tuple[Any, ...]) -> int:
    """Return the largest index that a tensor reaches, after checking that all are counts."""
    numbers = (offset, *shape, *strides)
    counts = all(type(number) is int and 0 <= number < 1 << 31 for number in numbers)
    if not counts or len(shape) != len(strides) or len(shape) > _MOST_DIMENSIONS:
        raise UnreadableError("a tensor has an impossible shape")
    steps = zip(shape, strides, strict=True)
    return int(offset + sum(max(count - 1, 0) * step for count, step in steps))
