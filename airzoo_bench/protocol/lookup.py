"""Protocols: what is measured, in files that people read, write and cite.

A protocol file states every value that can change a score; the models have no defaults, so nothing
is decided in code. Its fingerprint covers all of that and nothing else: a title may be reworded
without changing it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

from pydantic import Field, ValidationError, field_validator, model_validator

from airzoo_bench.core.errors import ProtocolError
from airzoo_bench.core.files import fingerprint
from airzoo_bench.core.settings import Name, Strict
from airzoo_bench.core.validation import nearest, read_toml, validated, validation_message
from airzoo_bench.matching.settings import Crop, Lift, MatchingScores, Prior, Solver
from airzoo_bench.reconstruction.settings import (
    Alignment,
    Fusion,
    Meshes,
    Preparation,
    ReconstructionScores,
)
from airzoo_bench.retrieval.settings import Gallery, GroundTruth, RetrievalScores

__all__ = [
    "MatchingProtocol",
    "Protocol",
    "ProtocolScene",
    "ReconstructionProtocol",
    "RetrievalProtocol",
    "find_protocol",
    "load_protocol",
    "protocol_files",
    "protocol_for",
    "protocol_of_track",
    "shipped_protocols",
]


P = TypeVar("P", bound="Protocol")


class ProtocolScene(Strict):
    """A scene of the benchmark and, where it is published, its number of queries."""

    id: Name
    title: Annotated[str, Field(min_length=1, max_length=80)]
    queries: Annotated[int, Field(ge=1)] | None = None


class Protocol(Strict):
    """What is measured on one track of one benchmark; a class a track adds its sections."""

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
        return {section: values[section] for section in self.truth_sections}

    @property
    def fingerprint(self) -> str:
        """SHA-256 over `settings`."""
        return fingerprint(self.settings())


class RetrievalProtocol(Protocol):
    """A protocol of aerial image retrieval."""

    truth_sections: ClassVar[tuple[str, ...]] = ("gallery", "ground_truth")

    track: Literal["retrieval"]
    gallery: Gallery
    ground_truth: GroundTruth
    scores: RetrievalScores


class MatchingProtocol(Protocol):
    """A protocol of cross-view matching."""

    truth_sections: ClassVar[tuple[str, ...]] = ("crop", "prior")

    track: Literal["matching"]
    crop: Crop
    prior: Prior
    lift: Lift
    solver: Solver
    scores: MatchingScores


class ReconstructionProtocol(Protocol):
    """A protocol of multi-view reconstruction."""

    track: Literal["reconstruction"]
    alignment: Alignment
    fusion: Fusion
    meshes: Meshes
    preparation: Preparation
    scores: ReconstructionScores

    @model_validator(mode="after")
    def _voxels_below_scores(self) -> Self:
        voxel, finest = self.preparation.voxel_m, self.scores.finest_m
        if not isinstance(voxel, str) and finest < 2 * voxel:
            raise ValueError(
                f"scores at {finest:g} m of clouds thinned by voxels of {voxel:g} m mean nothing: "
                "thresholds must be at least two voxels"
            )
        return self


_TRACKS: dict[str, type[Protocol]] = {
    "retrieval": RetrievalProtocol,
    "matching": MatchingProtocol,
    "reconstruction": ReconstructionProtocol,
}


def load_protocol(path: Path) -> Protocol:
    """Read and check a protocol file.

    Raises
    ------
    ProtocolError
        The file is missing, is not TOML, or has an unknown key, a wrong type or an impossible
        value; the message names file, key and expectation.
    """
    data = read_toml(path, ProtocolError, "protocol file")
    track = data.get("track")
    if not isinstance(track, str) or track not in _TRACKS:
        raise ProtocolError(
            "key 'track' is missing" if track is None else f"key 'track' is {track!r}",
            where=path,
            expected="one of " + ", ".join(_TRACKS),
            mend="correct the protocol file",
        )
    return validated(data, _TRACKS[track], ProtocolError, path, "protocol file")


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
        f"unknown protocol {name[:80]!r}{nearest(name[:80], list(known))}",
        expected="a .toml file or one of: " + ", ".join(known),
        mend=f"protocols of prepared benchmarks were sought in {data_root}: is that the right "
        "folder (--data, AIRZOO_BENCH_DATA)? `airzoo-bench protocols` lists what is known",
    )


def protocol_of_track(name: str, data_root: Path, model: type[P]) -> P:
    """Find a protocol that must be of one track.

    Raises
    ------
    ProtocolError
        See `find_protocol`; or it is of another track.
    """
    chosen = find_protocol(name, data_root)
    if not isinstance(chosen, model):
        wanted = next(track for track, kind in _TRACKS.items() if kind is model)
        raise ProtocolError(
            f"protocol {chosen.name} is of the {chosen.track} track",
            expected=f"one of the {wanted} track",
            mend="`airzoo-bench protocols` lists them with their tracks",
        )
    return chosen


def protocol_files(data_root: Path) -> dict[str, Path]:
    """Return every protocol that can be named: shipped, and of prepared benchmark folders.

    Parameters
    ----------
    data_root : Path
        A benchmark folder, or the folder that holds some; it need not exist.
    """
    prepared = sorted([*data_root.glob("protocols/*.toml"), *data_root.glob("*/protocols/*.toml")])
    return {path.stem: path for path in prepared} | shipped_protocols()


def protocol_for(base: P, name: str, changes: Mapping[str, Mapping[str, Any]]) -> P:
    """Derive the protocol of own data from another one.

    Parameters
    ----------
    base : Protocol
        Where all values come from that are not changed, the version among them.
    name : str
        Of the benchmark and its one scene.
    changes : mapping of str to mapping
        New values by section and key, such as ``{"gallery": {"tile_sizes_px": (256,)}}``.

    Raises
    ------
    ProtocolError
        A value is impossible.
    """
    values = base.model_dump(by_alias=True)
    values |= {"name": f"{name}-{base.track}", "benchmark": name}
    values |= {"title": f"{name}, {base.track}", "scenes": ({"id": name, "title": name},)}
    if values["name"] in shipped_protocols():
        raise ProtocolError(
            f"the name {name!r} would make a second protocol {values['name']}",
            expected="a name that no shipped protocol has",
            mend="choose another --name",
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
            mend="correct the option, or the protocol that --protocol names",
        ) from error
