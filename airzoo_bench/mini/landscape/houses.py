"""Buildings of a few kinds, with their roofs and what stands on them."""

from __future__ import annotations

from dataclasses import replace

from airzoo_bench.mini.landscape.plan import Building, Plan, Roof, square
from airzoo_bench.mini.landscape.randomness import Dice
from airzoo_bench.mini.landscape.shapes import Frame

__all__ = ["add_barn", "add_block", "add_house", "overlaps_border"]

Colour = tuple[int, int, int]

TILES: tuple[Colour, ...] = (
    (172, 96, 72),
    (156, 82, 64),
    (136, 100, 86),
    (104, 104, 110),
    (186, 118, 84),
    (128, 70, 58),
    (92, 88, 92),
)
METAL: tuple[Colour, ...] = (
    (78, 118, 166),
    (166, 170, 174),
    (124, 148, 130),
    (180, 84, 70),
    (200, 198, 190),
    (96, 104, 116),
)
FLAT: tuple[Colour, ...] = (
    (204, 204, 200),
    (178, 174, 168),
    (150, 146, 144),
    (120, 118, 120),
    (192, 176, 154),
    (160, 150, 136),
    (98, 98, 104),
    (148, 104, 88),
)
WALLS: tuple[Colour, ...] = (
    (206, 198, 184),
    (188, 160, 132),
    (216, 212, 204),
    (170, 116, 92),
    (184, 186, 186),
    (214, 190, 146),
    (150, 146, 142),
    (196, 172, 158),
)
GLASS: tuple[Colour, ...] = ((58, 72, 88), (74, 90, 104), (46, 54, 60), (88, 104, 110))

_BORDER_M = 4.0
_SIDE_M = 600.0


def overlaps_border(points: list[tuple[float, float]]) -> bool:
    """Return whether a point is outside the region, or nearly."""
    low, high = _BORDER_M, _SIDE_M - _BORDER_M
    return any(not (low < x < high and low < y < high) for x, y in points)


def add_house(
    plan: Plan, dice: Dice, frame: Frame, half_u: float, half_v: float, storeys: int
) -> int:
    """Add a house with a pitched roof, its ridge along u where that is longer; return its index."""
    if half_v > half_u:
        frame, half_u, half_v = frame.at(0, 0, turned=True), half_v, half_u
    rect = square(frame, half_u, half_v)
    base = plan.floor(rect)
    eaves = base + 3.0 * storeys + 0.6
    roof = dice.pick((Roof.GABLED, Roof.GABLED, Roof.HIPPED))
    rise = half_v * dice.pick((0.5, 0.6, 0.75, 0.85))
    cover = dice.pick(("tiles", "tiles", "tiles", "metal"))
    colours = TILES if cover == "tiles" else METAL
    return _add(
        plan,
        dice,
        Building(rect, base, eaves, eaves + rise, roof, cover, dice.pick(colours), WALLS[0]),
    )


def add_block(
    plan: Plan, dice: Dice, frame: Frame, half_u: float, half_v: float, storeys: int
) -> int:
    """Add a building with a flat roof and what stands on it; return its index."""
    rect = square(frame, half_u, half_v)
    base = plan.floor(rect)
    eaves = base + 3.0 * storeys + 1.2
    cover = dice.pick(("membrane", "membrane", "gravel", "slabs"))
    building = Building(
        rect,
        base,
        eaves,
        eaves,
        Roof.FLAT,
        cover,
        dice.pick(FLAT),
        WALLS[0],
        style=dice.integer(0, 2),
    )
    index = _add(plan, dice, building)
    _add_roof_boxes(plan, dice, index)
    return index


def add_barn(
    plan: Plan, dice: Dice, frame: Frame, half_u: float, half_v: float, wall_m: float
) -> int:
    """Add a barn, hall or shed without windows; return its index."""
    if half_v > half_u:
        frame, half_u, half_v = frame.at(0, 0, turned=True), half_v, half_u
    rect = square(frame, half_u, half_v)
    base = plan.floor(rect)
    eaves = base + wall_m
    roof = dice.pick((Roof.GABLED, Roof.GABLED, Roof.SHED))
    rise = half_v * (0.35 if roof is Roof.GABLED else 0.3)
    building = Building(
        rect, base, eaves, eaves + rise, roof, "metal", dice.pick(METAL), WALLS[0], style=3
    )
    return _add(plan, dice, building)


def _add(plan: Plan, dice: Dice, building: Building) -> int:
    plan.buildings.append(
        replace(
            building,
            wall_colour=dice.pick(WALLS),
            window_colour=dice.pick(GLASS),
            storey_m=dice.pick((3.0, 3.0, 3.2, 3.5)),
            bay_m=dice.pick((2.6, 3.0, 3.4, 4.0)),
        )
    )
    return len(plan.buildings) - 1


def _add_roof_boxes(plan: Plan, dice: Dice, parent: int) -> None:
    """Stair heads, tanks and machines, each in its own stretch of the roof."""
    building = plan.buildings[parent]
    rect = building.rect
    count = min(max(int((rect.u1 - rect.u0) / 9), 1), 7)
    stretch = (rect.u1 - rect.u0) / count
    for place in range(count):
        if dice.chance(25):
            continue
        half_u, half_v, tall = dice.pick(
            ((2.4, 1.6, 2.7), (1.0, 1.0, 1.8), (1.8, 0.9, 1.4), (1.2, 0.8, 1.2), (3.0, 2.0, 2.8))
        )
        room_u = stretch / 2 - half_u - 0.6
        room_v = rect.v1 - half_v - 1.0
        if room_u < 0 or room_v < 0:
            continue
        u = rect.u0 + stretch * (place + 0.5) + dice.real(-room_u, room_u)
        frame = rect.frame.at(u, dice.real(-room_v, room_v))
        low = building.eaves_m
        box = Building(
            square(frame, half_u, half_v),
            low,
            low + tall,
            low + tall,
            Roof.FLAT,
            "machine" if tall < 2 else "membrane",
            dice.pick(FLAT),
            dice.pick(WALLS),
            style=3,
            parent=parent,
        )
        plan.buildings.append(box)
