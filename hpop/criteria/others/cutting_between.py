"""Crossing between people who talk with each other."""

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

CHORDS = 8  # number of straight pieces that approximate a curve
STEP = 0.25  # m: in a piece, people on tracks, or at different velocities, walk at most this far
MOST_CHORDS = 512


@criterion(
    "cutting_between", group="O", unit="1", aggregate="sum", requires=("base", "groups"), smooth=False, quantum=1.0
)
@dataclass(frozen=True)
class CuttingBetween:
    """Number of times that the path crosses between two people who talk, summed over all pairs of each conversation.

    A crossing is one of the segment between the positions p_i and p_j of the two people. Unit 1; a sum over motions. A
    pair counts while both people are present. A point exactly on the line through the two counts as left of the
    direction from p_i to p_j. So a path can be cut anywhere, even on the segment, and each crossing still counts once.
    A path that comes from the right, touches the segment and turns back counts twice; one from the left not at all.

    A motion is approximated by straight pieces: one for a straight move, eight for a curve, and the paths of people
    likewise. That is exact for straight moves and for people who walk side by side. If people follow tracks or walk at
    different velocities, so that the segment turns, a person walks at most 0.25 m in a piece, with at most 512 pieces.

    If positions are uncertain or a person has several predicted futures, the expected number of crossings cannot be
    computed from the distribution of positions at each moment, and CriterionError is raised.
    """

    def cost(self, m: Motions) -> Column:
        """Return the number of crossings (M,)."""
        content = m.world.content
        pairs = [(content.people[i], content.people[j]) for group in content.groups for i, j in combinations(group, 2)]
        talking = [person for pair in pairs for person in pair]
        check_one_future("cutting_between", talking)
        _check_sure(talking)
        walks = any_moves(talking)
        if walks and m.t0 is None:
            raise CriterionError(
                "'cutting_between' needs the time at which each motion begins, because people in a group walk, but "
                "this planner plans without time; give the people no velocity, or plan by 'lattice' or 'roadmap'"
            )
        within = m.moments(_pieces(m, talking))
        poses = [m.base.start, *(s.base for s in within), m.base.end]
        times = [m.t0, *(s.t for s in within), m.t0 + m.duration] if walks else [None] * len(poses)
        crossings = 0.0 * m.base.start.x
        for pair in pairs:
            relative = [_relative_to(pair, pose.x, pose.y, t) for pose, t in zip(poses, times, strict=True)]
            pieces = zip(pairwise(relative), pairwise(times), strict=True)
            crossings = crossings + sum(_crosses_pair(*ends, *interval, pair) for ends, interval in pieces)
        return crossings


def _relative_to(pair: tuple[Person, Person], x: Column, y: Column, t: Column | None) -> tuple[Column, Column]:
    """Return a position (x, y) relative to the segment between two people, at times t, as two columns.

    The first is the coordinate along the segment, from 0 at the first person to 1 at the second. The other is the
    distance to its left, also in lengths of the segment.
    """
    ax, ay = position(pair[0], t)
    bx, by = position(pair[1], t)
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    scale = 1.0 / np.where(square > 0, square, np.inf)  # no segment between people at one position
    return ((x - ax) * dx + (y - ay) * dy) * scale, ((y - ay) * dx - (x - ax) * dy) * scale


def _pieces(m: Motions, people: list[Person]) -> int:
    """Return the number of pieces per phase of the motions, in which robot and people count as moving straight."""
    chords = CHORDS if isinstance(m.law, Curve) else 1
    if not any(person.track for person in people) and len({person.velocity for person in people}) < 2:
        return chords  # all stand, or walk side by side: straight motions are straight relative to them
    farthest = float(np.max(m.duration)) * max(person.speed for person in people)
    return int(np.clip(np.ceil(farthest / STEP), chords, MOST_CHORDS))


def _crosses_pair(
    begin: tuple[Column, Column],
    end: tuple[Column, Column],
    t_begin: Column | None,
    t_end: Column | None,
    pair: tuple[Person, Person],
) -> Column:
    """Return whether (1 or 0, (M,)) straight moves cross the segment between two people while both are present.

    begin, end      positions relative to the segment, from :func:`_relative_to`
    t_begin, t_end  s, times at both ends, or None for people who stand
    """
    (along, left), (to_along, to_left) = begin, end
    changes = np.where(np.logical_and(left >= 0, to_left < 0), 1.0, 0.0)
    changes = np.where(np.logical_and(left < 0, to_left >= 0), 1.0, changes)
    share = left / np.where(changes > 0, left - to_left, 1.0)
    crossing = along + share * (to_along - along)
    t = None if t_begin is None else t_begin + share * (t_end - t_begin)
    present = prod(person.there(t) for person in pair)
    return present * np.where(np.logical_and(crossing >= 0, crossing <= 1), changes, 0.0)


def _check_sure(people: list[Person]) -> None:
    """Raise CriterionError if the position of a person is uncertain."""
    for person in people:
        if person.spread or person.growth:
            raise CriterionError(
                f"'cutting_between' needs certain positions, but that of {named_as('person', person.name)} is "
                "uncertain; give this person no spread and no growth, or use 'o_space' instead"
            )
