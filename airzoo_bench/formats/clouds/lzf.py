"""LZF, the compression of PCD's ``binary_compressed``."""

from __future__ import annotations

__all__ = ["decompress"]

_LONGEST_LITERAL = 32


def decompress(data: bytes, size: int) -> bytearray | None:
    """Undo Marc Lehmann's LZF."""
    out = bytearray()
    place, end = 0, len(data)
    try:
        while place < end and len(out) <= size:
            control = data[place]
            place += 1
            if control < _LONGEST_LITERAL:
                out += data[place : place + control + 1]
                place += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[place]
                place += 1
            distance = ((control & 0x1F) << 8 | data[place]) + 1
            place += 1
            if not _copy(out, distance, length + 2):
                return None
    except IndexError:
        return None
    return out if place == end and len(out) == size else None


def _copy(out: bytearray, distance: int, length: int) -> bool:
    start = len(out) - distance
    if start < 0:
        return False
    piece = out[start : start + length]
    # A copy may reach into what it writes; the piece then repeats itself.
    out += (piece * -(-length // distance))[:length] if distance < length else piece
    return True
