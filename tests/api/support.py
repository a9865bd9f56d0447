"""Assertions that tests of the face share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import airzoo_bench as ab


def refused(call: Callable[..., Any], *arguments: Any, where: str, **options: Any) -> str:
    """Call, and return the message of the refusal, which names the argument and what it expects."""
    with pytest.raises(ab.ArgumentError) as caught:
        call(*arguments, **options)
    assert isinstance(caught.value, ValueError)
    assert caught.value.where is not None
    assert where in caught.value.where
    assert caught.value.expected or caught.value.fix
    return str(caught.value)
