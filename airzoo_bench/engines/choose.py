"""Which engine does the work: the one place that turns options into one."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from enum import StrEnum

from airzoo_bench.core.errors import UsageError
from airzoo_bench.engines.engine import Engine, Here

__all__ = ["LOCAL", "EngineKind", "chosen_engine"]

LOCAL = "local"
_ADDRESS = re.compile(r"(tcp|tls)://(\[[0-9a-fA-F:.]+\]|[^\s/:@]+):(\d{1,5})")


class EngineKind(StrEnum):
    """Where work is done."""

    LOCAL = "local"
    DASK = "dask"


@contextmanager
def chosen_engine(
    kind: EngineKind,
    scheduler: str | None,
    *,
    jobs: int,
    memory_bytes: int | None = None,
    here: Engine | None = None,
    note: Callable[[str], None] = lambda _: None,
) -> Iterator[Engine]:
    """Open the engine that options ask for; it ends with the block."""
    _check(kind, scheduler)
    if kind is EngineKind.LOCAL:
        opened: AbstractContextManager[Engine] = nullcontext(here or Here())
    else:
        from airzoo_bench.engines.cluster import connected, local_cluster

        if scheduler is None or scheduler == LOCAL:
            opened = local_cluster(jobs, memory_bytes)
        else:
            opened = connected(scheduler, note)
    with opened as engine:
        yield engine


def _check(kind: EngineKind, scheduler: str | None) -> None:
    if kind is EngineKind.LOCAL:
        if scheduler is not None:
            raise UsageError("--scheduler is of Dask", fix="add --engine dask")
        return
    if scheduler not in (None, LOCAL) and not _is_address(scheduler):
        raise UsageError(
            "that is not the address of a scheduler",
            where=f"--scheduler {scheduler}",
            expected="local, tcp://HOST:PORT or tls://HOST:PORT, such as tcp://10.0.0.5:8786",
        )
    if importlib.util.find_spec("distributed") is None:
        raise UsageError(
            "--engine dask needs Dask, which is not installed",
            fix="pip install 'airzoo-bench[dask]'",
        )


def _is_address(text: str) -> bool:
    found = _ADDRESS.fullmatch(text)
    return found is not None and 0 < int(found[3]) < 1 << 16
