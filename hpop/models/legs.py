"""How a base in the plane gets from one state to another: a turn towards it, a straight move, a turn to its heading."""

from __future__ import annotations

import numpy as np

from hpop.math import wrap
from hpop.motions import Leg, States, StateSpace

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
