"""What a result was made with: protocol, truth, predictions."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    SerializerFunctionWrapHandler,
    model_serializer,
)

__all__ = ["Name", "PredictionsUsed", "ProtocolUsed", "ReaderUsed", "ResultModel", "TruthUsed"]


def _make_printable(name: object) -> object:
    # Names of files may hold bytes that are no text, and a name stands on one line of a table.
    if not isinstance(name, str):
        return name
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in name)


Name = Annotated[str, BeforeValidator(_make_printable)]


class ResultModel(BaseModel):
    """Settings of all parts of a result."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, ser_json_inf_nan="strings", allow_inf_nan=True
    )


class ProtocolUsed(ResultModel):
    """The protocol that a result was made with."""

    name: str
    version: int
    fingerprint: str
    settings: dict[str, Any]


class TruthUsed(ResultModel):
    """The truth that predictions were compared with."""

    benchmark: str
    version: int
    fingerprint: str
    scene_titles: dict[str, str]


class ReaderUsed(ResultModel):
    """What read a method's own files, and what it took to be so."""

    name: Name
    conventions: tuple[Name, ...]


class PredictionsUsed(ResultModel):
    """The predictions; the name is the file's, without its folder.

    Files of the suite's own layout have no reader, and results of them no such key.
    """

    file: Name
    sha256: str
    kind: str
    method: Name
    reader: ReaderUsed | None = None

    @model_serializer(mode="wrap")
    def _without_reader(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields: dict[str, Any] = write(self)
        return fields if self.reader else {k: v for k, v in fields.items() if k != "reader"}
