"""Cutting between people who talk with each other."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise
from math import prod

import numpy as np

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.criteria.others import check_one_future
from hpop.errors import CriterionError
from hpop.motions import Curve, Motions
from hpop.world.content.content import Person
from hpop.world.content.futures import named_as
from hpop.world.content.proxemics import any_moves, position

CHORDS = 8  # straight pieces that stand for a curve
STEP = 0.25  # m: nobody who follows a track, or walks another way than the others, walks farther in a piece
MOST_CHORDS = 512


@criterion(
    "cutting_between", group="O", unit="1", aggregate="sum", requires=("base", "groups"), smooth=False, quantum=1.0
)
@dataclass(frozen=True)
class CuttingBetween:
    """How often the path crosses a segment p_i p_j between two people of one conversation, all pairs counted.

    A place exactly on the line through the two counts as on the left of the way from p_i to p_j, so a path may be
    split anywhere, on the segment too, and each crossing counts once. A path that comes from the right, touches the
    segment and turns back has crossed it twice; one that does so from the left, not at all.

    Each motion is taken as straight from start to end, a curve as straight between eight moments, and so is the way of
    people who walk meanwhile: exact for straight moves, and for people who walk side by side. Where people follow
    tracks, or walk apart, so that the line between them turns, ways are taken as straight for a quarter of a metre that
    somebody walks, or a 512th of the motion. Two have a conversation while both are there.

    How often a way is crossed does not follow from where people may be at each moment: of uncertain places, and of
    several futures, it is refused.
    """

    def cost(self, m: Motions) -> Column:
        """Number of crossings (M,)."""
        content = m.world.content
        pairs = [tuple(content.people[i] for i in pair) for group in content.groups for pair in combinations(group, 2)]
        talking = [person for pair in pairs for person in pair]
        check_one_future("cutting_between", talking)
        _check_sure(talking)
        walks = any_moves(talking)
        if walks and m.t0 is None:
            raise CriterionError(
                "'cutting_between' needs to know when each motion begins, because people who talk walk; on a graph "
                "without time, give them no velocity"
            )
        within = m.moments(_pieces(m, talking))
        places = [m.base.start, *(s.base for s in within), m.base.end]
        times = [m.t0, *(s.t for s in within), m.t0 + m.duration] if walks else [None] * len(places)
        crossings = 0.0 * m.base.start.x
        for one, other in pairs:
            ways = [_seen_from(one, other, at.x, at.y, t) for at, t in zip(places, times, strict=True)]
            pieces = zip(pairwise(ways), pairwise(times), strict=True)
            crossings = crossings + sum(_crossed(*way, *when, (one, other)) for way, when in pieces)
        return crossings


def _seen_from(one: Person, other: Person, x: Column, y: Column, t: Column | None) -> tuple[Column, Column]:
    """Places (N,) along the way from one to the other (0 at the one, 1 at the other), and to its left, same scale."""
    ax, ay = position(one, t)
    bx, by = position(other, t)
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    scale = 1.0 / np.where(square > 0, square, np.inf)  # two at one place have nothing between them
    return ((x - ax) * dx + (y - ay) * dy) * scale, ((y - ay) * dx - (x - ax) * dy) * scale


def _pieces(m: Motions, people: list[Person]) -> int:
    """Straight pieces that stand for each phase of the motions and the ways of people meanwhile."""
    chords = CHORDS if isinstance(m.law, Curve) else 1
    if not any(person.track for person in people) and len({person.velocity for person in people}) < 2:
        return chords  # nobody walks, or all walk side by side: what is straight stays so beside them
    farthest = float(np.max(m.duration)) * max(person.speed for person in people)
    return int(np.clip(np.ceil(farthest / STEP), chords, MOST_CHORDS))


def _crossed(
    begin: tuple[Column, Column],
    end: tuple[Column, Column],
    t_begin: Column | None,
    t_end: Column | None,
    pair: tuple[Person, Person],
) -> Column:
    """1 where the straight way from begin to end crosses from 0 to 1 on the axis while both are there, else 0."""
    (along, left), (to_along, to_left) = begin, end
    changes = np.where(np.logical_and(left >= 0, to_left < 0), 1.0, 0.0)
    changes = np.where(np.logical_and(left < 0, to_left >= 0), 1.0, changes)
    share = left / np.where(changes > 0, left - to_left, 1.0)
    crossing = along + share * (to_along - along)
    t = None if t_begin is None else t_begin + share * (t_end - t_begin)
    there = prod(person.there(t) for person in pair)
    return there * np.where(np.logical_and(crossing >= 0, crossing <= 1), changes, 0.0)


def _check_sure(people: list[Person]) -> None:
    for person in people:
        if person.spread or person.growth:
            raise CriterionError(
                f"'cutting_between' counts crossings, of which there is no mean that follows from where people may be "
                f"at each moment; give {named_as('person', person.name)} no spread and no growth, or take "
                "'o_space'"
            )
