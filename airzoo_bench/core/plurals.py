"""Numbers of things in messages, which agree with what they count."""

from __future__ import annotations

__all__ = ["agreeing", "counted", "plural", "sized"]


def plural(noun: str) -> str:
    """Return ``queries`` of ``query``, ``scenes`` of ``scene``, ``matches`` of ``match``."""
    if noun.endswith("y") and noun[-2:-1] not in "aeiou":
        return f"{noun[:-1]}ies"
    return f"{noun}es" if noun.endswith(("s", "x", "ch", "sh")) else f"{noun}s"


def counted(number: int, noun: str, several: str | None = None) -> str:
    """Return ``1 scene``, ``18 queries``, ``12,000 points have``."""
    return f"{number:,} {agreeing(number, noun, several or plural(noun))}"


def agreeing(number: int, one: str, several: str) -> str:
    """Return the form of a word that agrees with a number, such as ``is`` or ``are``."""
    return one if number == 1 else several


def sized(count: int) -> str:
    """Return ``1.2 GB`` of a number of bytes."""
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return counted(count, "byte")
