"""Protocols: what is measured, in files that people read, write and cite.

A protocol file states every value that can change a score; the models below have no defaults,
so nothing is decided in code. Its fingerprint covers all of that and nothing else: a title may be
reworded without changing it.
"""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from airzoo_bench.errors import ProtocolError, UserError
from airzoo_bench.files import fingerprint, read_text

__all__ = [
    "SAFE_NAME",
    "ApVariant",
    "Gallery",
    "GroundTruth",
    "Protocol",
    "ProtocolScene",
    "RetrievalScores",
    "find_protocol",
    "load_protocol",
    "parse_toml",
    "protocol_files",
    "protocol_for",
    "shipped_protocols",
    "validation_message",
]

SAFE_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"
"""Names that become folders, parts of ids and cells of tables."""


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    if list(values) != sorted(set(values)):
        raise ValueError("must be ascending, without repeats")
    return values


M = TypeVar("M", bound=BaseModel)

_SHOWN = 5

Name = Annotated[str, Field(pattern=SAFE_NAME)]
Ranks = Annotated[
    tuple[Annotated[int, Field(ge=1, le=1000)], ...],
    Field(min_length=1, max_length=16),
    AfterValidator(_ascending),
]
Limits = Annotated[
    tuple[Annotated[float, Field(gt=0, allow_inf_nan=False)], ...],
    Field(min_length=1, max_length=16),
    AfterValidator(_ascending),
]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
ApVariant = Literal["precision", "min", "trec", "hits"]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    @model_validator(mode="before")
    @classmethod
    def _arrays_are_tuples(cls, data: Any) -> Any:
        # TOML has arrays only; strict validation asks for the tuples that keep models immutable.
        if not isinstance(data, dict):
            return data
        return {key: tuple(v) if isinstance(v, list) else v for key, v in data.items()}


class ProtocolScene(_Strict):
    """A scene of the benchmark and, where it is published, its number of queries."""

    id: Name
    title: Annotated[str, Field(min_length=1, max_length=80)]
    queries: Annotated[int, Field(ge=1)] | None = None


class Gallery(_Strict):
    """How the georeferenced map is cut into tiles."""

    tile_sizes_px: Annotated[
        tuple[Annotated[int, Field(ge=16, le=8192)], ...], Field(min_length=1, max_length=8)
    ]
    overlap: Annotated[float, Field(ge=0, lt=1)]
    gsd_m: Positive | Literal["any"]
    gsd_tolerance: Annotated[float, Field(gt=0, lt=1)]

    @field_validator("tile_sizes_px")
    @classmethod
    def _sizes_differ(cls, sizes: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(sizes)) != len(sizes):
            raise ValueError("each tile size once")
        return sizes


class GroundTruth(_Strict):
    """Which tiles answer a query, from rays cast through four anchor pixels."""

    rule: Literal["plane", "dsm", "iou"]
    anchor_inset: Annotated[float, Field(ge=0, lt=0.5)]
    max_range_m: Positive
    iou_above: Annotated[float, Field(ge=0, lt=1)] | None = None
    without_positive: Literal["exclude", "miss"]

    @model_validator(mode="after")
    def _threshold_belongs_to_iou(self) -> GroundTruth:
        if (self.rule == "iou") != (self.iou_above is not None):
            raise ValueError("iou_above is given with rule = 'iou', and only then")
        return self


class RetrievalScores(_Strict):
    """What is computed from a ranked gallery."""

    descriptor_metric: Literal["l2", "cosine", "inner_product"]
    ranks_kept: Annotated[int, Field(ge=1, le=1000)]
    recall_at: Ranks
    ap_at: Annotated[int, Field(ge=1, le=1000)]
    ap: ApVariant
    ndcg_at: Ranks
    distance_below_m: Limits
    sdm_at: Ranks
    sdm_scale_per_m: Positive
    pdm_at: Ranks
    pdm_steepness: Positive
    pdm_tolerance_tiles: Positive

    @model_validator(mode="after")
    def _kept_ranks_suffice(self) -> RetrievalScores:
        deepest = max(*self.recall_at, self.ap_at, *self.ndcg_at, *self.sdm_at, *self.pdm_at)
        if self.ranks_kept < deepest:
            raise ValueError(f"ranks_kept must reach the deepest score, {deepest}")
        return self

    @property
    def depth(self) -> int:
        """The deepest rank that a headline score (recall, AP) reads."""
        return max(*self.recall_at, self.ap_at)


class Protocol(_Strict):
    """What is measured on one track of one benchmark."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Name
    version: Annotated[int, Field(ge=1)]
    title: Annotated[str, Field(min_length=1, max_length=120)]
    summary: Annotated[str, Field(min_length=1)]
    benchmark: Name
    track: Literal["retrieval"]
    scenes: Annotated[tuple[ProtocolScene, ...], Field(min_length=1)]
    gallery: Gallery
    ground_truth: GroundTruth
    scores: RetrievalScores

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

    @property
    def fingerprint(self) -> str:
        """SHA-256 over `settings`."""
        return fingerprint(self.settings())


def load_protocol(path: Path) -> Protocol:
    """Read and check a protocol file.

    Raises
    ------
    ProtocolError
        The file is missing, is not TOML, or has an unknown key, a wrong type or an impossible
        value; the message names file, key and expectation.
    """
    return parse_toml(path, Protocol, ProtocolError, "protocol file")


def parse_toml(path: Path, model: type[M], kind: type[UserError], what: str) -> M:
    """Read a TOML file into a pydantic model, or say what is wrong with it."""
    try:
        data = tomllib.loads(read_text(path, kind, what))
    except (ValueError, RecursionError) as error:  # the latter of values nested too deep
        raise kind(
            f"not valid TOML: {error}",
            where=path,
            expected=f"a {what}",
            mend="correct that place",
        ) from error
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise kind(validation_message(error, model), where=path, mend=f"correct the {what}") from (
            error
        )


def validation_message(error: ValidationError, model: type[BaseModel]) -> str:
    """Put pydantic's findings into lines that name key, value and expectation."""
    found = error.errors()
    more = [f"and {len(found) - _SHOWN} more"] if len(found) > _SHOWN else []
    return "\n    ".join([*(_finding(item, model) for item in found[:_SHOWN]), *more])


def _finding(item: Any, model: type[BaseModel]) -> str:
    key = ".".join(str(part) for part in item["loc"])
    if item["type"] == "extra_forbidden":
        return f"unknown key '{key}'{_nearest(str(item['loc'][-1]), _known_keys(model))}"
    if item["type"] == "json_invalid":
        return f"not valid JSON: {item['ctx']['error']}"
    if item["type"] == "missing":
        return f"key '{key}' is missing"
    if not item["loc"]:
        return str(item["msg"]).removeprefix("Value error, ")
    if isinstance(item["input"], dict) and item["type"] == "value_error":
        return f"key '{key}': {item['msg'].removeprefix('Value error, ')}"
    given = repr(item["input"])
    shown = given if len(given) <= 60 else given[:57] + "..."
    return f"key '{key}' is {shown}: {item['msg'].removeprefix('Value error, ')}"


def _known_keys(model: type[BaseModel]) -> list[str]:
    keys: list[str] = []
    for name, field in model.model_fields.items():
        keys.append(field.alias or name)
        for part in (field.annotation, *getattr(field.annotation, "__args__", ())):
            if isinstance(part, type) and issubclass(part, BaseModel):
                keys += _known_keys(part)
    return keys


def _nearest(name: str, known: list[str]) -> str:
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.6)
    return f" (did you mean {' or '.join(repr(n) for n in near)}?)" if near else ""


def shipped_protocols() -> dict[str, Path]:
    """Return the protocol files that travel with the package, by name."""
    return {path.stem: path for path in sorted(_shipped_folder().glob("*.toml"))}


def _shipped_folder() -> Path:
    # In the wheel they lie inside the package; in a checkout beside it.
    inside = Path(__file__).parent / "protocols"
    return inside if inside.is_dir() else Path(__file__).parent.parent / "protocols"


def find_protocol(name: str, data_root: Path) -> Protocol:
    """Find a protocol by name or by path.

    Parameters
    ----------
    name : str
        The path of a ``.toml`` file, the name of a shipped protocol, or of one that ``prepare``
        wrote into a benchmark folder.
    data_root : Path
        Where benchmark folders lie.

    Raises
    ------
    ProtocolError
        Nothing has that name; the nearest names are offered.
    """
    if name.endswith(".toml"):
        return load_protocol(Path(name))
    known = protocol_files(data_root)
    if name in known:
        return load_protocol(known[name])
    raise ProtocolError(
        f"unknown protocol {name[:80]!r}{_nearest(name[:80], list(known))}",
        expected="a .toml file or one of: " + ", ".join(known),
        mend="`airzoo-bench protocols` lists them; `--protocol` overrides the file's own",
    )


def protocol_files(data_root: Path) -> dict[str, Path]:
    """Return every protocol that can be named: shipped, and of prepared benchmark folders.

    Parameters
    ----------
    data_root : Path
        A benchmark folder, or the folder that holds some; it need not exist.
    """
    prepared = sorted([*data_root.glob("protocols/*.toml"), *data_root.glob("*/protocols/*.toml")])
    return {path.stem: path for path in prepared} | shipped_protocols()


def protocol_for(
    base: Protocol,
    name: str,
    *,
    tile_sizes_px: tuple[int, ...] | None = None,
    rule: str | None = None,
    iou_above: float | None = None,
) -> Protocol:
    """Derive the protocol of own data from another one.

    Parameters
    ----------
    base : Protocol
        Where all values come from that are not given.
    name : str
        Of the benchmark and its one scene.
    tile_sizes_px, rule, iou_above
        Values to change.

    Raises
    ------
    ProtocolError
        A value is impossible.
    """
    values = base.model_dump(by_alias=True)
    values |= {"name": f"{name}-{base.track}", "version": 1, "benchmark": name}
    values |= {"title": f"{name}, {base.track}", "scenes": ({"id": name, "title": name},)}
    if values["name"] in shipped_protocols():
        raise ProtocolError(
            f"the name {name!r} would make a second protocol {values['name']}",
            expected="a name that no shipped protocol has",
            mend="choose another --name",
        )
    if tile_sizes_px is not None:
        values["gallery"]["tile_sizes_px"] = tile_sizes_px
    truth = base.ground_truth
    chosen = rule or truth.rule
    if iou_above is None and chosen == "iou":
        iou_above = truth.iou_above
    values["ground_truth"] |= {"rule": chosen, "iou_above": iou_above}
    try:
        return Protocol.model_validate(values)
    except ValidationError as error:
        raise ProtocolError(
            validation_message(error, Protocol),
            where=f"the protocol for {name[:80]!r}",
            mend="correct the option, or the protocol that --protocol names",
        ) from error
