"""Finding protocols: shipped ones, those of benchmark folders, and the one predictions are for."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import ValidationError

from airzoo_bench.core.errors import PredictionError, ProtocolError
from airzoo_bench.core.files import DATA_VARIABLE
from airzoo_bench.core.registry import TRACKS, load_track
from airzoo_bench.core.validation import nearest, read_toml, validated, validation_message
from airzoo_bench.formats.arrays import open_arrays, protocol_name
from airzoo_bench.protocol.model import Protocol

__all__ = [
    "choose_protocol",
    "find_protocol",
    "load_protocol",
    "prepared_protocols",
    "protocol_files",
    "protocol_for",
    "protocol_of_track",
    "refuse_other_track",
    "shipped_protocols",
]

P = TypeVar("P", bound=Protocol)

_IN_A_FIELD = (
    "a field 'protocol' with the name of one",
    "name it with --protocol, or add the field; `airzoo-bench protocols` lists them",
)
"""Where a file states its protocol, and the fix where it does not: parts of a message."""


def load_protocol(path: Path) -> Protocol:
    """Read and check a protocol file."""
    data = read_toml(path, ProtocolError, "protocol file")
    track = data.get("track")
    if not isinstance(track, str) or track not in TRACKS:
        raise ProtocolError(
            "key 'track' is missing" if track is None else f"key 'track' is {track!r}",
            where=path,
            expected="one of " + ", ".join(TRACKS.names()),
            fix="correct the protocol file",
        )
    model: type[Protocol] = load_track(track).protocol
    return validated(data, model, ProtocolError, path, "protocol file")


def shipped_protocols() -> dict[str, Path]:
    """Return the protocol files that travel with the package, by name."""
    return {path.stem: path for path in sorted(_shipped_folder().glob("*.toml"))}


def _shipped_folder() -> Path:
    # In the wheel they are inside the package; in a checkout next to it.
    package = Path(__file__).parents[1]
    inside = package / "protocols"
    return inside if inside.is_dir() else package.parent / "protocols"


def find_protocol(name: str, data_root: Path) -> Protocol:
    """Find a protocol by name or by path."""
    if name.endswith(".toml"):
        return load_protocol(Path(name))
    known = protocol_files(data_root)
    if name in known:
        return load_protocol(known[name])
    raise ProtocolError(
        f"unknown protocol {name[:80]!r}{nearest(name[:80], list(known))}",
        expected="a .toml file or one of: " + ", ".join(known),
        fix="`airzoo-bench protocols` lists what is known; those of prepared benchmarks were "
        f"sought in {data_root}: set {DATA_VARIABLE} to their folder, or name it with --data",
    )


def protocol_of_track(name: str, data_root: Path, model: type[P]) -> P:
    """Find a protocol that must be of one track."""
    chosen = find_protocol(name, data_root)
    if not isinstance(chosen, model):
        (wanted,) = get_args(model.model_fields["track"].annotation)
        raise ProtocolError(
            f"protocol {chosen.name} is of the {chosen.track} track",
            expected=f"one of the {wanted} track",
            fix="`airzoo-bench protocols` lists them with their tracks",
        )
    return chosen


def prepared_protocols(track: str, data_root: Path) -> list[str]:
    """Return the names of a track's protocols in prepared benchmark folders."""
    found = []
    for path in _prepared_files(data_root):
        with suppress(ProtocolError):  # a damaged one is named when it is asked for
            if load_protocol(path).track == track:
                found.append(path.stem)
    return found


def choose_protocol(
    path: Path,
    in_file: str | None,
    named: str | None,
    data: Path,
    model: type[P],
    says: tuple[str, str] | None = None,
) -> P:
    """Return the protocol that was named, else the one that the file names."""
    if named is not None:
        chosen = find_protocol(named, data)
    elif in_file is not None:
        try:
            chosen = find_protocol(in_file, data)
        except ProtocolError as error:
            raise error.inside(f"{path}, field 'protocol'") from error
    else:
        expected, fix = says or _IN_A_FIELD
        raise ProtocolError(
            "does not say which protocol it is for", where=path, expected=expected, fix=fix
        )
    if not isinstance(chosen, model):
        raise PredictionError(
            f"protocol {chosen.name} is of the {chosen.track} track",
            where=path,
            expected="a protocol of the track that was asked for",
            fix=f"airzoo-bench eval {chosen.track} {path}",
        )
    return chosen


def refuse_other_track(
    path: Path, named: str | None, data: Path, model: type[P], memory_bytes: int
) -> None:
    """Refuse an ``.npz`` that names a protocol of another track, before its fields are read."""
    if path.suffix != ".npz" or not path.is_file():
        return
    in_file = protocol_name(open_arrays(path, memory_bytes))
    if in_file is None or (named is not None and in_file not in protocol_files(data)):
        return
    if named is None:
        choose_protocol(path, in_file, None, data, model)
        return
    own, wanted = find_protocol(in_file, data), find_protocol(named, data)
    if own.track != wanted.track:
        raise PredictionError(
            f"is for {own.name}, of the {own.track} track; --protocol {named} is of the "
            f"{wanted.track} track",
            where=path,
            expected=f"a protocol of the {own.track} track",
            fix=f"leave out --protocol: airzoo-bench eval {own.track} {path}",
        )


def protocol_files(data_root: Path) -> dict[str, Path]:
    """Return every protocol that can be named: shipped, and of prepared benchmark folders."""
    return {path.stem: path for path in _prepared_files(data_root)} | shipped_protocols()


def _prepared_files(data_root: Path) -> list[Path]:
    return sorted([*data_root.glob("protocols/*.toml"), *data_root.glob("*/protocols/*.toml")])


def protocol_for(base: P, name: str, changes: Mapping[str, Mapping[str, Any]]) -> P:
    """Derive the protocol of own data from another one."""
    values = base.model_dump(by_alias=True)
    values |= {"name": f"{name}-{base.track}", "benchmark": name}
    values |= {"title": f"{name}, {base.track}", "scenes": ({"id": name, "title": name},)}
    if values["name"] in shipped_protocols():
        raise ProtocolError(
            f"the name {name!r} would make a second protocol {values['name']}",
            expected="a name that no shipped protocol has",
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
