"""Texts of bundles, made of templates; names are escaped for what they stand in."""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping
from functools import cache
from typing import Any

from airzoo_bench.core.errors import UsageError

__all__ = ["rendered", "yaml_text"]


def yaml_text(value: object) -> str:
    """Write a value as JSON that every YAML reader reads as the same value.

    Text keeps its letters, since YAML has no surrogate pairs; what is not printable is replaced,
    since YAML has no such characters.
    """
    return json.dumps(_plain(value), ensure_ascii=False, allow_nan=False)


def _plain(value: object) -> object:
    if isinstance(value, str):
        return "".join(
            c if c.isprintable() or c == "\n" else "\N{REPLACEMENT CHARACTER}" for c in value
        )
    if isinstance(value, Mapping):
        return {str(_plain(key)): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


@cache
def _environment() -> Any:
    try:
        jinja2 = importlib.import_module("jinja2")
        markup = importlib.import_module("markupsafe").Markup
    except ImportError:
        raise UsageError(
            "exports need jinja2, which is not installed",
            fix="pip install 'airzoo-bench[leaderboard]'",
        ) from None
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("airzoo_bench.leaderboard.exports"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["yaml"] = lambda value: markup(yaml_text(value))
    return environment


def rendered(template: str, **values: object) -> str:
    """Fill in a template.

    Parameters
    ----------
    template : str
        Its path below templates/.
    **values
        Escaped as HTML, which Markdown is too; by the filter ``yaml`` as YAML.

    Raises
    ------
    UsageError
        jinja2 is not installed.
    """
    return str(_environment().get_template(template).render(**values))
