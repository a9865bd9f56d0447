"""Turns the options --engine and --scheduler into an engine; imports nothing heavy."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum

from airzoo_bench.core.errors import UsageError
from airzoo_bench.engines.engine import Engine, Processes

__all__ = ["LOCAL", "EngineKind", "open_engine"]

LOCAL = "local"
_ADDRESS = re.compile(r"(tcp|tls)://(\[[0-9a-fA-F:.]+\]|[^\s/:@]+):\d{1,5}")


class EngineKind(StrEnum):
    """Where work is done, as options name it."""

    LOCAL = "local"
    DASK = "dask"


@contextmanager
def open_engine(
    kind: EngineKind,
    scheduler: str | None,
    *,
    jobs: int,
    memory_bytes: int | None = None,
    here: Engine | None = None,
    note: Callable[[str], None] = lambda _: None,
) -> Iterator[Engine]:
    """Open the engine that options ask for; it ends with the block."""
    if kind is EngineKind.LOCAL:
        if scheduler is not None:
            raise UsageError("--scheduler is of Dask", fix="add --engine dask")
        engine = here or Engine()
        try:
            yield engine
        finally:
            if isinstance(engine, Processes):
                engine.kill()
        return
    own = scheduler in (None, LOCAL)
    if not own and not _ADDRESS.fullmatch(str(scheduler)):
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
    from airzoo_bench.engines.dask import connect, local_cluster  # Dask is an extra

    cluster = local_cluster(jobs, memory_bytes) if own else connect(str(scheduler), note)
    with cluster as engine:
        yield engine
