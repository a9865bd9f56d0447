"""Files that people write: TOML and JSON into models, mistakes into messages."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from reprlib import repr as repr_short
from typing import Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from airzoo_bench.core.errors import UserError, readable
from airzoo_bench.core.files import LIMIT_BYTES, read_text

M = TypeVar("M", bound=BaseModel)
SAFE_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"  # of folders, parts of ids and cells of tables
_SHOWN = 5


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    if list(values) != sorted(set(values)):
        raise ValueError("must be ascending, without repeats")
    return values


Name = Annotated[str, Field(pattern=SAFE_NAME)]
Positive = Annotated[float, Field(gt=0, le=1e12, allow_inf_nan=False)]  # larger ones are slips
Seed = Annotated[int, Field(ge=0, lt=2**31)]
Count = Annotated[int, Field(ge=1, le=10**9)]
Ranks = Annotated[
    tuple[Annotated[int, Field(ge=1, le=1000)], ...],
    Field(min_length=1, max_length=16),
    AfterValidator(_ascending),
]
Thresholds = Annotated[
    tuple[Positive, ...], Field(min_length=1, max_length=16), AfterValidator(_ascending)
]


class Strict(BaseModel):
    """A table of a file: no unknown key, no conversion of types, no change afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    @model_validator(mode="before")
    @classmethod
    def _arrays_are_tuples(cls, data: Any) -> Any:
        # TOML has arrays only; strict validation asks for the tuples that keep models immutable.
        return {key: _frozen(data[key]) for key in data} if isinstance(data, dict) else data


def _frozen(value: Any) -> Any:
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value


def read_toml(
    path: Path, kind: type[UserError], what: str, limit_bytes: int = LIMIT_BYTES
) -> dict[str, Any]:
    """Read a TOML file up to a size, or say what is wrong with it."""
    text = read_text(path, kind, what, limit_bytes)
    with readable(path, "not valid TOML", kind=kind, expected=f"a {what}", fix="correct it"):
        return tomllib.loads(text)


def validated(
    data: dict[str, Any], model: type[M], kind: type[UserError], path: Path, what: str
) -> M:
    """Make a model of a file's content, or say which keys are wrong."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        fix = f"correct the {what}"
        raise kind(validation_message(error, model), where=path, fix=fix) from error


def validation_message(error: ValidationError, model: type[BaseModel]) -> str:
    """Put pydantic's findings into lines that name key, value and expectation."""
    found = [_finding(item, model) for item in error.errors()]
    more = [f"and {len(found) - _SHOWN} more"] * (len(found) > _SHOWN)
    return "\n    ".join([*found[:_SHOWN], *more])


def _finding(item: Any, model: type[BaseModel]) -> str:
    kind, said = item["type"], str(item["msg"]).removeprefix("Value error, ")
    *within, last = map(str, item["loc"] or [""])
    # Parts such as "<map>" name which of several tables was chosen, and are no keys.
    named = [part for part in within if not part.startswith("<")]
    named += [last] if kind == "extra_forbidden" or not last.startswith("<") else []
    key = repr(".".join(named)[:80])[1:-1]
    if kind == "extra_forbidden":
        return f"unknown key '{key}'{nearest(last, _known_keys(model))}"
    if kind == "missing":
        return f"key '{key}' is missing"
    if not item["loc"]:  # it is of the whole file
        return said
    value = "" if isinstance(item["input"], dict) else f" is {repr_short(item['input'])[:60]}"
    return f"key '{key}'{value}: {said}"


def _known_keys(model: Any) -> list[str]:
    """Return the keys of a model, or of the models in a type, and of all within."""
    if not hasattr(model, "model_fields"):
        return [key for part in get_args(model) for key in _known_keys(part)]
    fields = model.model_fields.items()
    inner = [key for _, field in fields for key in _known_keys(field.annotation)]
    return [field.alias or name for name, field in fields] + inner


def nearest(name: str, known: list[str], offered: int = 3) -> str:
    """Offer the known names that are most like a mistyped one, for messages."""
    spelt = {other.casefold(): other for other in known[:5000]}  # as many in a quarter of a second
    near = difflib.get_close_matches(name.casefold(), spelt, n=offered, cutoff=0.6)
    return f" (did you mean {' or '.join(repr(spelt[one]) for one in near)}?)" if near else ""
