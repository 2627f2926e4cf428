"""How a base in the plane gets from one state to another: a turn towards it, a straight move, a turn to its heading."""

from __future__ import annotations

import numpy as np

from hpop.base.math import wrap
from hpop.models.laws import Move
from hpop.motions import Leg, Model, States, StateSpace

UNMOVED = 1e-6  # m: an end that is so near to a state is at its place
ALIGNED = 1e-9  # rad: a turn by less is none


def turn_move_turn(space: StateSpace, a: States, b: States, *, turn: str = "turn", move: str = "move") -> list[Leg]:
    """From states a (M,) to the places and headings of b; a yaw of NaN there is that of the move, if there is one.

    ``turn`` and ``move`` are the kinds of the laws by which it turns and moves.
    """
    apart = np.hypot(b.x - a.x, b.y - a.y) > UNMOVED
    arrives = np.where(np.isnan(b.yaw), a.yaw, b.yaw)
    ahead = np.where(apart, np.arctan2(b.y - a.y, b.x - a.x), arrives)
    last = np.where(np.isnan(b.yaw), ahead, b.yaw)
    first, second = (np.where(np.abs(by) > ALIGNED, by, 0.0) for by in (wrap(ahead - a.yaw), wrap(last - ahead)))
    place = {"x": np.where(apart, b.x, a.x), "y": np.where(apart, b.y, a.y)}
    own = {name: getattr(a, name) for name in space.names}
    return [
        Leg(turn, States(**own | {"yaw": a.yaw + first}), first != 0.0),
        Leg(move, States(**own | place | {"yaw": a.yaw + first}), apart),
        Leg(turn, States(**own | place | {"yaw": a.yaw + first + second}), second != 0.0),
    ]


def cruise_speed(base: Model) -> float:
    """Return the speed, m/s, at which a base in the plane goes straight on for one metre, as it is planned."""
    move = base.laws.get("move")
    if isinstance(move, Move):
        return move.speed
    begin, end = (States(x=np.full(1, x), y=np.zeros(1), yaw=np.zeros(1)) for x in (0.0, 1.0))
    lasts = 0.0
    for leg in base.connect(begin, end):
        phases = base.laws[leg.kind].phases(begin, leg.end)
        lasts += float(sum(phase.duration for phase in phases)[0]) if leg.present[0] else 0.0
        begin = leg.end
    return 1.0 / lasts
