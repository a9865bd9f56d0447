"""The model of protocol files, which people read, write and cite.

A protocol file states every value that can change a score; the models have no defaults, so nothing
is decided in code. Its fingerprint covers all of that and nothing else: a title may be reworded
without changing it.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, field_validator

from airzoo_bench.core.files import fingerprint
from airzoo_bench.core.validation import Name, Strict


class ProtocolScene(Strict):
    """A scene of the benchmark and, where it is published, its number of queries."""

    id: Name
    title: Annotated[str, Field(min_length=1, max_length=80)]
    queries: Annotated[int, Field(ge=1)] | None = None


class Protocol(Strict):
    """The rules of one track on one benchmark; a class a track adds its sections."""

    # The sections that the truth in a benchmark folder is made by.
    truth_sections: ClassVar[tuple[str, ...]] = ()

    schema_version: Literal[1] = Field(alias="schema")
    name: Name
    version: Annotated[int, Field(ge=1, le=10**6)]
    title: Annotated[str, Field(min_length=1, max_length=120)]
    summary: Annotated[str, Field(min_length=1)]
    benchmark: Name
    track: str
    scenes: Annotated[tuple[ProtocolScene, ...], Field(min_length=1)]

    @field_validator("scenes")
    @classmethod
    def _scenes_differ(cls, scenes: tuple[ProtocolScene, ...]) -> tuple[ProtocolScene, ...]:
        ids = [scene.id for scene in scenes]
        if len(set(ids)) != len(ids):
            raise ValueError("each scene id once")
        return scenes

    def settings(self) -> dict[str, Any]:
        """Return everything that can change a score, ready for JSON."""
        texts = {"title", "summary", "scenes"}
        values = self.model_dump(mode="json", exclude=texts, by_alias=True)
        return values | {"scenes": [scene.id for scene in self.scenes]}

    def truth_settings(self) -> dict[str, dict[str, Any]]:
        """Return the values that the truth is made by, by section and key."""
        values = self.model_dump(mode="json", exclude_none=True)
        return {name: values[name] for name in self.truth_sections if name in values}

    @property
    def fingerprint(self) -> str:
        """SHA-256 over `settings`."""
        return fingerprint(self.settings())
