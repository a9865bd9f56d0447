"""One run at a time where two would fill or clear the same folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.places import cannot_write
from airzoo_bench.core.temporaries import only_writer

__all__ = ["only_run"]


@contextmanager
def only_run(folder: Path, what: str, where: object, otherwise: str) -> Iterator[None]:
    """Keep other runs from a folder while the block lasts."""
    made = [one for one in (folder.parent, *folder.parent.parents) if not one.exists()]
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    try:
        with ExitStack() as stack:
            try:
                stack.enter_context(only_writer(folder))
            except BlockingIOError as error:
                raise UsageError(
                    what, where=where, fix=f"wait until it has ended, or {otherwise}"
                ) from error
            except OSError:
                pass
            yield
    finally:
        for one in made:
            with suppress(OSError):  # where something was made, it stays
                one.rmdir()
