"""E57 (ASTM E2807): points of laser scanners and of photogrammetry, each scan at its place.

A file is pages of bytes with a checksum each; in them lie an XML text, which says what there is,
and for each scan packets, in which every coordinate is a stream of its own. The packages for it
(pye57, e57) hold whole scans in memory, and end the process over some damaged files.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from airzoo_bench.core.plurals import counted
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud, refusal
from airzoo_bench.formats.clouds.e57_header import Scan, read_scans
from airzoo_bench.formats.clouds.e57_pages import Pages, damaged
from airzoo_bench.geometry.arrays import Floats

__all__ = ["open_e57"]

_SECTION = struct.Struct("<B7xQQQ")
_PACKET = struct.Struct("<BBHH")
_COMPRESSED, _DATA = 1, 1
_POINTS_BEHIND = 1 << 22
_AXES = ("cartesianX", "cartesianY", "cartesianZ")
_COLOURS = ("colorRed", "colorGreen", "colorBlue")
_INVALID = "cartesianInvalidState"


def open_e57(path: Path) -> FileCloud:
    """Open an E57 file: the points of all its scans, each moved by its pose.

    Raises
    ------
    PredictionError
        It is damaged, or holds scans without Cartesian coordinates, or none at all.
    """
    pages, scans = read_scans(path)
    if not scans:
        raise refusal(path, "holds no scan", expected="an E57 file with points")
    for scan in scans:
        if not set(_AXES) <= scan.fields.keys():
            raise refusal(
                path,
                f"its scans lack cartesianX, Y or Z; they have {', '.join(scan.fields)[:80]}",
                expected="Cartesian coordinates",
                fix="export it again with Cartesian coordinates, e.g. from CloudCompare",
            )
    count = sum(scan.count for scan in scans)
    precision = np.result_type(*(scan.fields[axis].precision for scan in scans for axis in _AXES))
    notes = (f"{counted(len(scans), 'scan')}, each at its pose",)
    return FileCloud(path, "E57", count, partial(_read, pages, scans), precision, notes)


def _read(pages: Pages, scans: list[Scan], points: int) -> Iterator[Cloud]:
    coloured = all(set(_COLOURS) <= scan.fields.keys() for scan in scans)
    waiting: list[Cloud] = []
    for scan in scans:
        for piece in _pieces(pages, scan, coloured):
            waiting.append(piece)
            while sum(map(len, waiting)) >= points:
                whole = _joined(waiting)
                yield _part(whole, slice(0, points))
                waiting = [_part(whole, slice(points, None))]
    rest = _joined(waiting)
    if len(rest):
        yield rest


def _part(cloud: Cloud, rows: slice) -> Cloud:
    return Cloud(cloud.points[rows], None if cloud.colours is None else cloud.colours[rows])


def _joined(clouds: list[Cloud]) -> Cloud:
    if len(clouds) == 1:
        return clouds[0]
    colours = [cloud.colours for cloud in clouds if cloud.colours is not None]
    points = np.concatenate([np.empty((0, 3)), *(cloud.points for cloud in clouds)])
    return Cloud(points, np.concatenate(colours) if colours else None)


def _pieces(pages: Pages, scan: Scan, coloured: bool) -> Iterator[Cloud]:
    """Yield the points of a scan as packets bring them."""
    wanted = [*_AXES, *(_COLOURS if coloured else ()), *([_INVALID] * (_INVALID in scan.fields))]
    streams = {name: scan.fields[name].stream() for name in wanted}
    places = {name: place for place, name in enumerate(scan.fields) if name in streams}
    left = scan.count
    packets = _packets(pages, scan)
    while left:
        ready = min(min(stream.ready for stream in streams.values()), left, _POINTS_BEHIND)
        if not ready:
            buffers = next(packets, None)
            if buffers is None:
                raise damaged(pages.path, f"a scan ends {counted(left, 'point')} before its count")
            for name, place in places.items():
                streams[name].feed(buffers[place])
            if max(stream.held for stream in streams.values()) > _POINTS_BEHIND:
                raise damaged(pages.path, "its coordinates are not packed together")
            continue
        values = {name: stream.take(ready) for name, stream in streams.items()}
        left -= ready
        yield _cloud(scan, values, coloured)


def _cloud(scan: Scan, values: dict[str, Floats], coloured: bool) -> Cloud:
    points = np.stack([values[axis] for axis in _AXES], axis=-1)
    if _INVALID in values:
        points[values[_INVALID] != 0.0] = np.nan
    with np.errstate(invalid="ignore", over="ignore"):
        moved = scan.placed(points)
    if not coloured:
        return Cloud(moved)
    colours = [scan.fields[name].share(values[name]) for name in _COLOURS]
    return Cloud(moved, np.rint(np.stack(colours, axis=-1) * 255.0).astype(np.uint8))


def _packets(pages: Pages, scan: Scan) -> Iterator[list[bytes]]:
    """Yield the buffers of each packet of data, one a field."""
    kind, length, data, _ = _SECTION.unpack(pages.read(scan.offset, _SECTION.size, physical=True))
    start = pages.logical(scan.offset)
    if kind != _COMPRESSED:
        raise damaged(pages.path, "a scan's section is of another kind")
    place, end = pages.logical(data), start + length
    while place + _PACKET.size <= end:
        kind, _, size, streams = _PACKET.unpack(pages.read(place, _PACKET.size))
        whole = pages.read(place, size + 1)
        if kind == _DATA:
            yield _buffers(pages.path, whole, streams, len(scan.fields))
        place += size + 1


def _buffers(path: Path, packet: bytes, streams: int, fields: int) -> list[bytes]:
    start = _PACKET.size + 2 * streams
    if streams != fields or start > len(packet):
        raise damaged(path, "a packet holds another number of fields than its scan")
    sizes = struct.unpack_from(f"<{streams}H", packet, _PACKET.size)
    if start + sum(sizes) > len(packet):
        raise damaged(path, "a packet is shorter than its fields")
    buffers = []
    for size in sizes:
        buffers.append(packet[start : start + size])
        start += size
    return buffers
