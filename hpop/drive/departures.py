"""How a way differs from the announced one: when it leaves it, on which sides it passes obstacles, its next turn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from hpop.base.arrays import FloatArray
from hpop.drive.closings import Closing
from hpop.motions import HOLD, laws_of
from hpop.planners.programs.smoothing.homotopy import holes, word
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

ALIKE = 1e-6  # m, rad or s: what differs by less is the same
STRAIGHT = "straight"


class Run(NamedTuple):
    """Motions of a way that nobody aboard tells apart: straight ones in a row, or another one.

    kind        its law's, "straight" of moves
    change      by how much each state changes
    begin, end  s
    """

    kind: str
    change: FloatArray
    begin: float
    end: float


def runs(way: Trajectory) -> list[Run]:
    """The runs of a way, in order."""
    steps = np.stack([np.diff(getattr(way.states, name)) for name in way.model.space.names], axis=1)
    found, laws = list[Run](), laws_of(way.model)
    for i, kind in enumerate(way.kinds):
        moves = "x" in laws[kind].varies
        run = Run(STRAIGHT if moves else kind, steps[i], float(way.times[i]), float(way.times[i + 1]))
        if moves and found and found[-1].kind == STRAIGHT:
            run = run._replace(change=found[-1].change + run.change, begin=found.pop().begin)
        found.append(run)
    return found


def leaves(way: Trajectory, announced: Trajectory) -> float | None:
    """When, s, a way leaves another that begins where it does; None where it never does.

    Both go straight ahead, so of two straight runs the shorter one is left at its end.
    """
    one, other = runs(way), runs(announced)
    for mine, theirs in zip(one, other, strict=False):
        if mine.kind != theirs.kind:
            return mine.begin
        if mine.kind in (STRAIGHT, HOLD.kind) and abs(mine.end - theirs.end) > ALIKE:
            return min(mine.end, theirs.end)
        if np.abs(mine.change - theirs.change).max() > ALIKE:
            return mine.begin
    return None if len(one) == len(other) else min(way.duration, announced.duration)


def next_turn(way: Trajectory, t: float) -> float | None:
    """When, s, the first turn of a way later than ``t`` begins; None where there is none."""
    later = [time for time, kind in zip(way.times.tolist(), way.kinds, strict=False) if kind == "turn" and time > t]
    return later[0] if later else None


def same_side(way: Trajectory, other: Trajectory, world: World, closings: Sequence[Closing] = ()) -> bool | None:
    """Whether two ways of a robot in the plane pass all obstacles and closings on the same sides, in the same order.

    None where they end at different places, so that there is no telling.
    """
    one, two = (np.stack([t.states.x, t.states.y], axis=1) for t in (way, other))
    if np.abs(one[-1] - two[-1]).max() > ALIKE:
        return None
    loop = np.concatenate([one, two[::-1], one[:1]])
    heights = {(part.z_min, part.z_max) for part in way.model.platform}
    points = [holes(loop, world.ground.free_space(z)) for z in sorted(heights)]
    # A point too many is harmless: two in one obstacle, or one that no free loop goes about.
    areas = [part for closing in closings for part in shapely.get_parts(closing.area)]
    points.append(shapely.get_coordinates(shapely.point_on_surface(areas)).reshape(-1, 2))
    return not word(loop, np.concatenate(points))
