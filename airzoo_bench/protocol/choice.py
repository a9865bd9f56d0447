"""Which protocol predictions are of, and what they look like where they are of none."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, ProtocolError, first_of
from airzoo_bench.core.ids import scene_of, with_endings
from airzoo_bench.formats.arrays import open_arrays, protocol_name
from airzoo_bench.protocol.lookup import find_protocol, load_protocol, protocol_files
from airzoo_bench.protocol.model import Protocol

__all__ = ["IN_A_FIELD", "choose_protocol", "other_benchmark", "refuse_other_track"]

P = TypeVar("P", bound=Protocol)


IN_A_FIELD = (
    "a field 'protocol' with the name of one",
    "name it with --protocol, or add the field; `airzoo-bench protocols` lists them",
)
"""Where a file says which protocol it is for, and how to fix that it does not."""


def choose_protocol(
    path: Path,
    in_file: str | None,
    named: str | None,
    data: Path,
    model: type[P],
    says: tuple[str, str] = IN_A_FIELD,
) -> P:
    """Return the protocol that was named, else the one that the file names.

    `says` is told where neither names one.

    Raises
    ------
    ProtocolError
        Neither names one, or it is unknown.
    PredictionError
        It is of another track.
    """
    if named is not None:
        chosen = find_protocol(named, data)
    elif in_file is not None:
        try:
            chosen = find_protocol(in_file, data)
        except ProtocolError as error:
            raise error.inside(f"{path}, field 'protocol'") from error
    else:
        raise ProtocolError(
            "does not say which protocol it is for",
            where=path,
            expected=says[0],
            fix=says[1],
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
    """Refuse an ``.npz`` that names a protocol of another track, before its fields are read.

    So too where another protocol was named instead, which is of the track.

    Raises
    ------
    PredictionError
        The message names the right command, not the fields that the file lacks for this one.
    """
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


def other_benchmark(
    path: Path,
    ids: NDArray[np.str_],
    protocol: Protocol,
    data: Path,
    example: str | None = None,
) -> PredictionError:
    """Make the fault of predictions none of whose ids belongs to the benchmark."""
    scenes = set(np.unique(scene_of(ids)))
    ending = scenes <= {scene.id for scene in protocol.scenes} and with_endings(ids)
    alike = [] if ending else _alike(scenes, protocol, data)
    guess = f"they look like those of {' or '.join(alike)}" if alike else ""
    expected = example or ", ".join(f"{scene.id}/..." for scene in protocol.scenes[:3])
    return PredictionError(
        f"none of its query ids belongs to {protocol.benchmark}: {first_of(ids, len(ids))}"
        + (f"; {guess}" if guess else ""),
        where=f"{path}, field 'query_ids'",
        expected=f"ids such as {expected}",
        fix="leave out the file's ending: ids are names without it"
        if ending
        else "name the right protocol with --protocol; `airzoo-bench template` writes the ids",
    )


def _alike(scenes: set[str], protocol: Protocol, data: Path) -> list[str]:
    """Name the protocols of the same track and another benchmark that have one of the scenes."""
    return [
        name
        for name, path in protocol_files(data).items()
        if scenes & _scenes_beside(path, protocol)
    ]


def _scenes_beside(path: Path, protocol: Protocol) -> set[str]:
    try:
        other = load_protocol(path)
    except ProtocolError:  # another benchmark's fault is not this file's
        return set()
    if other.track != protocol.track or other.benchmark == protocol.benchmark:
        return set()
    return {scene.id for scene in other.scenes}
