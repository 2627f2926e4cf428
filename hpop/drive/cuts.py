"""Where a plan is cut by what is closed, and where the robot then stands."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray
from hpop.drive.closings import Closing
from hpop.drive.plan import SAME, Plan, between
from hpop.motions import Collision, laws_of
from hpop.motions.by_law import batches
from hpop.trajectories.contacts import STEP, first_contact
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, World

HALVINGS = 20  # of a motion in which a robot would touch what is closed


class Cut(NamedTuple):
    """What a closing leaves of a plan; its times are the plan's, s.

    safe   until when the plan may be driven, None for all the way
    stops  when the robot stands, None where it arrives
    """

    safe: float | None
    stops: float | None


def cut_of(
    plan: Plan, t: float, closings: Iterable[Closing], people: Sequence[Person] = (), margin: float = 0.0
) -> Cut:
    """What is left of a plan from a time on, at which the robot touches none of some closings.

    Nor may it come nearer than ``margin``, m, to ``people``, as they are predicted from then on: by the plan,
    and as it is executed where that keeps the plan's clock. Who stands is not safe from people who walk: then another
    way is to be taken in time.

    The robot stands at the last place before where it may leave its plan, so that it goes on driving while others are
    looked for. Where it cannot stop there any more it brakes, and where it would touch what is closed while it brakes
    it stops at once.
    """
    touches = [at for closing in closings if (at := _touches(plan.announced, t, closing)) is not None]
    if people:
        # By the plan's own times: of a turn that is under way the rest, as a turn of its own, would take longer.
        way, parts = plan.announced, plan.announced.model.platform
        ways = {way, way.execution()} if way.punctual else {way}
        for one, least in product(ways, {0.0, margin}):  # a margin may be left within a second, but nobody be touched
            met, begin = first_contact(parts, people, one, least, begin=t), t
            if met is not None and t < plan.chosen <= t + met[0]:
                begin, then = plan.chosen, [person.later(plan.chosen - t) for person in people]
                met = first_contact(parts, then, one, least, begin=begin)
            touches += [] if met is None else [begin + max(0.0, met[0] - STEP)]
    if not touches:
        return Cut(None, None)
    safe, end = min(touches), plan.announced.duration
    brakes = plan.braked(t)
    whole = Plan(plan.announced)
    times = whole.driven.times[whole.arrivals]
    able = times[(times >= brakes) & (times <= safe) & ((times < end) | (safe < end))]
    if able.size:
        return Cut(safe, float(able[-1]))
    if safe >= end:  # as it stops at the goal, from which it can no more keep away
        return Cut(None, None)
    return Cut(safe, brakes if brakes <= safe else _at_once(plan.announced, t, safe))


def closed_ways(ways: Sequence[Trajectory], closings: Iterable[Closing]) -> BoolArray:
    """Which of some ways (n,) lead through any of some closings."""
    closed = np.zeros(len(ways), dtype=np.bool_)
    for closing in closings:
        for owner, motions in batches(ways, closing.alone):
            closed[owner[~closing.collision(motions.model).motions_free(motions)]] = True
    return closed


def _at_once(way: Trajectory, t: float, safe: float) -> float:
    """When a robot stands that stops as soon as it can: in a straight run just before what is closed, else now."""
    return safe if "x" in laws_of(way.model)[way.kinds[_motion(way, safe)]].varies else t


def _motion(way: Trajectory, t: float) -> int:
    """The motion that is under way just before a time."""
    return max(0, int(np.searchsorted(way.times, t, side="left")) - 1)


def _touches(way: Trajectory, t: float, closing: Closing) -> float | None:
    """Until when a way is free of a closing from a time on; None where it always is."""
    collision = closing.collision(way.model)
    rest = between(way, t, way.duration)
    free = _free(rest, collision, closing.alone)
    if free.all():
        return None
    # By the way's own times: of a turn that is under way the rest, as a turn of its own, would take longer.
    first = int(np.searchsorted(way.times, t + SAME, side="right")) - 1 + int(np.argmin(free))
    begin = low = max(t, float(way.times[first]))
    high = float(way.times[first + 1])
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        some = between(way, begin, middle)
        low, high = (middle, high) if _free(some, collision, closing.alone).all() else (low, middle)
    return low


def _free(way: Trajectory, collision: Collision, world: World) -> BoolArray:
    """Which motions (n,) of a way are free."""
    free = np.ones(len(way), dtype=np.bool_)
    for index, motions in way.batches(world):
        free[index] = collision.motions_free(motions)
    return free
