"""Keys of sealed truth: X25519, in files as ``age-keygen`` writes them."""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import read_text

__all__ = ["KEY_VARIABLE", "load_pyrage", "read_key", "recipient"]

KEY_VARIABLE = "AIRZOO_BENCH_KEY"
"""The variable of the environment that holds a key."""

_LIMIT_BYTES = 1 << 16
_SECRET, _PUBLIC = "AGE-SECRET-KEY-1", "age1"


def load_pyrage() -> Any:
    """Import pyrage and return the module."""
    try:
        return importlib.import_module("pyrage")
    except ImportError:
        fix = "pip install 'airzoo-bench[leaderboard]'"
        raise UsageError("sealed truth needs pyrage, which is not installed", fix=fix) from None


def read_key(file: Path | None = None) -> Any:
    """Read the key that opens an archive, from a file or from the environment."""
    where = f"${KEY_VARIABLE}" if file is None else str(file)
    if file is not None:
        text: str | None = read_text(file, UsageError, "key file", _LIMIT_BYTES)
    else:
        text = os.environ.get(KEY_VARIABLE)
    if text is None:
        fix = f"give its file by --key, or put it in ${KEY_VARIABLE}"
        raise UsageError("there is no key to open the archive with", fix=fix)
    lines = [line.strip() for line in text.splitlines()]
    found = [line for line in lines if line.startswith(_SECRET)]
    pyrage = load_pyrage()
    try:
        [line] = found
        return pyrage.x25519.Identity.from_str(line)
    except (ValueError, pyrage.IdentityError):
        # Neither the key nor what the library says of it is repeated.
        raise UsageError(
            f"holds {len(found)} keys" if len(found) != 1 else "holds a key that is damaged",
            where=where,
            expected=f"one line that begins with {_SECRET}, as age-keygen writes it",
        ) from None


def recipient(text: str) -> Any:
    """Return whom an archive is sealed to."""
    pyrage = load_pyrage()
    if text.strip().upper().startswith(_SECRET):
        raise UsageError(
            "this is the secret key, which now stands in the shell's history",
            where="--to",
            expected=f"the public key, which begins with {_PUBLIC}",
            fix="make another key, and give the public one",
        )
    try:
        return pyrage.x25519.Recipient.from_str(text.strip())
    except pyrage.RecipientError:
        raise UsageError(
            f"no recipient: {text[:80]!r}",
            where="--to",
            expected=f"a public key as age-keygen prints it, which begins with {_PUBLIC}",
        ) from None
