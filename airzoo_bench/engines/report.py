"""What a run took, stage by stage, and what a larger one would."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

__all__ = ["RunReport", "Spent"]

_LARGER = 10
_ASSUMED = (
    "ten times as many tasks of the same size on the same workers: seconds and bytes grow with the "
    "number of tasks, memory does not"
)


@dataclass(frozen=True)
class Spent:
    """What tasks took.

    Attributes
    ----------
    cpu_s, wall_s : float
        Of the workers, added up.
    read : int
        Bytes that tasks said they read.
    sent, returned : int
        Bytes that went to workers and came back, but for what all tasks share.
    """

    cpu_s: float = 0.0
    wall_s: float = 0.0
    read: int = 0
    sent: int = 0
    returned: int = 0

    def __add__(self, other: Spent) -> Spent:
        return Spent(
            self.cpu_s + other.cpu_s,
            self.wall_s + other.wall_s,
            self.read + other.read,
            self.sent + other.sent,
            self.returned + other.returned,
        )


@dataclass
class _Stage:
    tasks: int = 0
    kept: int = 0
    elapsed_s: float = 0.0
    spent: Spent = field(default_factory=Spent)


@dataclass
class RunReport:
    """Seconds and bytes by stage."""

    stages: dict[str, _Stage] = field(default_factory=dict)

    def add(self, stage: str, spent: Spent) -> None:
        """Add a task."""
        found = self._of(stage)
        found.tasks += 1
        found.spent += spent

    def add_kept(self, stage: str) -> None:
        """Add a task whose result an earlier run had kept."""
        self._of(stage).kept += 1

    @contextmanager
    def elapsing(self, stage: str) -> Iterator[None]:
        """Count the seconds of the block to a stage."""
        begun = time.monotonic()
        try:
            yield
        finally:
            self._of(stage).elapsed_s += time.monotonic() - begun

    def values(self) -> dict[str, Any]:
        """Return all of it for JSON."""
        stages = {name: _values(stage) for name, stage in self.stages.items()}
        larger = {name: _larger(stage) for name, stage in stages.items() if stage["tasks"]}
        return {"stages": stages, "ten_times_as_large": {"assumed": _ASSUMED, "stages": larger}}

    def lines(self) -> list[str]:
        """Return it as lines for a person."""
        if not self.stages:
            return ["no work was cut into tasks"]
        values = self.values()
        found = [_line(name, stage) for name, stage in values["stages"].items()]
        larger = values["ten_times_as_large"]
        elapsed, cpu = (
            sum(stage[key] for stage in larger["stages"].values())
            for key in ("elapsed_s", "worker_cpu_s")
        )
        found.append(f"ten times as large: {elapsed:,.0f} s, {cpu:,.0f} s of processors")
        return [*found, f"  assumed: {_ASSUMED}"]

    def _of(self, stage: str) -> _Stage:
        return self.stages.setdefault(stage, _Stage())


def _values(stage: _Stage) -> dict[str, Any]:
    return {
        "tasks": stage.tasks,
        "tasks_kept": stage.kept,
        "elapsed_s": round(stage.elapsed_s, 3),
        "worker_cpu_s": round(stage.spent.cpu_s, 3),
        "worker_wall_s": round(stage.spent.wall_s, 3),
        "bytes_read": stage.spent.read,
        "bytes_sent": stage.spent.sent,
        "bytes_returned": stage.spent.returned,
    }


def _larger(stage: dict[str, Any]) -> dict[str, Any]:
    # What an earlier run had kept was done too, at the price of the others.
    share = _LARGER * (stage["tasks"] + stage["tasks_kept"]) / stage["tasks"]
    left = {name: value for name, value in stage.items() if not name.startswith("tasks")}
    larger = {name: round(share * value, 3) for name, value in left.items()}
    return {"tasks": _LARGER * (stage["tasks"] + stage["tasks_kept"]), **larger}


def _line(name: str, stage: dict[str, Any]) -> str:
    kept = f" and {stage['tasks_kept']:,} kept" if stage["tasks_kept"] else ""
    moved = ", ".join(
        f"{_size(stage[f'bytes_{key}'])} {key}"
        for key in ("read", "sent", "returned")
        if stage[f"bytes_{key}"]
    )
    return (
        f"{name}: {stage['tasks']:,} done{kept} in {stage['elapsed_s']:,.1f} s; workers "
        f"{stage['worker_wall_s']:,.1f} s, of processors {stage['worker_cpu_s']:,.1f} s"
        + (f"; {moved}" if moved else "")
    )


def _size(count: int) -> str:
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count} B"
