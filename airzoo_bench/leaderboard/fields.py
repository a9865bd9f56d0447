"""Types of the keys of submission.toml that have rules of their own."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator, Field

from airzoo_bench.core.validation import nearest
from airzoo_bench.leaderboard.names import plain_line

__all__ = ["Bibtex", "Contact", "Licence", "Sha256", "Url", "known_licence"]


def known_licence(expression: str) -> str:
    """Return an expression of SPDX as SPDX writes it."""
    from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression

    try:
        return str(canonicalize_license_expression(expression))
    except InvalidLicenseExpression:
        common = ["Apache-2.0", "MIT", "BSD-3-Clause", "GPL-3.0-only", "CC-BY-4.0", "CC-BY-NC-4.0"]
        raise ValueError(
            f"no licence of SPDX is called that{nearest(expression, common)}; one that has no id "
            "there is LicenseRef-NAME"
        ) from None


def _reachable(contact: str) -> str:
    plain_line(contact)
    if not re.search(r"[^@\s]+@[^@\s]+\.[^@\s]+|^https://\S+$|^@[A-Za-z0-9-]+$", contact):
        raise ValueError("an e-mail address, an account such as @name, or an https address")
    return contact


def _entry(text: str) -> str:
    for one in text.splitlines():
        if not one.replace("\t", " ").isprintable():
            raise ValueError("has characters that are not shown")
    return text


# A host without a user before it, which could pass for one, then what RFC 3986 has but quotes.
_URL = r"^https://[A-Za-z0-9][A-Za-z0-9.-]*(:[0-9]{1,5})?([/?#][A-Za-z0-9._~:/?#@!$&()*+,;=%-]*)?$"


def _https(address: str) -> str:
    if not re.search(_URL, address) or address.endswith("\n"):
        raise ValueError(
            "an address begins with https:// and a host, without a user; other characters than "
            "those of addresses are percent-encoded, in hosts as xn--"
        )
    return address


Url = Annotated[
    str, Field(max_length=500, json_schema_extra={"pattern": _URL}), AfterValidator(_https)
]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Licence = Annotated[str, Field(min_length=1, max_length=120), AfterValidator(known_licence)]
Contact = Annotated[str, Field(min_length=3, max_length=200), AfterValidator(_reachable)]
Bibtex = Annotated[
    str,
    Field(pattern=r"^\s*@[A-Za-z]+\s*\{[\s\S]*\}\s*$", max_length=4000),
    AfterValidator(_entry),
]
