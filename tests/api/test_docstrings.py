"""What is public says what it takes, returns and raises; numpydoc reads it.

Public are the names of `airzoo_bench`, what other packages implement or register with, and the
modules of scores' formulas.
"""

from __future__ import annotations

import ast
import dataclasses
import enum
import inspect
import re
import textwrap
from collections.abc import Iterator
from typing import Any

import pytest
from numpydoc.validate import validate

import airzoo_bench as ab
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.evaluation.track import Track

CONTRACTS = (Track, Dataset)
# No summary; parameters missing, unknown, in another order, without type or description; the same
# of what is returned or yielded.
CODES = {"GL08", "SS01", "PR01", "PR02", "PR03", "PR04", "PR07", "RT01", "RT03", "YD01"}


def members(thing: Any) -> Iterator[Any]:
    """Yield a function, or a class and the public methods that are its own."""
    yield thing
    for name, member in vars(thing).items() if inspect.isclass(thing) else ():
        inherited = any(hasattr(base, name) for base in thing.__mro__[1:])
        if not (name.startswith("_") or inherited):
            function = getattr(member, "__func__", getattr(member, "fget", member))
            if inspect.isfunction(function):
                yield function


def public() -> dict[str, Any]:
    """Return all that is public, by its full name."""
    things = [getattr(ab, name) for name in ab.__all__ if name != "__version__"]
    own = [thing for thing in things if getattr(thing, "__qualname__", None)]
    return {f"{one.__module__}.{one.__qualname__}": one for one in own}


PUBLIC = {name: one for name, one in public().items() if name.startswith("airzoo_bench.")}


def is_described(thing: Any, parameter: str) -> bool:
    """Whether a class has a section that names what it is made of: its attributes are that."""
    stated = re.search(rf"^(.*, )?{parameter}(,.*)? :", inspect.getdoc(thing) or "", re.MULTILINE)
    noted = f"`{parameter}` is" in (inspect.getdoc(thing) or "")
    return parameter.startswith("_") or noted or bool(stated)


def is_excused(thing: Any, code: str, message: str) -> bool:
    if code != "PR01" or not inspect.isclass(thing):
        return False
    if issubclass(thing, enum.Enum) or "__init__" not in vars(thing):
        return True
    named = re.findall(r"'(\w+)'", message)
    return dataclasses.is_dataclass(thing) and all(is_described(thing, name) for name in named)


def raises(thing: Any) -> bool:
    """Whether the body of a function raises an error of its own."""
    if inspect.isclass(thing):
        return False
    tree = ast.parse(textwrap.dedent(inspect.getsource(thing)))
    return any(isinstance(node, ast.Raise) and node.exc for node in ast.walk(tree))


@pytest.mark.parametrize("name", list(PUBLIC))
def test_it_says_what_it_takes_returns_and_raises(name: str) -> None:
    thing = PUBLIC[name]
    wrong = [
        f"{code}: {message}"
        for code, message in validate(name)["errors"]
        if code in CODES and not is_excused(thing, code, message)
    ]
    assert wrong == []
    may_raise = raises(thing) or (inspect.isfunction(thing) and thing.__name__ in ab.__all__)
    assert not may_raise or "\nRaises\n------\n" in (inspect.getdoc(thing) or ""), "Raises"


@pytest.mark.parametrize("contract", CONTRACTS)
def test_a_contract_says_what_its_methods_take(contract: type) -> None:
    """What many methods take is described once, in the class."""
    for method in list(members(contract))[1:]:
        for parameter in list(inspect.signature(method).parameters)[1:]:
            stated = [is_described(one, parameter) for one in (method, *contract.__mro__)]
            assert any(stated), (method.__qualname__, parameter)
