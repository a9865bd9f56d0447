"""How much memory a file may make a run hold, all its parts together."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from airzoo_bench.core.errors import PredictionError


@dataclass(frozen=True)
class Budget:
    """The memory that the parts of a file take, and their common limit.

    Readers name each part before they allocate it, with the bytes that a run makes of it.
    """

    limit_bytes: int
    taken: dict[str, int] = field(default_factory=dict)

    def hold(self, path: Path, part: str, nbytes: int, fix: str | None = None) -> None:
        """Count a part; one that is named again counts once, with its larger size."""
        self.taken[part] = max(nbytes, self.taken.get(part, 0))
        others = sum(self.taken.values()) - self.taken[part]
        if self.taken[part] + others > self.limit_bytes:
            rest = f" besides {others:,} bytes of others" if others else ""
            raise PredictionError(
                f"{part}: {self.taken[part]:,} bytes of memory{rest}, more than the limit",
                where=path,
                expected=f"at most {self.limit_bytes:,} bytes, all together",
                fix="raise --max-memory" + (f", or {fix}" if fix else ""),
            )
