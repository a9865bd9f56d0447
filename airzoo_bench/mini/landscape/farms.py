"""Farms: a house, barns and sheds around a yard."""

from __future__ import annotations

from airzoo_bench.mini.landscape.houses import add_barn, add_house
from airzoo_bench.mini.landscape.plan import Plan, Tree, square
from airzoo_bench.mini.landscape.randomness import Dice
from airzoo_bench.mini.landscape.shapes import Ellipse, Frame

__all__ = ["YARD_M", "add_farm"]

# Half the level ground of a farm.
YARD_M = (34.0, 28.0)


def add_farm(plan: Plan, dice: Dice, frame: Frame) -> None:
    """Lay out a farm about a frame's origin, on ground that is level already."""
    plan.paint("rough", Ellipse(frame, YARD_M[0] + 4, YARD_M[1] + 4))
    plan.paint("meadow", Ellipse(frame, YARD_M[0], YARD_M[1]))
    plan.paint(
        dice.pick(("gravel", "plates", "track")), square(frame, 23.0, 15.0), dice.integer(0, 99)
    )
    plan.paint("worn", square(frame, 25.0, 17.0), dice.integer(0, 3))
    for u, v in ((0.0, -21.5), (19.0, -21.0)):
        bed = square(frame.at(u + dice.real(-2, 2), v), 8.0, 4.5)
        plan.paint(dice.pick(("beds", "beds", "lawn")), bed, dice.integer(0, 99))
    _add_buildings(plan, dice, frame)
    _add_things(plan, dice, frame)
    for _ in range(dice.integer(7, 12)):
        u, v = dice.pick((-1, 1)) * dice.real(24, 33), dice.real(-24, 24)
        x, y = frame.to_world(u, v)
        radius = dice.real(1.6, 3.6)
        kind = dice.pick(("broad", "broad", "bush", "cone"))
        plan.trees.append(Tree(x, y, radius, radius * (3.2 if kind == "cone" else 2.4), kind))


def _add_buildings(plan: Plan, dice: Dice, frame: Frame) -> None:
    house = frame.at(dice.real(-17, -13), dice.real(-9, -6))
    add_house(plan, dice, house, dice.real(5.5, 7.5), dice.real(4.5, 5.5), dice.integer(1, 2))
    barn = frame.at(dice.real(-6, 0), dice.real(16, 18))
    plan.paint("plates", square(barn, 15.0, 8.0), dice.integer(0, 99))
    add_barn(plan, dice, barn, dice.real(10, 14), dice.real(5.5, 7), dice.real(4.5, 6.0))
    side = frame.at(dice.real(17, 20), dice.real(-4, 3), turned=True)
    add_barn(plan, dice, side, dice.real(7, 11), dice.real(4, 5.5), dice.real(3.5, 5.0))
    shed = frame.at(dice.real(-3, 3), dice.real(-12, -10))
    add_barn(plan, dice, shed, dice.real(2.5, 4), dice.real(2, 2.8), 2.6)
    if dice.chance(60):
        wing = frame.at(-25.0, dice.real(6.5, 9), turned=True)
        add_house(plan, dice, wing, dice.real(4.5, 6), dice.real(3.4, 4.2), 1)


def _add_things(plan: Plan, dice: Dice, frame: Frame) -> None:
    for season in (1, 2):
        for _ in range(dice.integer(2, 5)):
            spot = frame.at(dice.real(-9, 12), dice.real(-5, 7), turned=dice.chance(50))
            plan.paint("car", square(spot, 2.2, 0.95), dice.integer(0, 99), season=season)
    for _ in range(14):
        spot = frame.at(dice.real(-24, 24), dice.pick((-1, 1)) * dice.real(9, 14))
        half = dice.pick(((1.5, 1.0), (0.8, 0.8), (2.5, 1.2)))
        kind = dice.pick(("wood", "rubbish", "tar", "sand", "soil"))
        plan.paint(kind, square(spot, *half), season=dice.integer(0, 2))
    if dice.chance(60):
        gone = square(frame.at(dice.real(-3, 8), -21), dice.real(4, 7), dice.real(2.5, 4))
        plan.paint("old_roof", gone, dice.integer(0, 99), season=2)
    for _ in range(dice.integer(0, 6)):
        x, y = frame.to_world(dice.real(6, 12), dice.real(8, 11))
        plan.trees.append(Tree(x, y, 0.8, 1.3, "bale"))
