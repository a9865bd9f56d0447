"""What fills a block of the city."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

from airzoo_bench.datasets.mini.noise import Dice
from airzoo_bench.datasets.mini.world.city_site import (
    Site,
    anywhere,
    fill_yard,
    park,
    park_cars,
    scatter_trees,
    sports,
    store,
)
from airzoo_bench.datasets.mini.world.plan import add_barn, add_block, add_house
from airzoo_bench.datasets.mini.world.shapes import Ellipse, Frame, Rect, Stroke, square, steps

__all__ = ["fill_block"]

_PAVEMENT_M = 4.0


def fill_block(site: Site, dice: Dice, block: Rect, kind: str | None) -> None:
    """Pave and build on a block; where no kind is named, one is drawn."""
    site.paint("kerb", block)
    site.paint("slabs", block.inset(0.35), dice.integer(0, 999))
    _line_with_trees(site, dice, block)
    if kind is None:
        kind = dice.pick(_COMMON if site.allows(block) else _SMALL)
    _KINDS[kind](site, dice, block.inset(_PAVEMENT_M))


def _line_with_trees(site: Site, dice: Dice, block: Rect) -> None:
    gap = dice.real(8.0, 13.0)
    for start, end, v, turned in (
        (block.u0, block.u1, block.v0 + 1.4, False),
        (block.u0, block.u1, block.v1 - 1.4, False),
        (block.v0, block.v1, block.u0 + 1.4, True),
        (block.v0, block.v1, block.u1 - 1.4, True),
    ):
        if dice.chance(30):
            continue
        for place in steps(start + 6, end - 6, gap):
            if dice.chance(80):
                at = (v, place) if turned else (place, v)
                spot = block.frame.at(*at)
                site.paint("soil", square(spot, 0.75, 0.75))
                site.plant(dice, spot, 2.1)


def _terrace(site: Site, dice: Dice, lot: Rect) -> None:
    """Rows of joined houses around a courtyard."""
    yard = lot.inset(13.0)
    site.paint(dice.pick(("lawn", "plates", "slabs")), yard, dice.integer(0, 999))
    site.paint("worn", yard, dice.integer(0, 3))
    fill_yard(site, dice, yard)
    deep = dice.real(9.5, 12.0)
    flat = dice.chance(35)
    for v in (lot.v0, lot.v1 - deep):
        _row(site, dice, Rect(lot.frame, lot.u0, lot.u1, v, v + deep), flat)
    for u in (lot.u0, lot.u1 - deep):
        ends = lot.v0 + deep + dice.pick((0.0, 5.0)), lot.v1 - deep
        # The row runs along v: its own u is v of the block.
        turned = lot.frame.at(0, 0, turned=True)
        _row(site, dice, Rect(turned, *ends, -u - deep, -u), flat)


def _row(site: Site, dice: Dice, strip: Rect, flat: bool) -> None:
    """Build joined houses along u of a strip, now and then leaving a gap."""
    place, end = strip.u0, strip.u1
    storeys = dice.integer(2, 5)
    while place < end - 8:
        long = min(dice.real(9.0, 22.0), end - place)
        if end - place - long < 8:
            long = end - place
        storeys = max(2, storeys + dice.integer(-1, 1))
        if not dice.chance(7):
            add = add_block if flat or dice.chance(20) else add_house
            rect = Rect(strip.frame, place, place + long, strip.v0, strip.v1)
            site.build(dice, add, rect, storeys)
        place += long


def _slab_rows(site: Site, dice: Dice, lot: Rect) -> None:
    """Long blocks of flats in parallel, with green and cars between."""
    site.paint("lawn", lot, 1)
    gap, deep = dice.real(17.0, 24.0), dice.real(10.0, 13.0)
    storeys = dice.integer(4, 8)
    v = lot.v0 + 2.0
    while v + deep < lot.v1:
        middle = lot.u0 + lot.long * dice.real(0.35, 0.65)
        path = Rect(lot.frame, lot.u0, lot.u1, v + deep + 1, v + deep + 4)
        site.paint("slabs", path, dice.integer(0, 99))
        for ends in ((lot.u0 + 2, middle - 3), (middle + 3, lot.u1 - 2)):
            if ends[1] - ends[0] > 14:
                rect = Rect(lot.frame, *ends, v, v + deep)
                site.paint("paving", rect.inset(-1.5))
                add = add_house if dice.chance(25) else add_block
                site.build(dice, add, rect, storeys + dice.integer(-1, 1))
        _between_slabs(site, dice, Rect(lot.frame, lot.u0, lot.u1, v + deep + 4, v + deep + gap))
        v += deep + gap


def _between_slabs(site: Site, dice: Dice, strip: Rect) -> None:
    if strip.deep > 12 and dice.chance(55):
        lot = Rect(strip.frame, strip.u0 + 4, strip.u1 - 12, strip.v0, strip.v0 + 9)
        park_cars(site, dice, lot)
    else:
        site.paint("flowers", strip.inset(3.0), dice.integer(0, 9))
        site.paint("gravel", strip.inset(4.0))
    for _ in range(int(strip.long / 6)):
        verge = Rect(strip.frame, strip.u0, strip.u1, strip.v1 - 4, strip.v1)
        site.plant(dice, anywhere(dice, verge), 2.2)


def _houses(site: Site, dice: Dice, lot: Rect) -> None:
    """Small houses in gardens, with a lane in the middle."""
    columns = max(int(lot.long / dice.real(15.0, 19.0)), 1)
    rows = max(int(lot.deep / dice.real(18.0, 22.0)), 1)
    wide, high = lot.long / columns, lot.deep / rows
    for row, column in product(range(rows), range(columns)):
        u, v = lot.u0 + (column + 0.5) * wide, lot.v0 + (row + 0.5) * high
        _garden(site, dice, lot.frame.at(u, v), wide / 2, high / 2)
    if rows > 2:
        v = lot.v0 + high * (rows // 2)
        site.paint("lane", Rect(lot.frame, lot.u0 - 3, lot.u1 + 3, v - 2.0, v + 2.0))


def _garden(site: Site, dice: Dice, frame: Frame, half_u: float, half_v: float) -> None:
    whole = square(frame, half_u, half_v)
    site.paint("bed", whole)
    cover = dice.pick(("lawn", "lawn", "lawn", "beds", "gravel", "slabs", "rough"))
    site.paint(cover, whole.inset(0.5), dice.integer(0, 99))
    u, v = dice.real(-1.0, 1.0), dice.real(-2.5, 2.5)
    house = square(frame.at(u, v), dice.real(4.2, half_u - 2.4), dice.real(4.4, 6.0))
    site.paint("paving", house.inset(-1.2))
    site.paint("slabs", Rect(frame, half_u - 3.2, half_u - 0.6, -half_v, v), dice.integer(0, 99))
    if dice.chance(60):
        for season in (1, 2):
            if dice.chance(70):
                spot = frame.at(half_u - 1.9, -half_v + dice.real(2.5, 5.0), turned=True)
                site.paint("car", square(spot, 2.2, 0.9), dice.integer(0, 99), season)
    if dice.chance(12):
        site.paint("kerb", square(frame.at(-2, half_v - 3), 3.4, 2.0))
        site.paint("pool", square(frame.at(-2, half_v - 3), 3.0, 1.6))
    if site.build(dice, add_house, house, dice.integer(1, 3)) and dice.chance(35):
        wing = square(frame.at(u - 1.0, v + house.v1 + 2.0), 2.4, 2.0)
        site.build(dice, add_house, wing, 1)
    for _ in range(dice.integer(0, 4)):
        u, v = dice.real(-half_u, half_u), dice.pick((-1, 1)) * dice.real(half_v - 3, half_v)
        spot = frame.at(u, v)
        site.plant(dice, spot, 1.7, dice.pick(("broad", "broad", "bush", "cone")))


def _mall(site: Site, dice: Dice, lot: Rect) -> None:
    """Lay out a big flat hall next to its parking lot."""
    site.paint("plates", lot, dice.integer(0, 999))
    middle = lot.u0 + lot.long * dice.real(0.45, 0.6)
    hall = Rect(lot.frame, lot.u0 + 3, middle, lot.v0 + 4, lot.v1 - 4)
    if not site.build(dice, add_block, hall, dice.integer(2, 4)):
        fill_yard(site, dice, hall)
    park_cars(site, dice, Rect(lot.frame, middle + 5, lot.u1 - 1, lot.v0 + 2, lot.v1 - 2))
    for place in steps(lot.v0 + 8, lot.v1 - 4, 12.0):
        site.plant(dice, lot.frame.at(middle + 3.4, place), 1.6)


def _towers(site: Site, dice: Dice, lot: Rect) -> None:
    """Tall blocks in a green, joined by paths."""
    site.paint("lawn", lot, 2)
    middle = lot.middle
    site.paint("paving", Ellipse(middle, 14.0, 11.0))
    site.paint("flowers", Ellipse(middle, 9.0, 6.5), dice.integer(0, 9))
    site.paint("pool", Ellipse(middle, 4.5, 3.0))
    for a, b in product((0.24, 0.76), repeat=2):
        u, v = lot.u0 + a * lot.long, lot.v0 + b * lot.deep
        spot = lot.frame.at(u + dice.real(-4, 4), v + dice.real(-4, 4))
        site.paint("gravel", Stroke((spot.origin, middle.origin), 2.5))
        plaza = square(spot, dice.real(8.0, 11.5), dice.real(7.0, 9.5))
        site.paint("slabs", plaza.inset(-3.0), dice.integer(0, 999))
        site.build(dice, add_block, plaza, dice.integer(7, 13))
    scatter_trees(site, dice, lot, 22)


def _works(site: Site, dice: Dice, lot: Rect) -> None:
    """Halls with metal roofs in a yard of concrete."""
    site.paint("plates", lot, dice.integer(0, 999))
    site.paint("worn", lot, 1)
    u = lot.u0 + 2
    while u < lot.u1 - 16:
        wide = min(dice.real(14.0, 26.0), lot.u1 - 2 - u)
        split = lot.v0 + lot.deep * dice.real(0.3, 0.7)
        for v0, v1 in ((lot.v0 + 2, split - 4), (split + 4, lot.v1 - 2)):
            hall = Rect(lot.frame, u, u + wide, v0, v1)
            if not dice.chance(85) or not site.build(dice, add_barn, hall, dice.integer(5, 9)):
                store(site, dice, hall)
        u += wide + dice.real(5.0, 9.0)


# Where the border or the canal cuts a block, one big hall would leave a waste.
_SMALL = ("terrace", "slabs", "houses", "houses", "park")
_COMMON = ("terrace", "terrace", "slabs", "slabs", "houses", "houses", "towers", "mall", "works")

_KINDS: dict[str, Callable[[Site, Dice, Rect], None]] = {
    "houses": _houses,
    "mall": _mall,
    "park": park,
    "slabs": _slab_rows,
    "sports": sports,
    "terrace": _terrace,
    "towers": _towers,
    "works": _works,
}
