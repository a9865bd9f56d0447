"""The kinds of answers that a prediction file may hold, by the fields that each has."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

__all__ = ["DESCRIBED", "FIELDS", "KINDS", "MATCHES", "PAIRS", "POSES", "RANKED", "Kind"]


@dataclass(frozen=True)
class Kind:
    """A kind of answer: its track, the fields that it has, and those that it may have."""

    track: str
    needed: tuple[str, ...]
    optional: tuple[str, ...] = ()

    def fits(self, track: str, names: Collection[str]) -> bool:
        """Tell whether fields of these names are an answer of this kind."""
        fields = {*self.needed, *self.optional}
        return track == self.track and set(self.needed) <= set(names) <= fields

    def __str__(self) -> str:
        return " and ".join((*self.needed, *(f"perhaps {name}" for name in self.optional)))


RANKED = Kind("retrieval", ("ranked_ids",), ("scores",))
DESCRIBED = Kind("retrieval", ("descriptor",))
MATCHES = Kind("matching", ("query_xy", "map_xy"))
PAIRS = Kind("matching", ("query_xy", "points3d"))
POSES = Kind("matching", ("rotation", "centre"))
CLOUD = Kind("reconstruction", ("points",), ("colours",))
CAMERA = Kind("reconstruction", ("rotation", "centre"))
DEPTH = Kind("reconstruction", ("depth", "intrinsics", "rotation", "centre"), ("confidence",))
KINDS = (RANKED, DESCRIBED, MATCHES, PAIRS, POSES, CLOUD, CAMERA, DEPTH)
FIELDS = dict.fromkeys(name for kind in KINDS for name in (*kind.needed, *kind.optional))
