"""The content security policy of pages that hold their style and script: nothing else acts."""

from __future__ import annotations

import base64
import hashlib


def content_policy(script: str, style: str) -> str:
    """Return the policy of a page: only this script and style, by their hashes, and no loading."""
    scripts = _hash(script) if script else "'none'"
    return (
        f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {scripts}; "
        "base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"
