"""Files that people write: TOML and JSON into models, mistakes into messages."""

from __future__ import annotations

import datetime
import difflib
import json
import tomllib
from pathlib import Path
from reprlib import Repr
from typing import Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.files import LIMIT_BYTES, read_text

SAFE_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"
"""Names that become folders, parts of ids and cells of tables."""

M = TypeVar("M", bound=BaseModel)

_SHORT = Repr()  # a value nested without end is as short as any
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60
_SHOWN = 5
_OFFERED = 3
_AS_NEAR = 0.1  # of what difflib says: others than the best are offered where they are as near
_MOST_COMPARED = 5000  # names that difflib compares in a quarter of a second
_SHORTEST_PART = 3  # letters; fewer are in too many names


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    if list(values) != sorted(set(values)):
        raise ValueError("must be ascending, without repeats")
    return values


Name = Annotated[str, Field(pattern=SAFE_NAME)]
Positive = Annotated[float, Field(gt=0, le=1e12, allow_inf_nan=False)]
"""Metres, pixels, degrees or seconds: larger ones are slips, and would overflow further on."""
Seed = Annotated[int, Field(ge=0, lt=2**31)]
Count = Annotated[int, Field(ge=1, le=10**9)]
Ranks = Annotated[
    tuple[Annotated[int, Field(ge=1, le=1000)], ...],
    Field(min_length=1, max_length=16),
    AfterValidator(_ascending),
]
Limits = Annotated[
    tuple[Positive, ...], Field(min_length=1, max_length=16), AfterValidator(_ascending)
]


class Strict(BaseModel):
    """A table of a file: no unknown key, no conversion of types, no change afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    @model_validator(mode="before")
    @classmethod
    def _arrays_are_tuples(cls, data: Any) -> Any:
        # TOML has arrays only; strict validation asks for the tuples that keep models immutable.
        if not isinstance(data, dict):
            return data
        return {key: _frozen(value) for key, value in data.items()}


def _frozen(value: Any) -> Any:
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value


def read_toml(
    path: Path, kind: type[UserError], what: str, limit_bytes: int = LIMIT_BYTES
) -> dict[str, Any]:
    """Read a TOML file up to a size, or say what is wrong with it."""
    try:
        return tomllib.loads(read_text(path, kind, what, limit_bytes))
    except (ValueError, RecursionError) as error:  # the latter of values nested too deep
        raise kind(
            f"not valid TOML: {error}",
            where=path,
            expected=f"a {what}",
            fix="correct that place",
        ) from error


def toml_value(value: Any) -> str:
    """Write a value as TOML on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {toml_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, datetime.date):
        return value.isoformat()
    return json.dumps(value, ensure_ascii=False)


def validated(
    data: dict[str, Any], model: type[M], kind: type[UserError], path: Path, what: str
) -> M:
    """Make a model of a file's content, or say which keys are wrong."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        message = validation_message(error, model)
        raise kind(message, where=path, fix=f"correct the {what}") from error


def validation_message(error: ValidationError, model: type[BaseModel]) -> str:
    """Put pydantic's findings into lines that name key, value and expectation."""
    found = error.errors()
    more = [f"and {len(found) - _SHOWN} more"] if len(found) > _SHOWN else []
    return "\n    ".join([*(_finding(item, model) for item in found[:_SHOWN]), *more])


def _finding(item: Any, model: type[BaseModel]) -> str:
    strange = item["type"] == "extra_forbidden"
    # Parts such as "<map>" name which of several tables was chosen, and are no keys.
    *within, last = map(str, item["loc"] or [""])
    parts = [part for part in within if not part.startswith("<")]
    named = ".".join([*parts, last] if strange or not last.startswith("<") else parts)
    key = repr(named[:80])[1:-1]
    said = item["msg"].removeprefix("Value error, ")
    if strange:
        return f"unknown key '{key}'{nearest(str(item['loc'][-1]), _known_keys(model))}"
    if item["type"] == "json_invalid":
        return f"not valid JSON: {item['ctx']['error']}"
    example = _example(item["loc"], model)
    if item["type"] == "missing":
        return f"key '{key}' is missing{example}"
    if not item["loc"]:
        return str(said)
    if isinstance(item["input"], dict) and item["type"] == "value_error":
        return f"key '{key}': {said}"
    given = _SHORT.repr(item["input"])
    shown = given if len(given) <= 60 else given[:57] + "..."
    return f"key '{key}' is {shown}: {said}{example}"


def _example(loc: tuple[int | str, ...], model: type[BaseModel]) -> str:
    """Show what would be right, where the field of a finding has an example."""
    for key in loc:
        field = next((f for n, f in model.model_fields.items() if key in (n, f.alias)), None)
        if field is None:
            return ""
        inner = _models_in(field.annotation)
        if len(inner) != 1 or key == loc[-1]:
            return f" (such as {key} = {toml_value(field.examples[0])})" if field.examples else ""
        model = inner[0]
    return ""


def _known_keys(model: type[BaseModel]) -> list[str]:
    keys: list[str] = []
    for name, field in model.model_fields.items():
        keys.append(field.alias or name)
        for part in _models_in(field.annotation):
            keys += _known_keys(part)
    return keys


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def nearest(name: str, known: list[str], offered: int = _OFFERED) -> str:
    """Offer the known names that are most like a mistyped one, or hold it, for messages."""
    near = near_names(name, known, offered)
    return f" (did you mean {' or '.join(map(repr, near))}?)" if near else ""


def near_names(name: str, known: list[str], offered: int = _OFFERED) -> list[str]:
    """Return the known names that are most like a mistyped one, or hold it."""
    near = [other for other in known if _letters(other) == _letters(name)]
    if not near:
        near = difflib.get_close_matches(name, known[:_MOST_COMPARED], n=offered, cutoff=0.6)
        ratios = [difflib.SequenceMatcher(None, other, name).ratio() for other in near]
        near = [n for n, ratio in zip(near, ratios, strict=True) if ratio > ratios[0] - _AS_NEAR]
    if not near and len(name) >= _SHORTEST_PART:
        near = [other for other in known if name.casefold() in other.casefold()]
    return near[:offered]


def _letters(name: str) -> str:
    """Return a name in the one spelling that UAV-VisLoc, uav_visloc and UAVVisLoc share."""
    return "".join(letter for letter in name.casefold() if letter.isalnum()) or name
