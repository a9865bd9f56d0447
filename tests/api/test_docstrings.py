"""What is public says what it takes, returns and raises; numpydoc reads it."""

from __future__ import annotations

import inspect
import re
from typing import Any

import pytest
from numpydoc.validate import validate

import airzoo_bench as ab
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.evaluation.track import Track

NAMES = [name for name in ab.__all__ if not name.startswith("_")]
# No summary; parameters missing, unknown, in another order, without type or description; the same
# of what is returned or yielded.
CODES = {"GL08", "SS01", "PR01", "PR02", "PR03", "PR04", "PR07", "RT01", "RT03", "YD01"}


def is_described(thing: Any, parameter: str) -> bool:
    """Whether a class has a section that names what it is made of: its attributes are that."""
    stated = re.search(rf"^(.*, )?{parameter}(,.*)? :", inspect.getdoc(thing) or "", re.MULTILINE)
    noted = f"`{parameter}` is" in (inspect.getdoc(thing) or "")
    return parameter.startswith("_") or noted or bool(stated)


def is_excused(thing: Any, code: str, message: str) -> bool:
    if code != "PR01" or not inspect.isclass(thing):
        return False
    named = re.findall(r"'(\w+)'", message)
    return "__init__" not in vars(thing) or all(is_described(thing, name) for name in named)


@pytest.mark.parametrize("name", NAMES)
def test_it_says_what_it_takes_returns_and_raises(name: str) -> None:
    thing = getattr(ab, name)
    wrong = [
        f"{code}: {message}"
        for code, message in validate(f"{thing.__module__}.{thing.__qualname__}")["errors"]
        if code in CODES and not is_excused(thing, code, message)
    ]
    assert wrong == []
    if inspect.isfunction(thing):
        assert "\nRaises\n------\n" in (inspect.getdoc(thing) or "")


@pytest.mark.parametrize("contract", [Track, Dataset])
def test_a_contract_says_what_its_methods_take(contract: type) -> None:
    """What many methods take is described once, in the class."""
    for name, member in vars(contract).items():
        method = getattr(member, "__func__", getattr(member, "fget", member))
        if not name.startswith("_") and inspect.isfunction(method):
            for parameter in list(inspect.signature(method).parameters)[1:]:
                stated = [is_described(one, parameter) for one in (method, *contract.__mro__)]
                assert any(stated), (method.__qualname__, parameter)
