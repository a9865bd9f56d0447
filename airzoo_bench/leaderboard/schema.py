"""The JSON Schema of submission.toml, for editors and other programs; docs/ holds it."""

from __future__ import annotations

import json
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from airzoo_bench.leaderboard.submission import Submission

__all__ = ["schema_text", "submission_schema"]

_ID = "https://json-schema.org/draft/2020-12/schema"


class _OfToml(GenerateJsonSchema):
    """TOML has no null: a key that may be missing is only left out."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        """Return the schema of what is there."""
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """Leave out a default of none."""
        found = super().default_schema(schema)
        return {k: v for k, v in found.items() if (k, v) != ("default", None)}


def submission_schema() -> dict[str, Any]:
    """Return the schema as JSON values."""
    made = Submission.model_json_schema(by_alias=True, schema_generator=_OfToml)
    described = "A submission to a leaderboard of airzoo-bench: docs/submission.md."
    return {"$schema": _ID, **_untitled(made), "title": "submission.toml", "description": described}


def _untitled(value: Any, *, names: bool = False) -> Any:
    """Drop titles made of keys, which editors would show instead of the descriptions."""
    if isinstance(value, list):
        return [_untitled(one) for one in value]
    if not isinstance(value, dict):
        return value
    return {
        key: _untitled(one, names=key in ("properties", "$defs"))
        for key, one in value.items()
        if names or key != "title"
    }


def schema_text() -> str:
    """Return the file docs/submission.schema.json."""
    return json.dumps(submission_schema(), indent=2, ensure_ascii=False) + "\n"
