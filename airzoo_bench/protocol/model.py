"""Protocol files, which people read, write and cite: their model, and how they are found.

A protocol file states every value that can change a score; the models have no defaults, so nothing
is decided in code. Its fingerprint covers all of that and nothing else: a title may be reworded
without changing it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_args

from pydantic import Field, ValidationError, field_validator

from airzoo_bench.core.errors import ProtocolError
from airzoo_bench.core.files import DATA_VARIABLE, fingerprint
from airzoo_bench.core.registry import TRACKS, load_track
from airzoo_bench.core.validation import (
    Name,
    Strict,
    nearest,
    read_toml,
    validated,
    validation_message,
)


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
        values = self.model_dump(mode="json", exclude={"title", "summary", "scenes"}, by_alias=True)
        return values | {"scenes": [scene.id for scene in self.scenes]}

    def truth_settings(self) -> dict[str, dict[str, Any]]:
        """Return the values that the truth is made by, by section and key."""
        values = self.model_dump(mode="json", exclude_none=True)
        return {name: values[name] for name in self.truth_sections if name in values}

    @property
    def fingerprint(self) -> str:
        """SHA-256 over `settings`."""
        return fingerprint(self.settings())


P = TypeVar("P", bound=Protocol)


def load_protocol(path: Path) -> Protocol:
    """Read and check a protocol file."""
    data = read_toml(path, ProtocolError, "protocol file")
    track = data.get("track")
    if not isinstance(track, str) or track not in TRACKS:
        raise ProtocolError(
            "key 'track' is missing" if track is None else f"key 'track' is {track!r}",
            where=path,
            expected="one of " + ", ".join(TRACKS.names()),
        )
    model: type[Protocol] = load_track(track).protocol
    return validated(data, model, ProtocolError, path, "protocol file")


def shipped_protocols() -> dict[str, Path]:
    """Return the protocol files that travel with the package, by name."""
    package = Path(__file__).parents[1]
    inside = package / "protocols"  # in the wheel; in a checkout they lie beside the package
    folder = inside if inside.is_dir() else package.parent / "protocols"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def _prepared_files(data: Path) -> list[Path]:
    return sorted([*data.glob("protocols/*.toml"), *data.glob("*/protocols/*.toml")])


def protocol_files(data: Path) -> dict[str, Path]:
    """Return every protocol that can be named: shipped, and of prepared benchmark folders."""
    return {path.stem: path for path in _prepared_files(data)} | shipped_protocols()


def find_protocol(name: str, data: Path) -> Protocol:
    """Find a protocol by name or by path."""
    if name.endswith(".toml"):
        return load_protocol(Path(name))
    known = protocol_files(data)
    if name in known:
        return load_protocol(known[name])
    raise ProtocolError(
        f"unknown protocol {name[:80]!r}{nearest(name[:80], list(known))}",
        fix="`airzoo-bench protocols` lists what is known; those of prepared benchmarks were "
        f"sought in {data}: set {DATA_VARIABLE} to their folder, or name it with --data",
    )


def protocol_of_track(name: str, data: Path, model: type[P]) -> P:
    """Find a protocol that must be of one track."""
    chosen = find_protocol(name, data)
    if not isinstance(chosen, model):
        (wanted,) = get_args(model.model_fields["track"].annotation)
        raise ProtocolError(
            f"protocol {chosen.name} is of the {chosen.track} track",
            expected=f"one of the {wanted} track",
            fix="`airzoo-bench protocols` lists them with their tracks",
        )
    return chosen


def protocol_for(base: P, name: str, changes: Mapping[str, Mapping[str, Any]]) -> P:
    """Derive the protocol of own data from another one."""
    values = base.model_dump(by_alias=True)
    values |= {"name": f"{name}-{base.track}", "benchmark": name}
    values |= {"title": f"{name}, {base.track}", "scenes": ({"id": name, "title": name},)}
    if values["name"] in shipped_protocols():
        raise ProtocolError(
            f"the name {name!r} would make a second protocol {values['name']}",
            fix="choose another --name",
        )
    for section, keys in changes.items():
        values[section] |= keys
    model = type(base)
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise ProtocolError(
            validation_message(error, model),
            where=f"the protocol for {name[:80]!r}",
            fix="correct the option, or the protocol that --protocol names",
        ) from error
