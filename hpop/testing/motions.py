"""Motions of a differential drive drawn at random for checks of criteria."""

from __future__ import annotations

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.options import whole
from hpop.models.driven import ahead
from hpop.motions import HOLD, Model, Motions, States
from hpop.motions.hold import CLOCK
from hpop.world import World

MOST_DRAWN = 100_000
"""Motions that are drawn at once."""


@checked_arguments
def random_motions(rng: np.random.Generator, world: World, model: Model, kind: str, size: int) -> Motions:
    """Short moves, turns of up to half a turn either way across yaw = pi, holds, or curves; 0.5 m from what is blocked.

    Every third curve begins or ends standing, every fourth turns first one way and then the other.
    """
    size = whole("size", size, 1, MOST_DRAWN, "a number of motions")
    x, y = rng.uniform((0.5, 0.5), (11.5, 8.5), size=(50 * size + 1000, 2)).T
    x, y = (column[world.clearance(x, y) > 0.5][:size] for column in (x, y))
    yaw = rng.uniform(-np.pi, np.pi, size)
    if kind == "drive":
        speeds, bends = rng.uniform(0.3, 1.0, (2, size)), rng.uniform(0.4, 1.5, (2, size))
        speeds[rng.integers(0, 2, size), np.arange(size)] *= np.arange(size) % 3 > 0
        bends = bends * rng.choice([-1.0, 1.0], size) * np.array([np.ones(size), np.where(np.arange(size) % 4, 1, -1)])
        lasts = rng.uniform(0.2, 0.4, size)
        start = States(x=x, y=y, yaw=yaw, speed=speeds[0], turn_rate=bends[0], clock=rng.uniform(0, 60, size))
        end = ahead(start, (speeds[1] - speeds[0]) / lasts, (bends[1] - bends[0]) / lasts, lasts)
        return Motions(world, model, model.laws[kind], start, end, t0=start.clock)
    if kind == HOLD.kind:
        return holds(world, model, States(x=x, y=y, yaw=yaw), rng)
    length = rng.uniform(0.1, 0.4, size) if kind == "move" else np.zeros(size)
    turn = rng.uniform(0.2, 3.1, size) * rng.choice([-1.0, 1.0], size) if kind == "turn" else np.zeros(size)
    end = States(x=x + length * np.cos(yaw), y=y + length * np.sin(yaw), yaw=yaw + turn)
    return Motions(world, model, model.laws[kind], States(x=x, y=y, yaw=yaw), end, t0=rng.uniform(0, 60, size))


def holds(world: World, model: Model, states: States, rng: np.random.Generator) -> Motions:
    """Robots that stand still in states (M,), for up to three seconds, from any time."""
    clock, lasts = rng.uniform(0, 60, states.size), rng.uniform(0.2, 3.0, states.size)
    start, end = (States(**states.__dict__ | {CLOCK: time}) for time in (clock, clock + lasts))
    return Motions(world, model, HOLD, start, end, t0=clock)
