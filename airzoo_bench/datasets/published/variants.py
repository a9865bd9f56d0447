"""Protocols that differ from a shipped one by what an option asks for, under another name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from airzoo_bench.protocol.model import Protocol

__all__ = ["variant_of"]

P = TypeVar("P", bound=Protocol)


def variant_of(base: P, benchmark: str, changes: Mapping[str, Mapping[str, Any]]) -> P:
    """Return a protocol with some values changed; the base itself where its benchmark is that."""
    if benchmark == base.benchmark:
        return base
    values = base.model_dump(by_alias=True)
    added = benchmark.removeprefix(base.benchmark).strip("-").replace("-", " ")
    values |= {"name": f"{benchmark}-{base.track}", "benchmark": benchmark}
    values["title"] = f"{base.title} ({added})"
    for section, keys in changes.items():
        values[section] = values[section] | keys
    return type(base).model_validate(values)
