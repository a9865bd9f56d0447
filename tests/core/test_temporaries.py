from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from airzoo_bench.core import temporaries


@pytest.mark.skipif(sys.platform == "win32", reason="locks of POSIX")
def test_what_is_abandoned_is_held_until_it_is_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else who has just made it, and locks it in between, would lose it while writing."""
    import fcntl

    left = tmp_path / f".left{temporaries.PART}"
    left.touch()
    removed = []

    def remove(path: Path) -> None:
        if path != left:
            return
        handle = os.open(path, os.O_RDONLY)
        with pytest.raises(BlockingIOError):
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.close(handle)
        removed.append(path)

    monkeypatch.setattr(temporaries, "_remove", remove)
    temporaries.clear_abandoned(tmp_path / "left")
    assert removed == [left]
