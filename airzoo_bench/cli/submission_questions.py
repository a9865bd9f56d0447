"""What options of ``submission new`` become, and the questions for those that are missing."""

from __future__ import annotations

import datetime
import sys
from collections.abc import Sequence
from typing import Any, get_args

import typer
from pydantic import BaseModel, TypeAdapter, ValidationError

from airzoo_bench.core.errors import SubmissionError, UsageError
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import nearest, toml_value
from airzoo_bench.leaderboard.submission import Pipeline, Submission

__all__ = ["complete"]

_REQUIRED = (
    "protocol",
    "method",
    "team",
    "contact",
    "authors",
    "licence",
    "training_data",
    "stages",
)
_LISTS = ("authors", "training_data")
_FLAGS = {"authors": "--author"}
_NONE = (["none"], ["[]"])
"""What a method without training answers; the second is how submission.toml has it."""


def complete(given: dict[str, Any], protocols: Sequence[str]) -> dict[str, Any]:
    """Return the keys of submission.toml, once what is missing was asked for.

    Parameters
    ----------
    given : dict
        The options, None where one is missing.
    protocols : sequence of str
        Those of the board.

    Raises
    ------
    UsageError
        Something is missing, and there is no terminal to ask on.
    """
    missing = [key for key in _REQUIRED if given[key] is None]
    if missing and not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise UsageError(
            f"missing: {', '.join(_FLAGS.get(key, _flag(key)) for key in missing)}",
            expected="\n            ".join(
                f"{_FLAGS.get(key, _flag(key))}: {_field(key).description}" for key in missing
            ),
            fix="add these options, or call it on a terminal, where it asks",
        )
    if missing:
        given = given | {key: _asked(key, _choices(key, protocols)) for key in missing}
    return _values(given)


def _flag(key: str) -> str:
    return f"--{key.replace('_', '-')}"


def _field(key: str) -> Any:
    models: tuple[type[BaseModel], ...] = (Submission, Pipeline)
    return next(model.model_fields[key] for model in models if key in model.model_fields)


def _choices(key: str, protocols: Sequence[str]) -> Sequence[str]:
    """Return all right answers, where there are only some."""
    return protocols if key == "protocol" else _literals(_field(key).annotation)


def _literals(annotation: Any) -> list[str]:
    inner = get_args(annotation)
    return [text for one in inner for text in ([one] if isinstance(one, str) else _literals(one))]


def _asked(key: str, choices: Sequence[str]) -> Any:
    """Ask until the answer is right."""
    field = _field(key)
    typer.echo(f"\n{field.description} ({_hints(key, field, choices)})", err=True)
    adapter: TypeAdapter[Any] = TypeAdapter(field.rebuild_annotation())
    while True:
        try:
            answer = typer.prompt(key, default="", show_default=False, err=True)
        except typer.Abort:  # Ctrl-C, or the end of the input
            raise KeyboardInterrupt from None
        value = _split(answer) if key in _LISTS else answer.strip()
        if not value or (choices and value not in choices):
            expected = _hints(key, field, choices)
            typer.echo(f"  {toml_value(answer)}{nearest(answer, [*choices])}: {expected}", err=True)
            continue
        try:
            adapter.validate_python(tuple(_listed(key, value)) if key in _LISTS else value)
        except ValidationError as error:
            said = error.errors()[0]["msg"].removeprefix("Value error, ")
            typer.echo(f"  {toml_value(answer)}: {said}", err=True)
            continue
        return value


def _hints(key: str, field: Any, choices: Sequence[str]) -> str:
    example = field.examples[0]
    plain = ", ".join(example) if isinstance(example, list) else toml_value(example).strip('"')
    hints = [
        f"one of {', '.join(choices)}" if choices else f"such as {plain}",
        "several with commas" if key in _LISTS else "",
        "none for a method without training" if key == "training_data" else "",
    ]
    return "; ".join(filter(None, hints))


def _split(answer: str) -> list[str]:
    return [part.strip() for part in answer.split(",") if part.strip()]


def _listed(key: str, value: list[str] | None) -> list[str]:
    return [] if value is None or (key == "training_data" and value in _NONE) else value


def _values(given: dict[str, Any]) -> dict[str, Any]:
    """Turn options into keys: tables, lists, and nothing for what was not given."""
    cost = {key: given[key] for key in ("hardware", "seconds_per_query", "memory_gb")}
    values = {key: value for key, value in given.items() if key not in (*cost, "stages", "uses")}
    values |= {key: _listed(key, given[key]) for key in ("authors", "training_data")}
    values["pipeline"] = {"stages": given["stages"], "uses": _listed("uses", given["uses"])}
    values["cost"] = _without_none(cost) or None
    values["date"] = _date(given["date"])
    if given["bibtex"] is not None:
        values["bibtex"] = read_text(given["bibtex"], SubmissionError, "BibTeX file").strip()
    if given["baseline"] is not None:
        values["baseline"] = dict(map(_setting, given["baseline"]))
    return _without_none(values)


def _without_none(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def _date(text: str | None) -> datetime.date:
    if text is None:
        return datetime.datetime.now(datetime.UTC).date()
    try:
        return datetime.date.fromisoformat(text)
    except ValueError:
        raise UsageError(f"--date {text!r} is no date", expected="such as 2026-11-22") from None


def _setting(text: str) -> tuple[str, bool | int | float]:
    name, _, value = text.partition("=")
    words = {"true": True, "false": False}
    if value in words:
        return name, words[value]
    for kind in (int, float):
        try:
            return name, kind(value)
        except ValueError:
            continue
    raise UsageError(f"--setting {text!r} is no setting", expected="such as words=16")
